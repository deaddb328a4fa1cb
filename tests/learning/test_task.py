"""Rewards against their closed forms, compiled and as Python."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.kernels import reward as kernel
from steersman.learning.task import PaperTask, PreciseTask, TaskComponent

REAL = st.floats(-3.0, 3.0)


def track(task: TaskComponent, v: float, d: float, course: float, slip: float = 0.0) -> float:
    value = float(kernel.track_reward(task.table(), v, d, course, slip))
    plain = kernel.track_reward.py_func(task.table(), v, d, course, slip)
    assert value == pytest.approx(plain, rel=1e-12)
    return value


def combine(task: TaskComponent, r: float, *steers: float) -> tuple[float, float, float]:
    value: tuple[float, float, float] = kernel.combine(task.table(), r, *steers)
    assert value == pytest.approx(kernel.combine.py_func(task.table(), r, *steers), rel=1e-12)
    return value


def sigmoid(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x))


def test_paper_tracking() -> None:
    expected = abs(8 * math.cos(0.1)) - abs(8 * math.sin(0.1)) - 8 * 0.3
    assert track(PaperTask(), 8.0, -0.3, 0.1, slip=0.5) == pytest.approx(expected)


def test_paper_tracking_in_its_own_words() -> None:
    """Phi between velocity and heading, which is the side-slip."""
    expected = abs(8 * math.cos(0.5)) - abs(8 * math.sin(0.5)) - 8 * 0.3
    assert track(PaperTask(phi="sideslip"), 8.0, 0.3, 0.1, slip=0.5) == pytest.approx(expected)


def test_precise_tracking() -> None:
    task = PreciseTask(root_error=0.04, root_weight=0.5, linear_weight=2.0)
    expected = 1.0 - 0.5 * 0.5 - 2.0 * 0.01 - 0.5 * math.sin(0.1)
    assert track(task, 8.0, 0.01, -0.1) == pytest.approx(expected)
    assert track(PreciseTask(), 8.0, 1.0, 0.0) == pytest.approx(0.0)


@pytest.mark.parametrize("task", [PaperTask(), PreciseTask()])
@given(v=st.floats(0.0, 30.0), d=REAL, course=REAL)
def test_tracking_is_best_on_the_path_and_knows_no_side(
    task: TaskComponent, v: float, d: float, course: float
) -> None:
    here = track(task, v, d, course)
    assert here <= track(task, v, 0.0, 0.0) + 1e-12
    assert here == track(task, v, -d, -course)


def test_without_demonstration() -> None:
    task = PreciseTask(demonstration="none", c_track=2.0)
    assert combine(task, 0.7, 0.3, 0.1, 0.9) == pytest.approx((1.4, 2.0, 0.0))


def test_fixed_coefficients() -> None:
    task = PaperTask(demonstration="fixed", c_track=2.0, c_diff=3.0)
    assert combine(task, 5.0, 0.3, 0.3, 0.5)[0] == pytest.approx(10.0 - 3.0 * 0.5 * 0.04)


def test_steering_change_costs() -> None:
    task = PaperTask(demonstration="none", c_change=10.0)
    assert combine(task, 0.0, 0.3, 0.1, 0.0)[0] == pytest.approx(-5.0 * 0.04)


@given(
    r=st.floats(-20.0, 20.0), steer=REAL, demo=REAL, e_t=st.floats(0.1, 5), e_d=st.floats(0.1, 5)
)
def test_adaptive_coefficients(r: float, steer: float, demo: float, e_t: float, e_d: float) -> None:
    task = PaperTask(demonstration="adaptive", c_track=e_t, c_diff=e_d)
    total, c_track, c_diff = combine(task, r, steer, steer, demo)
    r_diff = 0.5 * (demo - steer) ** 2
    raw = e_t * sigmoid(r), e_d * sigmoid(r_diff)
    assert c_track == pytest.approx(raw[0] / sum(raw))
    assert c_track + c_diff == pytest.approx(1.0)
    assert total == pytest.approx(c_track * r - c_diff * r_diff)


def test_normalisation_brings_both_terms_to_size_one() -> None:
    task = PaperTask(demonstration="adaptive", normalise=True, v_ref=10.0)
    total, c_track, _ = combine(task, 10.0, 0.1, 0.1, 0.2)
    assert c_track == pytest.approx(0.5)
    assert total == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("x", [-1e4, -750.0, 0.0, 750.0, 1e4])
def test_sigmoid_does_not_overflow(x: float) -> None:
    value: Any = kernel.sigmoid(x)
    assert 0.0 <= value <= 1.0
    assert value == kernel.sigmoid.py_func(x)
