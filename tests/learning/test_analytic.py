"""Analytic gradients: a stretch of driving and the way back through it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.config import build
from steersman.errors import ConfigError
from steersman.kernels import world as kernel
from steersman.learning.algorithms.apg import Apg
from steersman.learning.config import train_config
from steersman.learning.fleet import FleetDriver
from steersman.learning.problem import Problem
from steersman.learning.tape import Recorded
from steersman.learning.vec_env import PathFollowingVecEnv

STEPS, CARS = 12, 3
# The pedals are data to the way back, so that only a held throttle leaves nothing out.
SMALL: dict[str, Any] = {
    "encoding": {"kind": "extended", "history": 3, "waypoints": 2},
    "task": {
        "kind": "precise",
        "demonstration": "none",
        "c_change": 20.0,
        "root_weight": 0.0,
        "terms": ["log_error"],
    },
    "demonstration": {"enabled": False},
    "roads": [{"kind": "random_road", "seed": 3}],
    "speeds": [{"kind": "constant_throttle", "throttle": 0.4}],
    "spread": {"offset": 0.3, "heading": 0.05, "mass": 0.2, "stiffness": 0.3, "delay": 0.12},
}


def drive(problem: Problem, weights: Any, *, keep: bool) -> tuple[Any, Any]:
    """A stretch with a = tanh(features . weights); what was kept of it, and the rewards."""
    driver = FleetDriver(problem, CARS)
    driver.seed(1)
    for i in range(CARS):
        driver.reset(i)
    recorded = Recorded(driver, STEPS) if keep else None
    rewards = np.zeros((STEPS, CARS))
    for t in range(STEPS):
        if recorded is not None:
            recorded.before(t)
        actions = np.tanh(driver.fleet.inputs @ weights)
        driver.step(actions)
        rewards[t] = driver.fleet.reward[:, 0]
        if recorded is not None:
            recorded.after(t, actions)
        for i in np.flatnonzero(driver.fleet.ended != kernel.RUNNING).tolist():
            driver.reset(i)
    return recorded, rewards


@pytest.mark.parametrize(
    "change",
    [
        pytest.param({}, id="rate"),
        pytest.param({"action": "direct"}, id="direct"),
        pytest.param({"sensor": {"kind": "waypoints", "latency": 0.1}}, id="latency"),
        pytest.param({"episode_time": 0.3}, id="drives that end on the way"),
        pytest.param({"task": {"kind": "paper", "demonstration": "none"}}, id="paper's reward"),
        pytest.param({"encoding": "waypoints"}, id="waypoints"),
    ],
)
def test_the_gradient_by_the_policys_weights_is_that_of_differences(change: Any) -> None:
    problem = build(Problem, SMALL | change)
    rng = np.random.default_rng(0)
    size = len(problem.layout.scale)
    weights = rng.normal(size=size) * 0.02
    recorded, _ = drive(problem, weights, keep=True)
    prices = rng.normal(size=(STEPS, CARS))
    gradient = np.zeros(size)

    def through(t: int, by_action: Any) -> Any:
        inputs = recorded.inputs[t]
        by_sum = by_action * (1.0 - np.tanh(inputs @ weights) ** 2)
        gradient[:] += by_sum @ inputs
        return by_sum[:, None] * weights

    recorded.pull(prices, np.zeros_like(recorded.inputs), through)
    wanted = np.zeros(size)
    for j in range(size):
        ends = []
        for h in (1e-6, -1e-6):
            moved = weights.copy()
            moved[j] += h
            ends.append((drive(problem, moved, keep=False)[1] * prices).sum())
        wanted[j] = (ends[0] - ends[1]) / 2e-6
    assert np.abs(gradient - wanted).max() < 1e-5 * np.abs(wanted).max()


@pytest.mark.parametrize("throttle", [0.4, 1.0])
def test_steps_with_derivatives_are_those_without_to_the_bit(throttle: float) -> None:
    speeds = [{"kind": "constant_throttle", "throttle": throttle}]
    problem = build(Problem, SMALL | {"speeds": speeds, "episode_time": 0.4})
    weights = np.full(len(problem.layout.scale), 0.02)
    kept, plain = (drive(problem, weights, keep=keep)[1] for keep in (True, False))
    assert np.isfinite(plain).all()
    assert np.array_equal(kept, plain)


def test_what_follows_the_last_step_enters_by_its_inputs() -> None:
    problem = build(Problem, SMALL)
    size = len(problem.layout.scale)
    weights = np.full(size, 0.01)
    recorded, _ = drive(problem, weights, keep=True)
    values = np.random.default_rng(1).normal(size=(CARS, size))
    ends = np.zeros_like(recorded.inputs)
    ends[-1] = values
    nothing = np.zeros((CARS, size))
    slopes = recorded.pull(np.zeros((STEPS, CARS)), ends, lambda t, by: nothing.copy())

    def value(change: float) -> float:
        driver = FleetDriver(problem, CARS)
        driver.seed(1)
        for i in range(CARS):
            driver.reset(i)
        for t in range(STEPS):
            driver.step(recorded.tape.actions[t] + (change if t == 4 else 0.0))
        return float((values * driver.fleet.inputs).sum())

    wanted = (value(1e-6) - value(-1e-6)) / 2e-6
    assert slopes[4].sum() == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("critic", [False, True])
def test_some_turns_lower_the_price(critic: bool) -> None:
    own = {"kind": "apg", "critic": critic, "gamma": 0.95, "vehicles": 32, "hidden": (32, 32)}
    own |= {"horizon": 20, "learning_rate": {"kind": "constant", "at": 5e-3}}
    problem = SMALL | {"spread": {"offset": 0.3, "heading": 0.05}}
    config = train_config({"problem": problem, "agent": own, "steps": 100_000})
    agent: Any = config.agent.make(config, PathFollowingVecEnv(config.problem, 32))
    prices = []
    for _ in range(45):
        agent.learn(640, reset_num_timesteps=False)
        prices.append(agent.last_losses[0])
    # At first the cars leave the road; the least there is is about -0.64.
    assert min(prices[:5]) > 2.0
    assert np.mean(prices[-5:]) < -0.3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"plant": "multibody"}, "'multibody' has no derivatives"),
        ({"action": "residual", "base": "lqr"}, "a base controller has no derivatives"),
    ],
)
def test_what_has_no_derivatives_is_refused(change: Any, said: str) -> None:
    driver = FleetDriver(build(Problem, SMALL | change), 1)
    with pytest.raises(ConfigError, match=said):
        Recorded(driver, 2)


def test_a_plain_function_has_no_derivative() -> None:
    config = train_config({"problem": SMALL, "agent": "apg"}).rewarded(lambda step: -step.v_x)
    with pytest.raises(ConfigError, match="plain Python function, which has no derivative"):
        config.problem.task.slopes()


def test_the_demonstrator_cannot_act() -> None:
    with pytest.raises(ConfigError, match="apg learns only from actions that its own policy"):
        train_config({"agent": Apg()})
