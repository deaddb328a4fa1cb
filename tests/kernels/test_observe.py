"""Tracking and sensing kernels: signs, directions, wrapping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.config import build, lookup
from steersman.kernels import observe as kernel
from steersman.kernels import vehicle as car
from steersman.types import FloatArray

CIRCLE = build(lookup("path", "circle"), {"radius": 50.0})


def state_at(s: float, d: float, heading: float, slip: float = 0.0) -> FloatArray:
    """A car at offset ``d`` beside the circle, turned by ``heading`` from it, at 10 m/s."""
    at = CIRCLE.at(s)
    state = np.zeros(car.N_STATE)
    state[car.X], state[car.Y] = at.x - d * math.sin(at.psi), at.y + d * math.cos(at.psi)
    state[car.PSI] = at.psi + heading
    state[car.VX], state[car.VY] = 10.0 * math.cos(slip), 10.0 * math.sin(slip)
    return state


@given(st.floats(-1e4, 1e4))
def test_wrap_angle(angle: float) -> None:
    wrapped = kernel.wrap_angle(angle)
    assert wrapped == pytest.approx(kernel.wrap_angle.py_func(angle), abs=1e-12)
    assert -math.pi < wrapped <= math.pi
    turns = (angle - wrapped) / math.tau
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_wrap_angle_at_the_ends() -> None:
    assert kernel.wrap_angle(math.pi) == math.pi
    assert kernel.wrap_angle(-math.pi) == math.pi
    assert kernel.wrap_angle(0.0) == 0.0
    # Just short of half a turn, doubles lie wide of the exact boundary.
    assert kernel.wrap_angle(-3.0 * math.pi) == pytest.approx(math.pi)


@given(st.floats(0.0, 314.0), st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-1.0, 1.0))
def test_tracking(s: float, d: float, heading: float, slip: float) -> None:
    state, out, other = state_at(s, d, heading, slip), *np.zeros((2, kernel.N_TRACKING))
    kernel.track(CIRCLE.table, 0, state, s + 1.0, out)
    kernel.track.py_func(CIRCLE.table, 0, state, s + 1.0, other)
    np.testing.assert_allclose(out, other, atol=1e-12)
    assert math.remainder(out[kernel.S] - s, CIRCLE.length) == pytest.approx(0.0, abs=1e-6)
    assert out[kernel.D] == pytest.approx(d, abs=1e-8)
    assert out[kernel.HEADING] == pytest.approx(heading, abs=1e-7)
    # Direction of the velocity: side-slip to the left turns the course to the left.
    assert out[kernel.COURSE] == pytest.approx(heading + slip, abs=1e-7)
    assert out[kernel.KAPPA] == pytest.approx(0.02)
    at = CIRCLE.at(s)
    assert out[kernel.PATH_X :] == pytest.approx([at.x, at.y], abs=1e-6)


def test_standing_car_has_no_slip() -> None:
    state, out = state_at(10.0, 0.5, 0.2), np.zeros(kernel.N_TRACKING)
    state[car.VX] = state[car.VY] = 0.0
    kernel.track(CIRCLE.table, 0, state, 10.0, out)
    assert out[kernel.COURSE] == out[kernel.HEADING]


@pytest.mark.parametrize("noisy", [False, True])
@given(st.floats(0.0, 314.0), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_sense_equals_python(noisy: bool, s: float, d: float, heading: float) -> None:
    state, place = state_at(s, d, heading), np.zeros(kernel.N_TRACKING)
    kernel.track(CIRCLE.table, 0, state, s, place)
    rng = np.random.default_rng(0)
    shift = rng.uniform(-0.5, 0.5, (6, 2)) if noisy else np.zeros((0, 2))
    weights = rng.uniform(-1.0, 1.0, (3, 6))
    rows = np.zeros((2, kernel.O_PREVIEW + 12))
    for row, run in zip(rows, (kernel.sense, kernel.sense.py_func), strict=True):
        run(CIRCLE.table, 0, state, place, 2.0, 6, shift, weights, row)
    # A heading error beside half a turn may come out on either side.
    turned = math.remainder(rows[0, kernel.O_HEADING] - rows[1, kernel.O_HEADING], math.tau)
    assert turned == pytest.approx(0.0, abs=1e-11)
    rows[:, kernel.O_HEADING] = 0.0
    np.testing.assert_allclose(rows[0], rows[1], atol=1e-11)


def test_shifted_heading_error_stays_in_range() -> None:
    # A car across the road, with a road that looks turned further: 3.1 + 0.2 is -2.98.
    state, place = state_at(0.0, 0.0, 3.1), np.zeros(kernel.N_TRACKING)
    kernel.track(CIRCLE.table, 0, state, 0.0, place)
    shift = np.zeros((4, 2))
    shift[0] = state_shift(3.1, -0.2)
    weights = np.zeros((3, 4))
    weights[1, 0] = 1.0
    row = np.zeros(kernel.O_PREVIEW + 8)
    kernel.sense(CIRCLE.table, 0, state, place, 2.0, 4, shift, weights, row)
    assert row[kernel.O_HEADING] == pytest.approx(3.3 - math.tau)


def state_shift(heading: float, across: float) -> tuple[float, float]:
    """A shift to the left of the road by ``across``, in the frame of a car turned from it."""
    return across * math.sin(heading), across * math.cos(heading)
