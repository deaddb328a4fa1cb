"""Smoothing a noisy road: exact points pass, Whittaker's smoother as a dense system agrees."""

from __future__ import annotations

import numpy as np
import pytest

from steersman.kernels import road_smoother as kernel
from steersman.types import FloatArray

N, SPACING = 15, 2.0


def smoothed(points: FloatArray, noise: float, *, compiled: bool = True) -> FloatArray:
    out, scratch = np.empty((N, 2)), np.empty((N, N))
    smooth = kernel.smooth_points if compiled else kernel.smooth_points.py_func
    smooth(points, SPACING, noise, scratch, out)
    return out


@pytest.mark.parametrize("level", [0.0, 1e-3, 0.05])
def test_smoothing_is_whittakers(level: float) -> None:
    points = np.random.default_rng(4).normal(size=(N, 2))
    third = np.diff(np.eye(N), 3, axis=0) / (1e-3 * SPACING**3)
    expected = np.linalg.solve(np.eye(N) + level**2 * third.T @ third, points)
    assert smoothed(points, level**2) == pytest.approx(expected, abs=1e-9 if level else 0.0)


def test_noise_is_found_and_falls() -> None:
    """Of a clothoid's waypoints, each with an error of its own."""
    rng = np.random.default_rng(0)
    u = SPACING * np.arange(N)
    road = np.stack([u, 0.01 * u**2 + 1e-4 * u**3], axis=1)
    noisy = road + rng.normal(0.0, 0.05, size=(200, N, 2))
    found = [kernel.roughness(points) for points in noisy]
    assert np.mean(found) == pytest.approx(0.05**2, rel=0.1)
    errors = [smoothed(points, noise) - road for points, noise in zip(noisy, found, strict=True)]
    assert np.std(errors) < 0.7 * 0.05
    assert np.sqrt(kernel.roughness(road)) < 1e-3


def test_compiled_equals_python() -> None:
    points = np.random.default_rng(5).normal(size=(N, 2))
    assert smoothed(points, 1e-3) == pytest.approx(
        smoothed(points, 1e-3, compiled=False), abs=1e-10
    )
