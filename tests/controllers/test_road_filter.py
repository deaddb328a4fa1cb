"""Fusing a noisy road over time: exact input passes, noise falls, textbook filters agree."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.controllers.road_filter import RoadState, first_look, fuse
from steersman.kernels import road_filter as kernel
from steersman.kernels.preview import curvature_of
from steersman.paths.base import PathComponent
from steersman.sensing import WaypointSensor, track
from steersman.types import FloatArray, Observation

from ..loops import DT, Posed, beside

EXACT, NOISY = WaypointSensor(), WaypointSensor(error_range=0.1)


def tour(path: PathComponent, sensor: WaypointSensor, v: float = 10.0) -> list[Observation]:
    """What a car sees that drives along a parallel of the road, 0.2 m to its left."""
    rng, out = np.random.default_rng(0), []
    for i in range(round(150.0 / (v * DT))):
        s = v * DT * i + 1.0
        kappa = path.at(s).curvature
        on = v * (1.0 - 0.2 * kappa)
        car = beside(path, s, d=0.2, velocity=(on, 0.0), yaw_rate=v * kappa, time=i * DT)
        out.append(sensor.observe(None, car, track(car, path, s), path, rng))
    return out


def fused(observations: list[Observation]) -> list[Observation]:
    state: RoadState | None = None
    out = []
    for o in observations:
        if state is None:
            state, quiet = first_look(o), o
        else:
            quiet, state = fuse(state, o, DT)
        out.append(quiet)
    return out


def curvatures(observations: list[Observation]) -> FloatArray:
    return np.array([[curvature_of(o.preview, i) for i in range(1, 12)] for o in observations])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_exact_sensor_is_believed(side: float) -> None:
    truth = tour(Posed(side=side), EXACT)
    quiet = fused(truth)
    for a, b in zip(quiet, truth, strict=True):
        assert a.lateral_error == pytest.approx(b.lateral_error, abs=1e-3)
        assert a.heading_error == pytest.approx(b.heading_error, abs=3e-4)
        assert a.preview == pytest.approx(b.preview, abs=3e-3)
        assert a[3:8] == b[3:8]
    assert abs(curvatures(quiet) - curvatures(truth)).max() < 1e-3


def test_noise_falls() -> None:
    truth, noisy = tour(Posed(), EXACT), tour(Posed(), NOISY)
    quiet = fused(noisy)

    def spread(of: list[Observation], name: str) -> float:
        differences = [getattr(a, name) - getattr(b, name) for a, b in zip(of, truth, strict=True)]
        return float(np.std(differences[40:]))

    assert spread(quiet, "lateral_error") < 0.35 * spread(noisy, "lateral_error")
    assert spread(quiet, "heading_error") < 0.35 * spread(noisy, "heading_error")
    bends = [curvatures(of) - curvatures(truth) for of in (quiet, noisy)]
    assert bends[0][40:].std() < 0.1 * bends[1][40:].std()


def test_errors_are_filtered_as_by_the_textbook() -> None:
    """Kalman's equations with matrices, measurements one after the other."""
    rng = np.random.default_rng(3)
    memory = np.zeros(kernel.N_MEMORY)
    memory[[kernel.P_DD, kernel.P_HH, kernel.R_D, kernel.R_H]] = 1e-3, 1e-4, 2e-3, 3e-4
    x, p = np.zeros(2), np.diag([1e-3, 1e-4])
    v = 8.0
    drift = np.diag([1e-3, 3e-4]) ** 2
    for _ in range(20):
        z = rng.normal(0.0, 0.01, 2)
        kernel.reckon_errors(v, 0.0, 0.0, 0.0, DT, memory)
        kernel.correct_errors(z[0], z[1], 0.0, memory)
        x = np.array([x[0] + DT * v * math.sin(x[1]), x[1]])
        move = np.array([[1.0, v * DT], [0.0, 1.0]])
        p = move @ p @ move.T + drift
        for i, noise in enumerate((2e-3, 3e-4)):
            gain = p[:, i] / (p[i, i] + noise)
            x, p = x + gain * (z[i] - x[i]), p - np.outer(gain, p[i])
        assert memory[[kernel.D, kernel.HEADING]] == pytest.approx(x, abs=1e-12)
        expected = p[0, 0], p[0, 1], p[1, 1]
        assert memory[[kernel.P_DD, kernel.P_DH, kernel.P_HH]] == pytest.approx(expected)


@pytest.mark.parametrize("level", [0.0, 1e-3, 0.05])
def test_smoothing_is_whittakers(level: float) -> None:
    rng, n, spacing = np.random.default_rng(4), 15, 2.0
    points, spread = rng.normal(size=(n, 2)), rng.uniform(0.05, 1.0, n)
    out = np.empty((n, 2))
    kernel.smooth_points(points, spacing, spread, level**2, np.empty((n, n)), out)
    if level == 0.0:
        assert np.array_equal(out, points)
        return
    third = np.diff(np.eye(n), 3, axis=0) / (1e-3 * spacing**3)
    weight = np.diag(1.0 / (spread * level**2))
    expected = np.linalg.solve(weight + third.T @ third, weight @ points)
    assert out == pytest.approx(expected, abs=1e-6)


def test_compiled_equals_python() -> None:
    rng = np.random.default_rng(5)
    points, spread = rng.normal(size=(15, 2)), rng.uniform(0.1, 1.0, 15)
    out, python = np.empty((15, 2)), np.empty((15, 2))
    kernel.smooth_points(points, 2.0, spread, 1e-3, np.empty((15, 15)), out)
    kernel.smooth_points.py_func(points, 2.0, spread, 1e-3, np.empty((15, 15)), python)
    assert out == pytest.approx(python, abs=1e-10)
