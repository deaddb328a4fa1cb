"""Arithmetic of the condensed MPC, compiled and as Python, against NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.kernels import condensed_qp as kernel

SPACING = 2.0


def preview(y: np.ndarray) -> np.ndarray:
    return np.stack([SPACING * np.arange(len(y)), y], axis=1)


@pytest.mark.parametrize("distance", [0.01, 0.25, 0.5, 1.4])
def test_reference_is_exact_on_cubics(distance: float) -> None:
    cubic = np.polynomial.Polynomial([0.3, -0.1, 0.02, -0.001])
    out = np.empty(20)
    kernel.reference(preview(cubic(SPACING * np.arange(15))), SPACING, distance, out)
    assert out == pytest.approx(cubic(distance * np.arange(1, 21)), abs=1e-12)


def test_reference_goes_on_straight_beyond_the_last_waypoint() -> None:
    cubic = np.polynomial.Polynomial([0.0, 0.2, -0.01, 0.002])
    out, end = np.empty(20), 3 * SPACING
    kernel.reference(preview(cubic(SPACING * np.arange(4))), SPACING, 1.0, out)
    u = np.arange(1.0, 21.0)
    beyond = cubic(end) + (u - end) * cubic.deriv()(end)
    assert out == pytest.approx(np.where(u <= end, cubic(u), beyond), abs=1e-11)


def test_gradient_weighs_what_stays_if_nothing_is_done() -> None:
    rng = np.random.default_rng(1)
    points = preview(rng.normal(size=15))
    free, weight = rng.normal(size=(6, 2)), rng.normal(size=(6, 6))
    road, rest, out = np.empty(6), np.empty(6), np.empty(6)
    kernel.reference(points, SPACING, 0.7, road)
    kernel.gradient(points, SPACING, 0.7, 0.02, -0.3, free, weight, rest, out)
    assert rest == pytest.approx(free @ [0.02, -0.3] - road)
    assert out == pytest.approx(weight @ rest)


def test_compiled_equals_python() -> None:
    rng = np.random.default_rng(2)
    points = preview(rng.normal(size=15))
    free, weight = rng.normal(size=(8, 2)), rng.normal(size=(8, 8))
    results = []
    for function in (kernel.gradient, kernel.gradient.py_func):
        rest, out = np.empty(8), np.empty(8)
        function(points, SPACING, 6.0, 0.1, 0.2, free, weight, rest, out)
        results.append((rest, out))
    (rest, out), (rest_python, out_python) = results
    assert rest == pytest.approx(rest_python, abs=1e-14)
    assert out == pytest.approx(out_python, abs=1e-12)
    compiled, python = np.empty(8), np.empty(8)
    kernel.reference(points, SPACING, 5.0, compiled)
    kernel.reference.py_func(points, SPACING, 5.0, python)
    assert compiled == pytest.approx(python, abs=1e-12)


@pytest.mark.parametrize("function", [kernel.all_finite, kernel.all_finite.py_func])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_one_bad_number_is_found(function: object, bad: float) -> None:
    assert callable(function)
    assert function(np.array([1.0, 1e300]))
    assert not function(np.array([1.0, bad]))
