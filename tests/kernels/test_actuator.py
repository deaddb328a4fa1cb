"""Actuators: how far they get, whatever the step; with a lag and without."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steersman.kernels import actuator

steers = st.floats(-1.0, 1.0)
lags = st.floats(0.0, 0.5)


@given(steers, steers, st.floats(1e-4, 0.5))
def test_slew_in_two_halves_is_slew_in_one(position: float, command: float, h: float) -> None:
    half = actuator.slew(position, command, 2.5, 5.0, 0.5 * h)
    twice = actuator.slew(half, command, 2.5, 5.0, 0.5 * h)
    assert twice == pytest.approx(actuator.slew(position, command, 2.5, 5.0, h), abs=1e-12)


@given(steers, steers, st.floats(1e-4, 0.5))
def test_slew_never_overshoots_nor_turns_back(position: float, command: float, h: float) -> None:
    reached = actuator.slew(position, command, 2.5, 5.0, h)
    low, high = sorted((position, command))
    assert low - 1e-15 <= reached <= high + 1e-15
    assert abs(reached - position) <= 5.0 * h + 1e-12


@pytest.mark.parametrize(
    ("position", "command", "h", "expected"),
    [
        (0.0, 1.0, 0.05, 0.125),
        (0.0, -1.0, 0.05, -0.125),
        (0.8, 0.0, 0.05, 0.55),
        (0.8, 0.7, 0.05, 0.7),
        (0.2, -1.0, 0.04, 0.0),
        # 0.02 s down to zero at 5 per second, then 0.03 s up at 2.5 per second.
        (0.1, -1.0, 0.05, -0.075),
        (-0.1, 1.0, 0.05, 0.075),
    ],
)
def test_slew_rates(position: float, command: float, h: float, expected: float) -> None:
    assert actuator.slew(position, command, 2.5, 5.0, h) == pytest.approx(expected, abs=1e-15)


@given(steers, steers, st.floats(1e-4, 0.5))
def test_slew_equals_python(position: float, command: float, h: float) -> None:
    args = (position, command, 2.5, 5.0, h)
    assert actuator.slew(*args) == actuator.slew.py_func(*args)


# ------------------------------------------------------------------------------------- lag


@given(steers, steers, lags, st.floats(1e-4, 0.5))
def test_lagged_in_two_halves_is_lagged_in_one(
    position: float, command: float, lag: float, h: float
) -> None:
    half = actuator.slew_lagged(position, command, 2.5, 5.0, lag, 0.5 * h)
    twice = actuator.slew_lagged(half, command, 2.5, 5.0, lag, 0.5 * h)
    once = actuator.slew_lagged(position, command, 2.5, 5.0, lag, h)
    assert twice == pytest.approx(once, abs=1e-9)


@given(steers, steers, st.floats(1e-4, 0.5))
def test_without_a_lag_it_is_slew(position: float, command: float, h: float) -> None:
    limited = actuator.slew(position, command, 2.5, 5.0, h)
    assert actuator.slew_lagged(position, command, 2.5, 5.0, 0.0, h) == limited
    assert actuator.slew_lagged(position, command, 2.5, 5.0, 1e-9, h) == pytest.approx(
        limited, abs=1e-7
    )


def test_a_fast_actuator_with_a_lag_is_of_first_order() -> None:
    reached = actuator.slew_lagged(0.1, -0.2, 1e3, 1e3, 0.2, 0.1)
    assert reached == pytest.approx(-0.2 + 0.3 * math.exp(-0.5), abs=1e-12)


@given(steers, steers, st.floats(0.02, 0.5))
@settings(max_examples=20)
def test_lagged_solves_its_equation(position: float, command: float, lag: float) -> None:
    at, h = position, 1e-4
    for _ in range(2000):
        rate = 2.5 if abs(command) > abs(at) and at * command >= 0.0 else 5.0
        at += h * min(max((command - at) / lag, -rate), rate)
    found = actuator.slew_lagged(position, command, 2.5, 5.0, lag, 0.2)
    assert found == pytest.approx(at, abs=2e-3)


@given(steers, steers, lags, st.floats(1e-4, 0.5))
def test_lagged_equals_python(position: float, command: float, lag: float, h: float) -> None:
    args = (position, command, 2.5, 5.0, lag, h)
    python = actuator.slew_lagged.py_func(*args)
    assert actuator.slew_lagged(*args) == pytest.approx(python, abs=1e-14)
