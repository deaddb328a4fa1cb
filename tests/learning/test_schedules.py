"""Schedules against their closed forms."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.config import components, dump, resolve
from steersman.learning.schedules import Constant, Cyclical, HoldThenDecay, Linear, Schedule

TOTAL = 200_000.0
STEPS = st.floats(0.0, TOTAL)


def test_constant() -> None:
    assert {Constant(at=0.3).value(s, TOTAL) for s in (0, 1e5, TOTAL)} == {0.3}


@pytest.mark.parametrize(
    ("step", "value"), [(0, 1.0), (25_000, 0.75), (50_000, 0.5), (100_000, 0.0), (TOTAL, 0.0)]
)
def test_linear(step: float, value: float) -> None:
    assert Linear(start=1.0, end=0.0, until=0.5).value(step, TOTAL) == pytest.approx(value)


@pytest.mark.parametrize(
    ("step", "value"), [(0, 1e-3), (100_000, 1e-3), (150_000, 1e-4), (TOTAL, 1e-5), (3e5, 1e-5)]
)
def test_hold_then_decay(step: float, value: float) -> None:
    schedule = HoldThenDecay(start=1e-3, end=1e-5, hold=0.5)
    assert schedule.value(step, TOTAL) == pytest.approx(value)


PAPER = Cyclical()


def test_cycles_start_at_the_maximum_without_a_jump() -> None:
    half = TOTAL / 2
    assert PAPER.value(0, TOTAL) == PAPER.value(half - 1, TOTAL) == 1e-3
    assert PAPER.value(half, TOTAL) == pytest.approx(1e-3)
    assert PAPER.value(half + 1e-6, TOTAL) == pytest.approx(1e-3)


@pytest.mark.parametrize("cycle", [0, 1, 7, 1000])
def test_a_cycle_is_a_triangle_of_32_steps(cycle: int) -> None:
    top = 1e-3 * 0.997**cycle
    begin = TOTAL / 2 + 32 * cycle
    values = [PAPER.value(begin + k, TOTAL) for k in range(32)]
    down = [top - (top - 0.1 * top) * k / 16 for k in range(17)]
    assert values == pytest.approx(down + down[15:0:-1])


@given(STEPS)
def test_cyclical_stays_within_its_bounds(step: float) -> None:
    cycle = max(step - TOTAL / 2, 0.0) // 32
    top = 1e-3 * 0.997**cycle
    assert 0.1 * top * (1 - 1e-12) <= PAPER.value(step, TOTAL) <= 1e-3


@given(st.integers(0, 2000), st.floats(0.0, 31.9))
def test_each_cycle_is_the_one_before_decayed(cycle: int, within: float) -> None:
    at = TOTAL / 2 + 32 * cycle + within
    ratio = PAPER.value(at + 32, TOTAL) / PAPER.value(at, TOTAL)
    assert ratio == pytest.approx(0.997, rel=1e-6)


@pytest.mark.parametrize("kind", components("schedule"))
@given(step=STEPS)
def test_every_schedule_is_finite_and_not_negative(kind: str, step: float) -> None:
    schedule = resolve("schedule", kind)
    assert isinstance(schedule, Schedule)
    assert 0.0 <= schedule.value(step, TOTAL) < float("inf")
    assert resolve("schedule", dump(schedule)) == schedule
