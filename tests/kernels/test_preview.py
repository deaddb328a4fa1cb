"""Reading the road from its waypoints, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.kernels import preview as kernel

SPACING = 2.0
U = SPACING * np.arange(15)


def circle(radius: float) -> np.ndarray:
    """Waypoints of a circle that starts at the origin along x, to the left if positive."""
    return np.stack([radius * np.sin(U / radius), radius * (1.0 - np.cos(U / radius))], axis=1)


def test_point_is_exact_on_cubics_and_goes_on_along_the_tangent() -> None:
    x = np.polynomial.Polynomial([0.1, 1.0, 0.01, -0.001])
    y = np.polynomial.Polynomial([0.3, -0.1, 0.02, 0.001])
    points = np.stack([x(U), y(U)], axis=1)
    for u in (0.0, 0.7, 1.9, 11.3, 26.5, 28.0):
        assert kernel.point_at(points, SPACING, u) == pytest.approx((x(u), y(u)), abs=1e-11)
    for u, end in ((-1.5, 0.0), (31.0, 28.0)):
        expected = [p(end) + (u - end) * p.deriv()(end) for p in (x, y)]
        assert kernel.point_at(points, SPACING, u) == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("radius", [40.0, -15.0])
@pytest.mark.parametrize("distance", [1.5, 4.0, 9.0])
def test_point_at_a_distance(radius: float, distance: float) -> None:
    """From a point of the circle the chord of length c subtends 2 asin(c / 2 R)."""
    x, y = kernel.at_distance(circle(radius), SPACING, 0.0, 0.0, distance)
    turn = 2.0 * math.asin(distance / (2.0 * radius))
    expected = (radius * math.sin(turn), radius * (1.0 - math.cos(turn)))
    assert (x, y) == pytest.approx(expected, abs=2e-4)
    assert math.hypot(x, y) == pytest.approx(distance, abs=1e-7)


def test_point_at_a_distance_where_a_waypoint_is_out_of_place() -> None:
    x = SPACING * np.arange(15.0)
    x[4] = 0.0  # the road doubles back, so that the distance grows faster than the arc length
    points = np.stack([x, 0.02 * x], axis=1)
    there = kernel.at_distance(points, SPACING, -1.4, 0.0, 9.1)
    assert math.hypot(there[0] + 1.4, there[1]) == pytest.approx(9.1, abs=1e-9)
    near = kernel.at_distance(points * (1.0 + 1e-7), SPACING, -1.4, 0.0, 9.1)
    assert near == pytest.approx(there, abs=1e-5)


def test_a_distance_that_the_waypoints_do_not_have() -> None:
    points = circle(100.0)
    assert kernel.at_distance(points, SPACING, 0.0, 0.0, 99.0) == pytest.approx(tuple(points[-1]))
    assert kernel.at_distance(points, SPACING, 0.0, 9.0, 4.0) == pytest.approx((0.0, 0.0))


@pytest.mark.parametrize("radius", [12.0, -50.0])
@pytest.mark.parametrize("u", [0.0, 0.5, 3.3, 26.0, 99.0])
def test_curvature_is_exact_on_circles(radius: float, u: float) -> None:
    found = kernel.curvature_at(circle(radius), SPACING, 1.0 / radius, u)
    assert found == pytest.approx(1.0 / radius, rel=1e-12)


def test_curvature_is_linear_between_waypoints() -> None:
    rng = np.random.default_rng(0)
    points = np.stack([U, rng.normal(size=15)], axis=1)
    for i in (0, 1, 7, 12):
        ends = [kernel.curvature_at(points, SPACING, 0.3, SPACING * (i + j)) for j in (0, 1)]
        middle = kernel.curvature_at(points, SPACING, 0.3, SPACING * (i + 0.25))
        assert middle == pytest.approx(0.75 * ends[0] + 0.25 * ends[1])
    assert kernel.curvature_at(points, SPACING, 0.3, -1.0) == 0.3


def test_compiled_equals_python() -> None:
    rng = np.random.default_rng(2)
    points = np.stack([U, rng.normal(size=15)], axis=1)
    for u in (-1.0, 0.0, 3.7, 27.0, 40.0):
        for function, given in (
            (kernel.point_at, (u,)),
            (kernel.curvature_at, (0.1, u)),
            (kernel.at_distance, (0.5, 0.2, u)),
        ):
            compiled, python = (f(points, SPACING, *given) for f in (function, function.py_func))
            assert compiled == pytest.approx(python, abs=1e-12)
