"""Joint actions: steering and a share of the wished speed, through the whole chain."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.config import build
from steersman.controllers.base import ControllerComponent
from steersman.controllers.pid import Pid
from steersman.controllers.policy import Policy
from steersman.controllers.supervisor import Supervisor
from steersman.encoding import FeatureList
from steersman.errors import ConfigError
from steersman.kernels import speed as kernel
from steersman.kernels import vehicle as car
from steersman.kernels.vehicle import GRAVITY
from steersman.learning.config import TrainConfig
from steersman.learning.demonstration import Demonstration
from steersman.learning.export import export_policy
from steersman.learning.fleet import FleetDriver
from steersman.learning.train import train
from steersman.learning.validate import _mean_reward
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.paths.analytic import Circle
from steersman.policy_file import read_policy
from steersman.profiles import stack_profiles
from steersman.rollout import RunConfig, attempt
from steersman.speed import ConstantSpeed, ConstantThrottle, Nedc
from steersman.types import Driver, FloatArray, Observation, Status

from ..loops import CAR, DT, Posed, drive, random_net, scenes
from .problems import problem, tiny

STILL = {"offset": 0.0, "heading": 0.0, "mass": 0.0, "delay": 0.0}
UNSHOWN: dict[str, Any] = {"demonstration": {"enabled": False}}
CIRCLE = {"kind": "circle", "radius": 40.0}
SLIPPERY = {"kind": "grip_speed", "inner": "pid", "friction": 0.15}


def alone(**changes: Any) -> Any:
    """One car without any spread on a circle, where 8 m/s are wished."""
    return problem(
        roads=[CIRCLE], start="start_area", spread=STILL, corridor=50.0,
        speeds=[{"kind": "constant_speed", "speed": 8.0}],
        demonstration={"controller": "pid"}, **changes,
    )  # fmt: skip


def driven(task: Any, actions: FloatArray) -> tuple[FleetDriver, FloatArray]:
    """States (steps, columns) of the first car under actions (steps, cars, m)."""
    driver = FleetDriver(task, actions.shape[1])
    driver.seed(1)
    for i in range(driver.n):
        driver.reset(i)
    states = []
    for row in actions:
        driver.step(row)
        states.append(driver.fleet.state[0].copy())
    return driver, np.array(states)


def steering(steps: int, share: float) -> FloatArray:
    steer = np.random.default_rng(0).uniform(-0.1, 0.1, (steps, 1))
    return np.stack([steer, np.full_like(steer, share)], axis=2)


# ------------------------------------------------------------------------------- configuration


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint": True, "speeds": ["constant_throttle"]}, "constant_throttle wishes no speed"),
        ({"encoding": FeatureList(features=("speed_error",))}, "speed_error needs the wished"),
        ({"task": {"kind": "precise", "terms": ["comfort"]}}, "comfort needs the wished speed"),
        (
            {
                "joint": True, "action": "parameters", "base": "pid",
                "parameters": {"k_heading": "0.2..3"}, "demonstration": {"enabled": False},
            },
            "whose base drives as fast as wished",
        ),
        (
            {"action": "residual", "base": "grip_speed", "demonstration": {"enabled": False}},
            "'grip_speed' limits the speed, which this policy would not",
        ),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        problem(**changes)


def test_what_cannot_learn_or_keep_a_joint_action_says_so() -> None:
    with pytest.raises(ConfigError, match="agent apg learns one action, not 2"):
        build(TrainConfig, {"problem": {"joint": True, **UNSHOWN}, "agent": "apg"})
    with pytest.raises(ConfigError, match="hold no wished speeds"):
        tiny(problem={"joint": True}, keep=True)


# ----------------------------------------------------------------------------------- the fleet


def test_a_share_of_one_is_a_drive_without_a_choice_of_speed() -> None:
    """To the bit, for every action from 0 on."""
    actions = steering(40, 0.0)
    _, plain = driven(alone(), actions[:, :, :1])
    for share in (0.0, 0.7):
        actions[:, :, 1] = share
        assert np.array_equal(driven(alone(joint=True), actions)[1], plain)


def test_a_lower_share_is_driven_and_nothing_else_asks_for_it() -> None:
    driver, states = driven(alone(joint=True), steering(120, -0.4))
    assert driver.fleet.speed_limit[0] == pytest.approx(0.6 * 8.0)
    assert states[-1, car.VX] == pytest.approx(4.8, abs=0.1)
    assert driver.fleet.state[0, car.VX] < driver.fleet.wishes[0, 0] == 8.0
    driver.reset(0)
    assert np.isnan(driver.fleet.speed_limit[0])


def test_an_action_of_nought_is_the_speed_that_the_base_allows() -> None:
    """And 1 is the wished one, whatever the base allows."""
    task = alone(joint=True, action="residual", base=SLIPPERY)
    still = np.zeros((200, 1, 2))
    base = build(RunConfig, {"controller": SLIPPERY, "duration": 10.0}).model_copy(
        update={"path": task.roads[0], "speed": task.speeds[0]}
    )
    speeds = attempt(base).of_controller()["v_x"]
    assert driven(task, still)[1][:-1, car.VX] == pytest.approx(speeds[1:], rel=1e-12)
    assert speeds[-1] < 7.0
    assert driven(task, np.tile([0.0, 1.0], (200, 1, 1)))[1][-1, car.VX] == pytest.approx(
        8.0, abs=0.1
    )
    shown = build_demonstration({"controller": SLIPPERY})
    driver, _ = driven(task.model_copy(update={"demonstration": shown}), still[:50])
    assert driver.demonstrated_actions()[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_the_network_reads_wished_speeds_and_its_last_share() -> None:
    task = alone(joint=True, action="residual", base="pid")
    names = task.layout.names
    assert names[-1] == "base_command_less_last [-]"
    assert task.layout.mirror[names.index("speed_error [m/s]")] == 1.0
    driver, states = driven(task, steering(5, -0.25))
    scale, inputs = driver.lesson.scale, driver.fleet.inputs[0]
    found = {name: x / s for name, x, s in zip(names, inputs, scale, strict=True)}
    assert found["wished_speed_0m [m/s]"] == found["wished_speed_24m [m/s]"] == 8.0
    assert found["speed_error [m/s]"] == pytest.approx(states[-1, car.VX] - 8.0)
    assert found["last_share [-]"] == 0.75


def test_rewards_know_the_wished_speed() -> None:
    terms = ["speed_progress", "speed_error", "comfort"]
    of_terms = {"kind": "precise", "demonstration": "none", "terms": terms}
    plain = {"kind": "precise", "demonstration": "none"}
    actions = steering(30, -0.5)
    one, states = driven(alone(joint=True, task=of_terms), actions)
    other, _ = driven(alone(joint=True, task=plain), actions)
    v, a_x = np.hypot(states[-1, car.VX], states[-1, car.VY]), states[-1, car.AX]
    along = v * np.cos(one.fleet.tracking[0, 3])
    expected = (along + 1.0) / 9.0 - abs(v - 8.0) - 0.5 * (a_x / 3.0) ** 2
    assert one.fleet.reward[0, 0] - other.fleet.reward[0, 0] == pytest.approx(expected)


def test_a_demonstrated_speed_is_an_action_that_leads_there() -> None:
    shown = build_demonstration({"controller": SLIPPERY})
    task = alone(joint=True).model_copy(update={"demonstration": shown})
    env = PathFollowingVecEnv(task, 2)
    assert env.action_space.shape == (2,)
    env.reset()
    # The bend allows 5.9 m/s; where it takes all the grip, a tenth of it is left for braking.
    allowed = 8.0 - 0.4 * 0.15 * GRAVITY * DT
    actions = env.demonstrated_actions()
    assert actions[:, 1] == pytest.approx(allowed / 8.0 - 1.0, abs=2e-3)
    env.step(actions)
    limit = 8.0 * (1.0 + actions[:, 1])
    assert env.driver.fleet.speed_limit == pytest.approx(limit, rel=1e-9)


def build_demonstration(data: dict[str, Any]) -> Any:
    return build(Demonstration, data)


# --------------------------------------------------------------------------- policy and rollout


def constant_policy(folder: FilePath, share: float, **changes: Any) -> Policy:
    """A policy that gives the same two actions throughout."""
    task = alone(joint=True, **changes)
    net = random_net(len(task.layout.scale), actions=2)
    net.w3[:], net.b3[:] = 0.0, np.arctanh([0.0, share])
    return Policy(file=str(export_policy(net, TrainConfig(problem=task), folder, {})))


@pytest.mark.parametrize("base", [None, "pid", SLIPPERY], ids=["rate", "residual", "of a limit"])
def test_the_exported_policy_drives_as_in_training(base: Any, tmp_path: FilePath) -> None:
    changes = {"base": base, "action": "residual"} if base else {"action": "rate"}
    policy = constant_policy(tmp_path, -0.3, **changes)
    card = read_policy(FilePath(policy.file))[1]
    assert card.joint
    assert card.actions == 2
    task = alone(joint=True, **changes)
    run = RunConfig(controller=policy, path=task.roads[0], speed=task.speeds[0], duration=3.0)
    episode = attempt(run).of_controller()
    _, states = driven(task, np.tile(np.float32([0.0, -0.3]), (60, 1, 1)))
    # The network's share differs from -0.3 by the rounding of its tanh alone.
    assert episode["v_x"][1:] == pytest.approx(states[:-1, car.VX], abs=1e-5)
    assert episode["v_x"][-1] < 6.3


def test_a_policy_of_the_speed_needs_a_wished_one(tmp_path: FilePath) -> None:
    run = RunConfig(controller=constant_policy(tmp_path, -0.3), speed=ConstantThrottle())
    with pytest.raises(ConfigError, match="none is wished"):
        attempt(run.model_copy(update={"duration": 0.5})).of_controller()


class Slow(ControllerComponent):
    """Steers straight on and allows 3 m/s; fails after 10 steps, if it is to."""

    fails: bool = False

    def init(self, vehicle: Any, dt: float) -> int:
        return 0

    def decide(self, state: int, observation: Observation) -> tuple[float, Status, int]:
        if self.fails and state >= 10:
            raise ArithmeticError
        return 0.0, Status.SOLVED, state + 1

    def speed_limit(self, state: int) -> float:
        return 3.0


@pytest.mark.parametrize("fails", [False, True])
def test_the_limit_goes_through_a_supervisor_and_outlives_its_controller(fails: bool) -> None:
    supervisor = Supervisor(inner=Slow(fails=fails), fallback=Pid(), last=Pid(), corridor=50.0)
    state, found = supervisor.init(CAR, DT), []
    for observation in scenes(Posed())[:20]:
        decision, state = supervisor.step(state, observation)
        found.append(decision)
    assert {decision.speed_limit for decision in found} == {3.0}
    assert (found[-1].driver is Driver.INNER) is not fails


# ---------------------------------------------------------------------------- speeds and peers


@cache
def wished() -> Any:
    return stack_profiles([ConstantSpeed(speed=9.0, a_lat_max=1.0).profile()], [Circle(radius=50)])


def test_no_limit_leaves_the_pedals_as_they_are_and_a_limit_brakes() -> None:
    place = wished(), 0, Circle(radius=50).table, 0, 1.0, 2.0, 7.0, 0.1, 0.05
    assert kernel.pedals(*place) == kernel.pedals(*place, np.nan) == kernel.pedals(*place, 99.0)
    throttle, brake, _ = kernel.pedals(*place, 4.0)
    assert (throttle, brake > 0.5) == (0.0, True)
    assert kernel.pedals(*place, -1.0)[1] == kernel.pedals(*place, 0.0)[1] == 1.0


def test_wished_speeds_go_on_around_a_closed_path() -> None:
    out, circle = np.empty(5), Circle(radius=50)
    kernel.wishes(wished(), 0, circle.table, 0, 0.0, circle.length - 1.0, 2.0, out)
    assert out == pytest.approx(np.sqrt(50.0), rel=1e-3)


def test_cycle_and_observation_agree() -> None:
    """What a controller sees as wished beside it is what the speed controller tracks."""

    class Seen(Slow):
        seen: list[float]

        def decide(self, state: int, observation: Observation) -> tuple[float, Status, int]:
            self.seen.append(float(observation.wished[0]))
            return 0.0, Status.SOLVED, state + 1

        def speed_limit(self, state: int) -> float:
            return float("nan")

    controller = Seen(seen=[])
    drive(controller, Circle(radius=50), speed=Nedc(), duration=8.0, corridor=500.0)
    times, speeds = Nedc().breakpoints()
    expected = np.interp(DT * np.arange(160), times, speeds)
    assert controller.seen[-160:] == pytest.approx(expected)


# ----------------------------------------------------------------------------------- training


def test_a_training_leaves_a_policy_that_steers_and_chooses_the_speed(tmp_path: FilePath) -> None:
    task = {"joint": True, "action": "residual", "base": "pid", "demonstration": {"enabled": False}}
    terms = {"kind": "precise", "demonstration": "none", "terms": ["speed_progress"]}
    config = tiny(
        problem={**task, "task": terms}, steps=600, validation={"select": "reward", "interval": 300}
    )
    result = train(config, tmp_path)
    policy = Policy(file=str(result.policy))
    episode = drive(policy, Circle(), speed=ConstantSpeed(speed=8.0), duration=1.0, corridor=50.0)
    assert np.isfinite(episode["steer_command"]).all()
    state = policy.init(CAR, DT)
    assert state.joint
    # The first row is the base alone at the wished speed.
    assert result.rows[0].steps == 0
    assert read_policy(result.policy)[1].training["validation"]["total"] < 0.0


@pytest.mark.parametrize("lost_at", [1, 5])
def test_an_early_end_is_never_worth_it(lost_at: int) -> None:
    """Where driving costs reward, a drive that fails is worse than one that goes on."""
    driven = np.full((10, 2), -0.2)
    driven[3, 0] = -0.7
    failed = driven.copy()
    failed[lost_at:, 1] = math.nan
    assert _mean_reward(failed) < _mean_reward(driven)
    assert _mean_reward(np.full((4, 1), math.nan)) == 0.0
