"""The sensor: exact without errors; with them unbiased, in range, and the same for everybody."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.config import build, lookup
from steersman.sensing import Tracking, WaypointSensor, track
from steersman.types import FloatArray, Observation, VehicleState

CIRCLE = build(lookup("path", "circle"), {"radius": 50.0})
TRACK = build(lookup("path", "training_circuit"), {})
STRAIGHT = build(lookup("path", "straight"), {})


def beside(path: object, s: float, d: float, heading: float) -> tuple[VehicleState, Tracking]:
    at = path.at(s)  # type: ignore[attr-defined]
    state = VehicleState(
        *(1.0, at.x - d * math.sin(at.psi), at.y + d * math.cos(at.psi), at.psi + heading),
        *(12.0, -0.3, 0.2, 0.0, 0.0, 0.07, 0.05, 0.4, 0.0),
    )
    return state, track(state, path, s)  # type: ignore[arg-type]


def seen(
    sensor: WaypointSensor, path: object, s: float, d: float, heading: float, seed: int = 0
) -> Observation:
    state, place = beside(path, s, d, heading)
    rng = np.random.default_rng(seed)
    return sensor.observe(sensor.init(rng), state, place, path, rng)  # type: ignore[arg-type]


@pytest.mark.parametrize("path", [CIRCLE, TRACK, STRAIGHT], ids=["circle", "circuit", "straight"])
@given(st.floats(0.0, 300.0), st.floats(-1.5, 1.5), st.floats(-1.0, 1.0))
def test_without_errors_the_observation_is_exact(
    path: object, s: float, d: float, heading: float
) -> None:
    state, place = beside(path, s, d, heading)
    shown = seen(WaypointSensor(), path, s, d, heading)
    assert (shown.lateral_error, shown.heading_error) == (place.lateral_error, place.heading_error)
    assert shown.curvature == place.curvature
    assert (shown.time, shown.v_x, shown.v_y) == (1.0, 12.0, -0.3)
    assert (shown.yaw_rate, shown.steer, shown.spacing) == (0.2, 0.07, 2.0)
    assert shown.speed == pytest.approx(math.hypot(12.0, 0.3))
    # The first waypoint is beside the car: to its right if the car is left of the path.
    d, turned = place.lateral_error, place.heading_error
    first = (-d * math.sin(turned), -d * math.cos(turned))
    assert shown.preview[0] == pytest.approx(first, abs=1e-9)
    # Back in the plane, waypoints lie on the path, two metres apart along it.
    c, n = math.cos(state.psi), math.sin(state.psi)
    for i, (ahead, left) in enumerate(shown.preview):
        at = path.at(place.s + 2.0 * i)  # type: ignore[attr-defined]
        x, y = state.x + c * ahead - n * left, state.y + n * ahead + c * left
        assert (x, y) == pytest.approx((at.x, at.y), abs=1e-9)


def test_shifts_stay_in_range_and_fill_it() -> None:
    sensor = WaypointSensor(error_range=0.2, count=20)
    clean = seen(WaypointSensor(count=20), TRACK, 50.0, 0.3, 0.1).preview
    shifts = np.array(
        [seen(sensor, TRACK, 50.0, 0.3, 0.1, seed).preview - clean for seed in range(50)]
    )
    assert np.abs(shifts).max() <= 0.2
    assert np.abs(shifts).max() > 0.19
    for axis in (0, 1):
        assert shifts[..., axis].mean() == pytest.approx(0.0, abs=0.015)
        assert shifts[..., axis].std() == pytest.approx(0.2 / math.sqrt(3.0), rel=0.05)


@pytest.mark.parametrize("redraw", [True, False])
def test_redrawn_or_fixed(redraw: bool) -> None:
    sensor = WaypointSensor(error_range=0.2, redraw=redraw)
    rng = np.random.default_rng(1)
    sensor_state = sensor.init(rng)
    state, place = beside(STRAIGHT, 40.0, 0.0, 0.0)
    one, two = (sensor.observe(sensor_state, state, place, STRAIGHT, rng) for _ in range(2))
    assert (one.preview == two.preview).all() == (not redraw)
    assert (one.lateral_error == two.lateral_error) == (not redraw)


def test_the_same_seed_sees_the_same() -> None:
    sensor = WaypointSensor(error_range=0.2)
    one, two = (seen(sensor, TRACK, 10.0, 0.0, 0.0, seed=5) for _ in range(2))
    assert (one.preview == two.preview).all()


def test_estimates_are_unbiased() -> None:
    sensor = WaypointSensor(error_range=0.3)
    shown = [seen(sensor, TRACK, 120.0, 0.4, 0.05, seed) for seed in range(600)]
    truth = beside(TRACK, 120.0, 0.4, 0.05)[1]
    found = np.array([(o.lateral_error, o.heading_error, o.curvature) for o in shown])
    expected = (truth.lateral_error, truth.heading_error, truth.curvature)
    spread = found.std(axis=0)
    assert (spread > 0.0).all()
    assert (np.abs(found.mean(axis=0) - expected) < 4.0 * spread / math.sqrt(600)).all()
    # As the weights say: uniform shifts have a deviation of range / sqrt(3).
    sigma = 0.3 / math.sqrt(3.0)
    assert spread == pytest.approx(sigma * np.linalg.norm(sensor.fit_weights(), axis=1), rel=0.1)


@pytest.mark.parametrize(("count", "spacing"), [(4, 2.0), (15, 2.0), (30, 0.7)])
def test_fit_reproduces_a_parabola(count: int, spacing: float) -> None:
    sensor = WaypointSensor(count=count, spacing=spacing)
    u = np.arange(count) * spacing
    value, slope, bend = 0.3, -0.02, 0.004
    offsets = value + slope * u + 0.5 * bend * u * u
    assert sensor.fit_weights() @ offsets == pytest.approx([value, slope, bend], abs=1e-12)


class Shifted(WaypointSensor):
    """Shifts the whole road along a parabola instead of at random."""

    def draw(self, rng: np.random.Generator) -> FloatArray:
        u = np.arange(self.count) * self.spacing
        return np.stack([np.zeros_like(u), 0.3 - 0.02 * u + 0.002 * u * u], axis=1)


def test_a_road_shifted_by_a_parabola_is_seen_there() -> None:
    # On a straight, seen from a car in line with it: the shifted road is 0.3 m to the left,
    # turned by -0.02 and bent by 0.004 1/m, so the car is 0.3 m right of it and turned by 0.02.
    shown = seen(Shifted(), STRAIGHT, 40.0, 0.0, 0.0)
    assert shown.lateral_error == pytest.approx(-0.3)
    assert shown.heading_error == pytest.approx(0.02)
    assert shown.curvature == pytest.approx(0.004)


@pytest.mark.parametrize(
    ("noise", "columns"),
    [
        ({"position_noise": 0.1}, {"lateral_error"}),
        ({"heading_noise": 0.02}, {"heading_error"}),
        ({"speed_noise": 0.3}, {"v_x", "v_y"}),
        ({"yaw_rate_noise": 0.01}, {"yaw_rate"}),
    ],
)
def test_measured_with_errors_of_the_size_that_they_say(
    noise: dict[str, float], columns: set[str]
) -> None:
    sensor = WaypointSensor(**noise)
    (size,) = noise.values()
    shown = [seen(sensor, STRAIGHT, 40.0, 0.2, 0.0, seed) for seed in range(800)]
    truth = seen(WaypointSensor(), STRAIGHT, 40.0, 0.2, 0.0)
    for name in ("lateral_error", "heading_error", "v_x", "v_y", "yaw_rate"):
        errors = np.array([getattr(o, name) for o in shown]) - getattr(truth, name)
        if name in columns:
            assert errors.std() == pytest.approx(size, rel=0.1)
            assert errors.mean() == pytest.approx(0.0, abs=4.0 * size / math.sqrt(800))
        else:
            assert np.abs(errors).max() < 1e-9


def test_a_wrong_pose_sees_the_whole_road_from_there() -> None:
    """On a straight the lateral error and every waypoint's offset tell the same wrong position."""
    sensor = WaypointSensor(position_noise=0.2)
    for seed in range(5):
        shown = seen(sensor, STRAIGHT, 40.0, 0.0, 0.0, seed)
        assert shown.preview[:, 1] == pytest.approx(-shown.lateral_error)
        assert abs(shown.lateral_error) > 1e-3
