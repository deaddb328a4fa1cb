"""Encodings: names, scales and layouts belong together, for every registered one."""

from __future__ import annotations

import numpy as np
import pytest

from steersman.config import build, components, lookup
from steersman.encoding import EncodingComponent, ExtendedEncoding, WaypointEncoding
from steersman.kernels import encode as kernel
from steersman.plants.simulator import SimulatorConfig
from steersman.sensing import WaypointSensor, track
from steersman.types import Command, Pose
from steersman.vehicles import CarlaModel3

ENCODINGS = [
    *(build(cls, {}) for cls in components("encoding").values()),
    WaypointEncoding(waypoints=1, steer=True),
    ExtendedEncoding(waypoints=5, roads=0, history=8),
    ExtendedEncoding(errors=False, integral=False, command=False, roads=1),
]


@pytest.mark.parametrize("action", ["rate", "direct", "residual"])
@pytest.mark.parametrize("encoding", ENCODINGS, ids=str)
def test_every_feature_has_a_name_with_unit_and_a_scale(
    encoding: EncodingComponent, action: str
) -> None:
    layout = encoding.layout(2.0, 0.05, action)
    names, scale = layout.names, layout.scale
    assert len(names) == len(scale) == kernel.feature_count(layout.table)
    assert len(set(names)) == len(names)
    assert all(name.endswith("]") and " [" in name for name in names)
    assert (scale > 0.0).all()


@pytest.mark.parametrize("encoding", ENCODINGS, ids=str)
def test_what_is_corrected_is_seen_beside_the_last_command(encoding: EncodingComponent) -> None:
    plain, layout = (encoding.layout(2.0, 0.05, action) for action in ("direct", "residual"))
    added = set(layout.names) - set(plain.names)
    assert added | {"last_command [-]"} == {"last_command [-]", "base_command_less_last [-]"}
    assert "last_command [-]" in layout.names
    assert layout.mirror[-1] == -1.0


def test_steering_is_seen_when_its_rate_is_the_action() -> None:
    for encoding, action, seen in (
        (WaypointEncoding(), "direct", False),
        (WaypointEncoding(), "rate", True),
        (WaypointEncoding(steer=True), "direct", True),
        (ExtendedEncoding(), "direct", True),
    ):
        names = encoding.layout(2.0, 0.05, action).names
        assert ("steer [-]" in names) == seen


@pytest.mark.parametrize("encoding", ENCODINGS, ids=str)
def test_features_are_of_about_unit_size(encoding: EncodingComponent) -> None:
    layout = encoding.layout(2.0, 0.05, "rate")
    table = layout.table
    scale, names = layout.scale, layout.names
    largest = np.zeros(len(names))
    sensor, plant = WaypointSensor(), SimulatorConfig().make(CarlaModel3())
    rng = np.random.default_rng(0)
    for kind in ("training_circuit", "monza"):
        path = build(lookup("path", kind), {})
        for s in np.arange(0.0, path.length, 47.0):
            at = path.at(float(s))
            speed = min(25.0, (5.0 / max(abs(at.curvature), 1e-3)) ** 0.5)
            state = plant.reset(Pose(at.x - 0.5, at.y + 0.5, at.psi + 0.05), speed, at.curvature)
            shown = sensor.observe(None, state, track(state, path, float(s)), path, rng)
            row = np.array([*shown[1:8], *shown.preview.ravel()])
            memory, out = np.zeros(kernel.memory_size(table)), np.zeros(len(names))
            kernel.encode(table, row, memory, out)
            kernel.normalise(out, scale)
            largest = np.maximum(largest, np.abs(out))
    assert largest.max() < 5.0, names[int(largest.argmax())]
    # Side effects of the draw aside (an integral starts at zero), nothing is far below one.
    seen = [v for v, name in zip(largest, names, strict=True) if "integral" not in name]
    assert np.median(seen) > 0.1


@pytest.mark.parametrize("encoding", ENCODINGS, ids=str)
def test_mirror_gives_the_features_of_the_mirrored_scene(encoding: EncodingComponent) -> None:
    layout = encoding.layout(2.0, 0.05, "rate")
    table = layout.table
    sensor = WaypointSensor()
    sides = []
    for side in (1.0, -1.0):
        path = build(lookup("path", "training_circuit"), {"mirror": side < 0.0})
        plant = SimulatorConfig().make(CarlaModel3())
        at = path.at(230.0)
        start = Pose(at.x, at.y + 0.3 * side, at.psi + 0.04 * side)
        state = plant.reset(start, 9.0, at.curvature)
        memory = np.zeros(kernel.memory_size(table))
        features = np.zeros(kernel.feature_count(table))
        for steer in (0.05, -0.1, 0.2):
            place = track(state, path, 230.0)
            observation = sensor.observe(None, state, place, path, np.random.default_rng(0))
            row = np.array([*observation[1:8], *observation.preview.ravel()])
            kernel.encode(table, row, memory, features)
            kernel.remember(table, row, memory, steer * side)
            state = plant.step(Command(steer * side, 0.3, 0.0))
        sides.append(features)
    left, right = sides
    assert right == pytest.approx(layout.mirror * left, abs=1e-9)
    assert np.count_nonzero(left) > len(left) - 3
