"""The reward: every term against its closed form, and their sum wherever it is computed."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import steersman as sm
from steersman.config import build
from steersman.errors import ConfigError
from steersman.kernels import reward as kernel
from steersman.learning.fleet import FleetDriver
from steersman.learning.problem import Problem
from steersman.learning.rewards import FunctionTerm, Imitation, Judged, Progress, SteeringChange
from steersman.learning.task import PaperTask, PreciseTask, TaskComponent

from .problems import problem, tiny

REAL = st.floats(-3.0, 3.0)
STEERS = st.floats(-1.0, 1.0)
STILL = Judged(*[0.0] * 12, dt=0.05)


def judge(task: TaskComponent, **step: float) -> tuple[float, float, float, float]:
    """Reward, r_track, c_track, c_diff, compiled and as Python."""
    table, row = task.table(), np.array(STILL._replace(**step))
    out, again = np.empty(4), np.empty(4)
    kernel.judge(table, row, out)
    kernel.judge.py_func(table, row, again)
    assert out == pytest.approx(again, rel=1e-12)
    total, r_track, c_track, c_diff = out.tolist()
    return total, r_track, c_track, c_diff


def track(task: TaskComponent, v: float, d: float, course: float, slip: float = 0.0) -> float:
    step = {"speed": v, "lateral_error": d, "course_error": course, "side_slip": slip}
    value = judge(task, **step)[1]
    # The formula is also a plain method.
    assert value == pytest.approx(task.tracking().value(STILL._replace(**step)), rel=1e-12)
    return value


def combine(
    task: TaskComponent, speed: float, steer: float, previous: float, demo: float, d: float = 0.0
) -> tuple[float, float, float]:
    """Reward and coefficients; on the path the paper's r_track is the speed."""
    steers = {"steer": steer, "previous_steer": previous, "demonstrated_steer": demo}
    total, _, c_track, c_diff = judge(task, speed=speed, lateral_error=d, **steers)
    return total, c_track, c_diff


def sigmoid(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x))


@given(st.floats(0.0, 40.0), REAL, REAL, REAL)
def test_paper_tracking(v: float, d: float, course: float, slip: float) -> None:
    # Phi is the course error; in the paper's words the side-slip.
    for task, phi in ((PaperTask(), course), (PaperTask(phi="sideslip"), slip)):
        expected = abs(v * math.cos(phi)) - abs(v * math.sin(phi)) - v * abs(d)
        found = track(task, v, d, course, slip)
        assert found == pytest.approx(expected)
        assert found <= v + 1e-12
    assert track(PaperTask(), v, 0.0, 0.0, slip) == v


@given(REAL, REAL)
def test_precise_tracking(d: float, course: float) -> None:
    task = PreciseTask(root_error=0.04, root_weight=0.6, linear_weight=2.0)
    root = math.sqrt(min(abs(d) / 0.04, 1.0))
    expected = 1.0 - 0.6 * root - 2.0 * abs(d) - 0.5 * abs(math.sin(course))
    assert track(task, 8.0, d, course) == pytest.approx(expected)
    assert track(PreciseTask(), 8.0, 1.0, 0.0) == pytest.approx(0.0)


def test_without_a_demonstrated_steering_the_second_term_is_left_out() -> None:
    for blend in ("adaptive", "fixed"):
        task = build(PreciseTask, {"demonstration": blend})
        with_none = judge(task, speed=10.0, lateral_error=0.1, demonstrated_steer=math.nan)
        shown = judge(task, speed=10.0, lateral_error=0.1, demonstrated_steer=0.0)
        assert with_none[3] == 0.0 < shown[3]
        assert with_none[0] == pytest.approx(with_none[2] * with_none[1])


@pytest.mark.parametrize("task", [PaperTask(), PreciseTask()])
@given(v=st.floats(0.0, 30.0), d=REAL, course=REAL)
def test_tracking_is_best_on_the_path_and_knows_no_side(
    task: TaskComponent, v: float, d: float, course: float
) -> None:
    here = track(task, v, d, course)
    assert here == track(task, v, -d, -course)
    assert here <= track(task, v, 0.0, 0.0) + 1e-12
    assert track(task, v, 2.0 * d, 0.0) <= track(task, v, d, 0.0)


def test_precise_reward_asks_for_the_last_millimetre() -> None:
    # From 2 mm to 1 mm: the paper's reward gains v x 1 mm, of v; this one much more.
    def gain(task: TaskComponent) -> float:
        near, far = (track(task, 10.0, d, 0.0) for d in (1e-3, 2e-3))
        return (near - far) / track(task, 10.0, 0.0, 0.0)

    assert gain(PaperTask()) == pytest.approx(1e-3)
    assert gain(PreciseTask()) > 0.02
    # Its slope grows towards zero, as the root's does, but a reward is never infinite.
    slopes = [(track(PreciseTask(), 10.0, d, 0.0) - 1.0) / d for d in (1e-2, 1e-3, 1e-4)]
    assert slopes == sorted(slopes, reverse=True)
    # Beyond root_error the slope is the linear term's, finite everywhere.
    beyond = [track(PreciseTask(), 10.0, d, 0.0) for d in (0.5, 0.6)]
    assert beyond[0] - beyond[1] == pytest.approx(0.05)


@given(st.floats(-800.0, 800.0))
def test_sigmoid(x: float) -> None:
    found = kernel.sigmoid(x)
    assert 0.0 <= found <= 1.0
    assert found == pytest.approx(kernel.sigmoid.py_func(x))
    assert found + kernel.sigmoid(-x) == pytest.approx(1.0)
    assert found == pytest.approx(0.5 * (1.0 + math.tanh(0.5 * x)))


@given(st.floats(0.0, 40.0), STEERS, STEERS, STEERS)
def test_fixed_and_no_demonstration(
    speed: float, steer: float, previous: float, demo: float
) -> None:
    change = 1.5 * (steer - previous) ** 2
    fixed = PaperTask(demonstration="fixed", c_track=2.0, c_diff=5.0, c_change=3.0)
    expected = 2.0 * speed - 5.0 * 0.5 * (demo - steer) ** 2 - change
    assert combine(fixed, speed, steer, previous, demo) == pytest.approx((expected, 2.0, 5.0))
    alone = PaperTask(demonstration="none", c_track=2.0, c_change=3.0)
    found = combine(alone, speed, steer, previous, demo)
    assert found == pytest.approx((2.0 * speed - change, 2.0, 0.0))


@given(st.floats(-30.0, 30.0), STEERS, STEERS, st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_adaptive_coefficients(
    r: float, steer: float, demo: float, e_track: float, e_diff: float
) -> None:
    task = PaperTask(c_track=e_track, c_diff=e_diff)
    speed, d = (r, 0.0) if r >= 0.0 else (1.0, 1.0 - r)
    total, c_track, c_diff = combine(task, speed, steer, steer, demo, d)
    diff = 0.5 * (demo - steer) ** 2
    # r_diff is never negative, so its sigmoid is at least a half before the normalisation.
    weights = e_track * sigmoid(r), e_diff * sigmoid(diff)
    assert c_track == pytest.approx(weights[0] / sum(weights))
    assert c_track + c_diff == pytest.approx(1.0)
    assert total == pytest.approx(c_track * r - c_diff * diff)


def test_normalised() -> None:
    # Both terms are one: r_track / v_ref and r_diff / (0.1^2 / 2).
    task = PaperTask(normalise=True, v_ref=8.0)
    total, c_track, c_diff = combine(task, 8.0, 0.3, 0.3, 0.2)
    assert (c_track, c_diff) == pytest.approx((0.5, 0.5))
    assert total == pytest.approx(0.0, abs=1e-12)
    assert isinstance(task.tracking(), Progress)


# ------------------------------------------------------------------------------ further terms


def test_further_terms_are_added() -> None:
    step = {"speed": 8.0, "steer": 0.3, "previous_steer": 0.1, "demonstrated_steer": 0.2}
    plain = PaperTask(demonstration="none")
    terms = [SteeringChange(weight=3.0), Imitation(weight=2.0, scale=0.5)]
    more = PaperTask(demonstration="none", terms=tuple(terms))
    assert [term.kind for term in more.sum_of()][-2:] == ["steering_change", "imitation"]
    expected = -1.5 * 0.2**2 - 2.0 * 0.5 * 0.1**2 / 0.5
    assert judge(more, **step)[0] - judge(plain, **step)[0] == pytest.approx(expected)
    named = build(PaperTask, {"terms": [{"kind": "steering_change", "weight": 3.0}]})
    assert named.terms == (terms[0],)


def run(task: Any) -> tuple[Any, Any]:
    """Rewards and judged steps of some steps of one vehicle."""
    driver = FleetDriver(problem(task=task), 1)
    driver.seed(1)
    driver.reset(0)
    rewards, steps = [], []
    for k in range(30):
        driver.step(np.array([0.3 * math.sin(k)]))
        rewards.append(driver.fleet.reward[0, 0])
        steps.append(Judged(*driver.fleet.judged.tolist()))
    return np.array(rewards), steps


def test_a_python_function_is_a_term() -> None:
    def calm(step: Judged) -> float:
        return -(step.yaw_rate**2) + 0.1 * step.steer

    plain, _ = run({"kind": "precise"})
    task = PreciseTask(terms=(FunctionTerm(function=calm, weight=2.0),))
    rewards, steps = run(task)
    assert rewards - plain == pytest.approx([2.0 * calm(step) for step in steps], abs=1e-12)


def test_what_a_python_function_raises_comes_through() -> None:
    def broken(step: Judged) -> float:
        raise ZeroDivisionError("the author's mistake")

    with pytest.raises(ZeroDivisionError, match="author's mistake"):
        run(PreciseTask(terms=(FunctionTerm(function=broken),)))
    assert np.isfinite(run(PreciseTask())[0]).all()  # it is raised once


@pytest.mark.parametrize("value", [None, "0.5", [1.0, 2.0]])
def test_a_python_function_has_to_return_a_number(value: Any) -> None:
    def odd(step: Judged) -> Any:
        return value

    with pytest.raises(ConfigError, match=r"reward: the function odd returned .*number is needed"):
        run(PreciseTask(terms=(FunctionTerm(function=odd),)))


@pytest.mark.parametrize("reward", [3, [abs]])
def test_a_reward_is_one_function(reward: Any, tmp_path: FilePath) -> None:
    with pytest.raises(ConfigError, match="reward: one function is needed, not "):
        sm.train(tiny(steps=300), reward=reward, out=tmp_path / "none")


def test_a_python_function_is_not_read_from_a_file() -> None:
    given_by_name = {"task": {"terms": [{"kind": "function", "function": "calm"}]}}
    with pytest.raises(ConfigError, match=r"task\.terms.*a file cannot hold a Python function"):
        build(Problem, given_by_name)


def test_training_takes_a_python_function(tmp_path: FilePath) -> None:
    seen = []

    def calm(step: Judged) -> float:
        seen.append(step.speed)
        return -(step.yaw_rate**2)

    config = tiny(steps=300, validation={"interval": 300})
    result = sm.train(config, reward=calm, out=tmp_path / "calm")
    assert len(seen) >= 300
    assert result.policy is not None
    assert result.policy.is_file()
    with pytest.raises(ConfigError, match="a file cannot hold a Python function"):
        sm.train(str(tmp_path / "calm" / "config.yaml"), out=tmp_path / "again")
    # It goes on with the function of that name, and with no other.
    told: list[str] = []
    again = sm.train(config, reward=calm, out=tmp_path / "calm", resume=True, notify=told.append)
    assert told == [f"{tmp_path / 'calm'}: finished already"]
    assert again.policy == result.policy
    for other in (None, abs):
        with pytest.raises(ConfigError, match=r"has the Python function .*calm; go on from Python"):
            sm.train(config, reward=other, out=tmp_path / "calm", resume=True)


# --------------------------------------------------------------------------- the one sum


@pytest.mark.parametrize(
    "task",
    [
        {"kind": "paper", "c_change": 0.7, "normalise": True},
        {"kind": "precise", "c_change": 3.0, "demonstration": "none"},
        {"kind": "precise", "terms": [{"kind": "steering_change", "weight": 0.5}]},
    ],
)
def test_a_recorded_drive_earns_what_it_earned_while_driving(task: dict[str, Any]) -> None:
    driver = FleetDriver(problem(task=task), 1)
    driver.seed(3)
    driver.reset(0)
    fleet = driver.fleet
    states, tracking = [fleet.state[0].copy()], [fleet.tracking[0].copy()]
    steer, demo, rewards = [], [], []
    for k in range(40):
        demo.append(fleet.demo[0])
        driver.step(np.array([0.4 * math.sin(1.3 * k)]))
        states.append(fleet.state[0].copy())
        tracking.append(fleet.tracking[0].copy())
        steer.append(fleet.executed[0])
        rewards.append(fleet.reward[0, 0])
    given = np.array(states), np.array(tracking), np.array(steer)
    found = driver.problem.task.rewards(*given, np.array(demo), driver.dt)
    assert found.tolist() == rewards
    # Another order of commands is another reward, so the previous one takes part.
    assert np.ptp(np.diff(steer)) > 0.01
