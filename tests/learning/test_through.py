"""Agents that set a controller's parameters: bounds, periods, and that the base stays itself."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman import presets
from steersman.config import components, dump, resolve
from steersman.contracts.scenes import CAR, DT
from steersman.controllers.adaptive import Adaptive
from steersman.controllers.adjustment import Adjuster, Adjustment, adjustments
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_pid import Mpc
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError
from steersman.kernels import vehicle as car
from steersman.kernels import world
from steersman.learning.config import load_preset, train_config
from steersman.learning.fleet import FleetDriver
from steersman.learning.train import train
from steersman.learning.validate import Validator
from steersman.policy_file import read_policy
from steersman.types import Status

from ..loops import Posed, drive, random_policy, scenes
from .problems import TINY, problem, tiny

THROUGH: dict[str, Any] = {
    "action": "parameters",
    "base": {"kind": "mpc", "horizon": 8},
    "parameters": {"p": "0.1..100:log", "r": "1e-3..1:log", "horizon": "4|8|12"},
    "demonstration": {"controller": {"kind": "mpc", "horizon": 12, "r": 0.5}},
}
PID: dict[str, Any] = {
    "action": "parameters",
    "base": {"kind": "pid"},
    "parameters": {"gains": {"k_p": "0.02..0.5:log"}, "k_heading": "0..1"},
    "demonstration": {"controller": {"kind": "pid", "k_heading": 0.5}},
    "period": 5,
}


def through(**changes: Any) -> Any:
    """Cars without any spread, which start where the road begins."""
    still = {"offset": 0.0, "heading": 0.0, "mass": 0.0, "delay": 0.0}
    road = {"roads": [{"kind": "random_road", "seed": 3}], "start": "start_area", "spread": still}
    speed = {"speeds": [{"kind": "constant_speed", "speed": 8.0}], "corridor": 50.0}
    return problem(**{**THROUGH, **road, **speed, **changes})


def executed(task: Any, actions: Any) -> Any:
    """Steering of one car at each control step."""
    driver = FleetDriver(task, 1)
    driver.reset(0)
    return np.array([driver.fleet.executed[0] for a in actions for _ in driver.steps(a[None])])


# ---------------------------------------------------------------------------------- the action


@pytest.mark.parametrize(
    ("base", "name", "span"),
    [
        ("mpc", "r", "1e-3..1:log"),
        ("mpc", "q", "0.5..2"),
        ("mpc", "horizon", "5..40"),
        ("mpc", "horizon", "5..40:log"),
        ("mpc", "horizon", "10|20|40"),
        ("pid", "gains.k_p", "0.01..1:log"),
        ("mpc", "model_error", ({"c_f": 0.5}, {}, {"c_r": 0.5})),
    ],
)
def test_an_action_is_a_value_within_bounds_and_back(base: str, name: str, span: Any) -> None:
    (made,) = adjustments(controller(base), {name: span})
    values = [made.value(a) for a in np.linspace(-1.3, 1.3, 41).tolist()]
    for value in values:
        again = made.value(made.action(with_field(controller(base), name, value)))
        assert again == (pytest.approx(value) if isinstance(value, float) else value)
    ends = (values[0], values[-1])
    if made.choices:
        assert ends == (made.choices[0], made.choices[-1])
    else:
        assert ends == (made.span.low, made.span.high)
        assert values == sorted(values)
        assert {type(v) for v in values} == {int if name == "horizon" else float}


def controller(word: Any) -> ControllerComponent:
    found = resolve("controller", word)
    assert isinstance(found, ControllerComponent)
    return found


def with_field(base: ControllerComponent, name: str, value: Any) -> ControllerComponent:
    fields = dump(base) or {}
    *outer, last = name.split(".")
    inner = fields
    for part in outer:
        inner = inner[part]
    inner[last] = dump(value) if hasattr(value, "model_dump") else value
    return controller(fields)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parameters": {}}, "name it as base and its fields as parameters"),
        ({"base": None}, "name it as base"),
        ({"action": "rate", "base": None}, "parameters: belongs to action parameters"),
        ({"parameters": {"hroizon": "4|8"}}, r"parameters\.hroizon.*did you mean 'horizon'"),
        ({"parameters": {"horizon": "0..8"}}, r"parameters\.horizon"),
        ({"parameters": {"r": "1..0"}}, r"parameters\.r: .*must be less than"),
        ({"parameters": {"r": "-1..1:log"}}, r"parameters\.r: .*above 0"),
        ({"parameters": {"r": "often"}}, r"parameters\.r: .*LOW\.\.HIGH"),
        ({"parameters": {"corridor": "0.1..1"}}, r"parameters\.corridor: is None in the base"),
        (
            {"demonstration": {"controller": "pid"}},
            "'pid' has other parameters than",
        ),
        ({"prices": {"horzion": 0.1}}, r"prices\.horzion: is no parameter; did you mean 'horizon'"),
        ({"base": "policy", "parameters": {"trim": "0..1"}}, "a policy cannot be the base"),
    ],
)
def test_what_does_not_go_together_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        problem(**{**THROUGH, **changes})


def test_a_dataset_cannot_keep_actions_that_hold() -> None:
    with pytest.raises(ConfigError, match=r"keep: .*problem\.period=1"):
        tiny(problem=PID, keep=True)


# --------------------------------------------------------------------------- the base drives


def test_under_its_own_parameters_the_base_drives() -> None:
    task = through()
    own = np.array([each.action(task.base) for each in task.adjustments()])
    alone = drive(task.base, task.roads[0], duration=3.0, corridor=50.0)["steer_command"]
    assert np.allclose(executed(task, [own] * 60), alone, atol=1e-12)
    far = executed(task, [np.array([-1.0, 1.0, -1.0])] * 60)
    assert abs(far - alone).max() > 0.001


def test_the_demonstrated_action_has_the_demonstrators_parameters() -> None:
    task = through()
    driver = FleetDriver(task, 2)
    shown = driver.demonstrated_actions()
    assert shown.shape == (2, 3)
    values = [each.value(a) for each, a in zip(task.adjustments(), shown[1], strict=True)]
    assert values == pytest.approx([task.demonstration.controller.p, 0.5, 12])


def test_without_a_demonstrator_its_kind_does_not_matter() -> None:
    driver = FleetDriver(through(demonstration={"enabled": False, "controller": "pid"}), 1)
    driver.reset(0)
    driver.step(np.zeros((1, 3)))
    assert driver.fleet.clock[0, 0] == 1.0


def test_an_action_holds_for_its_period() -> None:
    """One action held for four steps is the same action given four times, reward included."""
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 3))
    held, given = through(period=4), through()
    assert np.array_equal(executed(held, actions), executed(given, np.repeat(actions, 4, axis=0)))
    one, many = FleetDriver(held, 1), FleetDriver(given, 1)
    one.reset(0), many.reset(0)
    rewards = []
    for _ in range(4):
        many.step(actions[:1])
        rewards.append(many.fleet.reward[0, 0])
    one.step(actions[:1])
    assert one.fleet.reward[0, 0] == pytest.approx(np.mean(rewards))


def test_a_parameter_may_have_a_price() -> None:
    """A horizon costs computing, as in Bohn et al.: so much for each step of it."""
    free, paid = (FleetDriver(through(prices=p), 1) for p in ({}, {"horizon": 0.01}))
    free.reset(0), paid.reset(0)
    for action, horizon in ((-1.0, 4), (1.0, 12)):
        for driver in (free, paid):
            driver.step(np.array([[0.0, 0.0, action]]))
        cost = free.fleet.reward[0, 0] - paid.fleet.reward[0, 0]
        assert cost == pytest.approx(0.01 * horizon)


def test_a_car_that_has_left_the_road_waits_for_the_end_of_the_period() -> None:
    driver = FleetDriver(through(period=20, corridor=0.5), 2)
    driver.reset(0), driver.reset(1)
    driver.fleet.state[1, car.PSI] += 0.7
    driver.step(np.zeros((2, 3)))
    steps = driver.fleet.clock[:, 0]
    assert 0 < steps[1] < steps[0] == 20
    assert driver.fleet.ended.tolist() == [world.RUNNING, world.LEFT_CORRIDOR]


def test_validation_judges_every_control_step() -> None:
    config = tiny().validation
    scores = [
        Validator(through(period=period), config).score(lambda f: np.zeros((len(f), 3)))
        for period in (1, 7)
    ]
    assert scores[0] == scores[1]


MANY = {
    "mpc_pid": {"r": "0.01..10:log", "horizon": "5..30", "gains.k_p": "0.01..1:log"},
    "mpc_delay": {
        "q_heading": "0.01..10:log",
        "horizon": "5|20",
        "model_error.friction": "0.3..1.5",
    },
    "nmpc": {"r_change": "0.1..1000:log", "horizon": "5..20", "model_error.c_f": "0.5|1.0|1.5"},
    "lqr": {"r": "0.01..10:log"},
    "stanley": {"gain": "0.2..5:log"},
    "estimated": {"controller.r": "0.01..10:log"},
}


@pytest.mark.parametrize("kind", MANY)
def test_any_controller_drives_on_under_changing_parameters(kind: str) -> None:
    assert kind in components("controller")
    base = controller(kind)
    adjuster = Adjuster(base, adjustments(base, MANY[kind]), CAR, DT)
    rng, now = np.random.default_rng(0), adjuster.begin()
    for seen in list(scenes(Posed()))[:20]:
        now = adjuster.adjust(now, rng.uniform(-1.0, 1.0, len(MANY[kind])))
        decision, now = now.step(seen)
        now = now.executed(decision.steer)
        assert abs(decision.steer) <= 1.0
        assert decision.status is not Status.FALLBACK


def test_every_parameter_of_a_preset_changes_the_steering() -> None:
    trees = {name: load_preset(name) for name in presets.names()}
    trees = {name: tree for name, tree in trees.items() if "parameters" in tree["problem"]}
    assert len(trees) > 4
    for name, tree in trees.items():
        task = train_config(tree).problem
        assert task.base is not None
        chosen = task.adjustments()
        adjuster = Adjuster(task.base, chosen, CAR, DT)
        for i in range(len(chosen)):
            drives = []
            for end in (-1.0, 1.0):
                now, steer = adjuster.begin(), []
                action = np.array([each.action(task.base) for each in chosen])
                action[i] = end
                for seen in scenes(Posed(), 0.05):
                    decision, now = adjuster.adjust(now, action).step(seen)
                    steer.append(decision.steer)
                drives.append(steer)
            assert not np.allclose(*drives, atol=1e-9), (name, chosen[i].name)


def test_what_was_learned_while_driving_stays() -> None:
    """The integral of a PID under other gains, and the solver's last plan."""
    base = controller("pid")
    adjuster = Adjuster(base, adjustments(base, {"gains.k_i": "0.001..0.1:log"}), CAR, DT)
    now = adjuster.begin()
    for seen in list(scenes(Posed()))[:5]:
        _, now = now.step(seen)
    other = adjuster.adjust(now, np.array([0.7]))
    assert other.state == now.state
    assert other.controller.gains.k_i != base.gains.k_i  # type: ignore[attr-defined]


class Unsolved(Mpc):
    """Finds no solution for an r above one."""

    def init(self, vehicle: Any, dt: float) -> Any:
        if self.r > 1.0:
            raise np.linalg.LinAlgError("no stabilising solution")
        return super().init(vehicle, dt)


def test_parameters_without_a_solution_leave_the_former_ones() -> None:
    base = Unsolved(r=0.5)
    made = Adjustment("r", adjustments(Mpc(), {"r": "0.1..10:log"})[0].span)
    adjuster = Adjuster(base, (made,), CAR, DT)
    now = adjuster.begin()
    assert adjuster.adjust(now, np.array([1.0])) is now
    assert adjuster.adjust(now, np.array([np.nan])) is now
    assert adjuster.adjust(now, np.array([-1.0])).controller.r == pytest.approx(0.1)  # type: ignore[attr-defined]


# ------------------------------------------------------------------------ export and training


@pytest.mark.parametrize("period", [1, 3])
def test_the_exported_policy_drives_as_in_training(period: int, tmp_path: FilePath) -> None:
    task = through(period=period)
    file = random_policy(tmp_path, tiny(problem=dump(task)))
    alone = drive(Policy(file=str(file)), task.roads[0], duration=3.0, corridor=50.0)
    driver, net = FleetDriver(task, 1), Policy(file=str(file)).init(CAR, DT).run
    driver.reset(0)
    steer: list[float] = []
    while len(steer) < 60:
        seen = driver.fleet.inputs / driver.lesson.scale  # the network scales by itself
        for _ in driver.steps(net(seen.astype(np.float32))[None]):
            steer.append(driver.fleet.executed[0])
    assert np.allclose(alone["steer_command"], steer[:60], atol=1e-5)


def test_adaptive_needs_a_policy_that_sets_parameters(tmp_path: FilePath) -> None:
    file = str(random_policy(tmp_path, tiny(problem=PID)))
    other = {"kind": "pid", "gains": {"k_d": 0.02}}
    drives = [
        drive(controller(words), problem(**PID).roads[0], duration=1.0)["steer_command"]
        for words in (file, {"kind": "adaptive", "file": file},
                      {"kind": "adaptive", "file": file, "base": other})
    ]  # fmt: skip
    assert np.array_equal(drives[0], drives[1])
    assert not np.array_equal(drives[0], drives[2])
    with pytest.raises(ConfigError, match=r"'stanley' is given, but .* sets parameters of 'pid'"):
        Adaptive(file=file, base="stanley").init(CAR, DT)
    with pytest.raises(ConfigError, match=r"its action is 'rate'.*action=parameters"):
        Adaptive(file="precision").init(CAR, DT)


@pytest.mark.parametrize("kind", ["ddpg", "td3", "sac", "ppo"])
def test_every_agent_learns_parameters(kind: str, tmp_path: FilePath) -> None:
    agent = {"kind": kind, "hidden": [8, 8], "batch": 16, "vehicles": 2}
    agent |= {"n_steps": 32} if kind == "ppo" else {"learning_starts": 32, "updates": 1}
    share = {"p_action": {"kind": "constant", "at": 0.0 if kind == "ppo" else 0.5}}
    task = {**PID, "demonstration": {**PID["demonstration"], **share}}
    interval = {**TINY["validation"], "interval": 64}
    config = tiny(problem=task, agent=agent, validation=interval, steps=128, checkpoint_interval=64)
    whole = train(config, tmp_path / "whole")
    first, last = whole.rows[0], whole.rows[-1]
    assert (first.steps, last.steps) == (0, 128)
    assert kind == "ppo" or 0.3 < last.demo_share < 0.7
    train(config, tmp_path / "parts", until=64)
    again = train(config, tmp_path / "parts", resume=True)
    assert again.policy.read_bytes() == whole.policy.read_bytes()
    card = read_policy(whole.policy)[1]
    assert card.parameters == {"gains.k_p": "0.02..0.5:log", "k_heading": "0..1"}
    assert (card.action, card.period, card.actions) == ("parameters", 5, 2)
