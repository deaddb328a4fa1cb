"""Rewards against their closed forms."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.kernels import reward as kernel
from steersman.kernels.reward import RewardTable
from steersman.learning.task import PaperTask, PreciseTask

PAPER = PaperTask().table()
LETTER = PaperTask(phi="sideslip").table()
PRECISE = PreciseTask().table()

errors = st.floats(-1.5, 1.5)
angles = st.floats(-3.0, 3.0)
steers = st.floats(-1.0, 1.0)
speeds = st.floats(0.0, 40.0)


@given(speeds, errors, angles, angles)
def test_paper_reward(v: float, d: float, course: float, slip: float) -> None:
    for table, phi in ((PAPER, course), (LETTER, slip)):
        found = kernel.track_reward(table, v, d, course, slip)
        expected = abs(v * math.cos(phi)) - abs(v * math.sin(phi)) - v * abs(d)
        assert found == pytest.approx(expected)
        assert found == pytest.approx(kernel.track_reward.py_func(table, v, d, course, slip))
        assert found <= v + 1e-12
    assert kernel.track_reward(PAPER, v, 0.0, 0.0, slip) == v


@given(errors, angles)
def test_precise_reward(d: float, course: float) -> None:
    found = kernel.track_reward(PRECISE, 12.0, d, course, 0.4)
    root = math.sqrt(min(abs(d) / 0.05, 1.0))
    expected = 1.0 - 0.5 * root - 0.5 * abs(d) - 0.5 * abs(math.sin(course))
    assert found == pytest.approx(expected)
    assert found == pytest.approx(kernel.track_reward.py_func(PRECISE, 12.0, d, course, 0.4))
    assert found == kernel.track_reward(PRECISE, 12.0, -d, -course, 0.4)
    assert found <= kernel.track_reward(PRECISE, 12.0, 0.0, 0.0, 0.0) == 1.0


def test_precise_reward_asks_for_the_last_millimetre() -> None:
    # From 2 mm to 1 mm: the paper's reward gains v x 1 mm, of v; this one much more.
    def gain(table: RewardTable) -> float:
        near, far = (kernel.track_reward(table, 10.0, d, 0.0, 0.0) for d in (1e-3, 2e-3))
        return (near - far) / kernel.track_reward(table, 10.0, 0.0, 0.0, 0.0)

    assert gain(PAPER) == pytest.approx(1e-3)
    assert gain(PRECISE) > 0.02
    # Its slope grows towards zero, as the root's does, but a reward is never infinite.
    slopes = [
        (kernel.track_reward(PRECISE, 10.0, d, 0.0, 0.0) - 1.0) / d for d in (1e-2, 1e-3, 1e-4)
    ]
    assert slopes == sorted(slopes, reverse=True)
    # Beyond root_error the slope is the linear term's, finite everywhere.
    beyond = [kernel.track_reward(PRECISE, 10.0, d, 0.0, 0.0) for d in (0.5, 0.6)]
    assert beyond[0] - beyond[1] == pytest.approx(0.05)


@given(st.floats(-800.0, 800.0))
def test_sigmoid(x: float) -> None:
    found = kernel.sigmoid(x)
    assert 0.0 <= found <= 1.0
    assert found == pytest.approx(kernel.sigmoid.py_func(x))
    assert found + kernel.sigmoid(-x) == pytest.approx(1.0)
    assert found == pytest.approx(0.5 * (1.0 + math.tanh(0.5 * x)))


@given(st.floats(-40.0, 40.0), steers, steers, steers)
def test_adaptive_coefficients(track: float, steer: float, previous: float, demo: float) -> None:
    args = (PAPER, track, steer, previous, demo)
    reward, c_track, c_diff = kernel.combine(*args)
    assert (reward, c_track, c_diff) == pytest.approx(kernel.combine.py_func(*args))
    assert c_track + c_diff == pytest.approx(1.0)
    diff = 0.5 * (demo - steer) ** 2
    s_track, s_diff = kernel.sigmoid(track), kernel.sigmoid(diff)
    # r_diff is never negative, so its sigmoid is at least a half before the normalisation.
    assert s_diff >= 0.5
    assert c_diff == pytest.approx(s_diff / (s_track + s_diff))
    assert c_diff >= 1.0 / 3.0 - 1e-12
    assert reward == pytest.approx(c_track * track - c_diff * diff)


def test_emphasis_multiplies_before_the_normalisation() -> None:
    table = PaperTask(c_track=1.0, c_diff=3.0).table()
    _, c_track, c_diff = kernel.combine(table, 0.0, 0.2, 0.2, 0.2)
    assert (c_track, c_diff) == pytest.approx((0.25, 0.75))
    # Tracking that is very bad hands over to the demonstration.
    _, c_track, _ = kernel.combine(table, -30.0, 0.2, 0.2, 0.2)
    assert c_track < 1e-10


@given(st.floats(-40.0, 40.0), steers, steers, steers)
def test_fixed_and_no_demonstration(
    track: float, steer: float, previous: float, demo: float
) -> None:
    fixed = PaperTask(demonstration="fixed", c_track=2.0, c_diff=5.0, c_change=3.0).table()
    change = 1.5 * (steer - previous) ** 2
    expected = 2.0 * track - 5.0 * 0.5 * (demo - steer) ** 2 - change
    found = kernel.combine(fixed, track, steer, previous, demo)
    assert found == pytest.approx((expected, 2.0, 5.0))
    alone = PaperTask(demonstration="none", c_track=2.0, c_change=3.0).table()
    found = kernel.combine(alone, track, steer, previous, demo)
    assert found == pytest.approx((2.0 * track - change, 2.0, 0.0))


def test_normalised() -> None:
    table = PaperTask(normalise=True, v_ref=8.0).table()
    reward, c_track, c_diff = kernel.combine(table, 8.0, 0.3, 0.3, 0.2)
    # Both terms are one: r_track / v_ref and r_diff / (0.1^2 / 2).
    assert (c_track, c_diff) == pytest.approx((0.5, 0.5))
    assert reward == pytest.approx(0.0, abs=1e-12)
