"""Policies that correct a controller: who is told what, and that nothing corrected is the base."""

from __future__ import annotations

import csv
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import pytest

from steersman.config import components, dump
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_delay import MpcDelay
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError
from steersman.kernels import world as kernel
from steersman.learning.config import TrainConfig
from steersman.learning.demonstration import demonstrated_correction
from steersman.learning.export import export_policy
from steersman.learning.fleet import FleetDriver
from steersman.learning.sb3 import start_at_base
from steersman.learning.train import train
from steersman.learning.validate import Validator
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.policy_file import read_policy
from steersman.types import Observation, Status

from ..loops import CAR, DT, Posed, answers, drive, random_net, random_policy, scenes
from .problems import RESIDUAL, problem, tiny

STILL = {"offset": 0.0, "heading": 0.0, "mass": 0.0, "delay": 0.0}


class Ears(NamedTuple):
    """What a controller was told."""

    heard: tuple[float, ...] = ()
    steps: int = 0


class Listener(ControllerComponent):
    """Commands something new at each step, and keeps what it is told."""

    name: str = ""

    def init(self, vehicle: Any, dt: float) -> Ears:
        return Ears()

    def decide(self, state: Ears, observation: Observation) -> tuple[float, Status, Ears]:
        return 0.01 * state.steps, Status.SOLVED, state._replace(steps=state.steps + 1)

    def executed(self, state: Ears, steer: float) -> Ears:
        return state._replace(heard=(*state.heard, steer))


# ------------------------------------------------------------------------------- configuration


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"action": "residual"}, "corrects a controller; name it as base"),
        ({"base": "pid"}, "action 'rate' uses no base; set action=residual"),
        ({**RESIDUAL, "base": {"kind": "policy"}}, "a policy cannot be the base"),
        ({**RESIDUAL, "base": "mpc_dleay"}, "did you mean 'mpc_delay'"),
        ({**RESIDUAL, "authority": 0.0}, "authority"),
        ({**RESIDUAL, "authority": 2.5}, "authority"),
    ],
)
def test_what_does_not_go_together_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        problem(**changes)


# --------------------------------------------------------------------------------------- fleet


@pytest.mark.parametrize("action", ["rate", "direct", "residual"])
def test_who_proposes_is_told_what_was_executed(action: str) -> None:
    """Demonstrator and base, from the second step of an episode on, each in its own state."""
    task = problem(**RESIDUAL if action == "residual" else {"action": action}, corridor=50.0)
    demonstration = task.demonstration.model_copy(update={"controller": Listener(name="another")})
    base = Listener() if action == "residual" else None
    task = task.model_copy(update={"base": base, "demonstration": demonstration})
    driver = FleetDriver(task, 3)
    driver.seed(1)
    for i in range(3):
        driver.reset(i)
    executed = []
    for row in np.random.default_rng(0).uniform(-0.2, 0.2, (20, 3)):
        driver.step(row)
        executed.append(driver.fleet.executed.copy())
    driver.reset(1)
    proposers = [p for p in (driver._corrected, driver._demonstrator) if p is not None]
    assert len(proposers) == (2 if base else 1)
    for proposer in proposers:
        heard = [proposer._states[i].heard for i in range(3)]
        assert heard[0] == tuple(row[0] for row in executed)
        assert heard[1] == ()
        assert heard[2] == tuple(row[2] for row in executed)


def test_the_action_is_added_to_the_bases_steering() -> None:
    driver = FleetDriver(problem(**RESIDUAL), 2)
    for i in range(2):
        driver.reset(i)
    for actions in np.random.default_rng(0).uniform(-1.0, 1.0, (10, 2)):
        base = driver.fleet.base.copy()
        driver.step(actions)
        assert np.array_equal(driver.fleet.executed, np.clip(base + 0.1 * actions, -1.0, 1.0))
    assert np.ptp(driver.fleet.base) > 0.0


def test_the_bases_steering_is_limited_together_with_its_correction() -> None:
    driver = FleetDriver(problem(**{**RESIDUAL, "authority": 2.0}), 1)
    driver.reset(0)
    driver.step(np.ones(1))
    assert driver.fleet.executed[0] == 1.0


@pytest.mark.parametrize("encoding", ["extended", "waypoints"])
def test_the_network_sees_the_bases_steering(encoding: str) -> None:
    """Beside the last command, also where an episode has just ended."""
    task = problem(**RESIDUAL, encoding={"kind": encoding}, episode_time=0.5, corridor=50.0)
    names = task.layout.names
    assert "last_command [-]" in names
    assert names[-1] == "base_command_less_last [-]"
    driver = FleetDriver(task, 3)
    driver.seed(2)
    for i in range(3):
        driver.reset(i)
    scale = driver.lesson.scale[-1]
    for actions in np.random.default_rng(0).uniform(-1.0, 1.0, (10, 3)):
        change = driver.fleet.base - driver.last_commands()
        assert driver.fleet.inputs[:, -1] == pytest.approx(scale * change, rel=1e-12)
        assert abs(change).min() > 0.0
        driver.step(actions)
    assert (driver.fleet.ended == kernel.TIME_UP).all()
    change = driver.fleet.base - driver.last_commands()
    assert driver.fleet.inputs[:, -1] == pytest.approx(scale * change, rel=1e-12)


def test_a_base_that_demonstrates_itself_is_asked_once() -> None:
    task = problem(**RESIDUAL, demonstration={"controller": {"kind": "mpc_delay"}})
    driver = FleetDriver(task, 2)
    assert driver._demonstrator is driver._corrected
    for i in range(2):
        driver.reset(i)
    for _ in range(5):
        driver.step(np.full(2, 0.5))
        assert np.array_equal(driver.fleet.demo, driver.fleet.base)
        assert np.array_equal(driver.demonstrated_actions(), np.zeros((2, 1)))
    other = problem(**RESIDUAL, demonstration={"controller": {"kind": "mpc_delay", "r": 0.2}})
    apart = FleetDriver(other, 1)
    assert apart._demonstrator is not apart._corrected


def test_demonstrated_correction_leads_to_the_demonstrated_steering() -> None:
    demo, base = np.array([0.2, 0.2, -0.5]), np.array([0.2, 0.15, 0.4])
    assert demonstrated_correction(demo, base, 0.1) == pytest.approx([0.0, 0.5, -1.0])
    driver = FleetDriver(problem(**{**RESIDUAL, "authority": 2.0}), 1)
    driver.reset(0)
    for _ in range(20):
        wanted = driver.fleet.demo[0]
        driver.step(driver.demonstrated_actions())
        assert driver.fleet.executed[0] == pytest.approx(wanted, abs=1e-12)


# ------------------------------------------------------------------ parity with a rollout


def alone(**changes: Any) -> Any:
    """One car without any spread on a road that is not trained on."""
    return problem(
        **RESIDUAL, roads=[{"kind": "random_road", "seed": 3}], start="start_area", spread=STILL,
        speeds=[{"kind": "constant_speed", "speed": 8.0}], corridor=50.0, **changes,
    )  # fmt: skip


def in_fleet(task: Any, action: float, share: float = 1.0) -> Any:
    driver = FleetDriver(task, 1)
    driver.base_share = share
    driver.reset(0)
    out = []
    for _ in range(60):
        driver.step(np.full(1, action))
        out.append(driver.fleet.executed[0])
    return np.array(out)


def test_without_correction_the_base_drives() -> None:
    task = alone()
    expected = drive(MpcDelay(), task.roads[0], duration=3.0, corridor=50.0)
    assert np.array_equal(expected["steer_command"], in_fleet(task, 0.0))


@pytest.mark.parametrize(("bias", "share"), [(0.0, 1.0), (0.3, 1.0), (-2.0, 0.5), (0.3, 0.0)])
def test_the_exported_policy_corrects_as_in_training(
    bias: float, share: float, tmp_path: FilePath
) -> None:
    """With one and the same correction throughout, so that no network's rounding matters."""
    task = alone()
    net = random_net(len(task.layout.scale))
    net.w3[:], net.b3[:] = 0.0, bias
    config = TrainConfig(problem=task)
    file = export_policy(net, config, tmp_path, {}, base_share=share)
    policy = Policy(file=str(file))
    action = policy.init(CAR, DT).run(np.zeros((1, len(net.w1[0])), np.float32))
    episode = drive(policy, task.roads[0], duration=3.0, corridor=50.0)
    assert np.array_equal(episode["steer_command"], in_fleet(task, action, share))
    assert abs(action - np.tanh(bias)) < 1e-6


# ------------------------------------------------------------------------------ exported policy


class Failing(Listener):
    """A base that does not get on."""

    def decide(self, state: Ears, observation: Observation) -> tuple[float, Status, Ears]:
        return 0.9, Status.FALLBACK, state


def corrected(folder: FilePath, base: ControllerComponent) -> tuple[Policy, Any]:
    """A random policy around another base, and its first state."""
    config = tiny(problem={**RESIDUAL, "authority": 0.3})
    policy = Policy(file=str(random_policy(folder, config)))
    state = policy.init(CAR, DT)
    return policy, state._replace(base=base, base_state=base.init(CAR, DT))


def test_the_card_names_base_and_authority(tmp_path: FilePath) -> None:
    base = {"kind": "mpc_delay", "r": 0.2}
    file = random_policy(tmp_path, tiny(problem={**RESIDUAL, "base": base}))
    _, card = read_policy(file)
    assert card.base == dump(MpcDelay(r=0.2))
    assert (card.action, card.authority, card.rate_limit) == ("residual", 0.1, None)
    state = Policy(file=str(file)).init(CAR, DT)
    assert (state.base, state.authority) == (MpcDelay(r=0.2), 0.1)


def test_a_fallback_of_the_base_is_passed_on(tmp_path: FilePath) -> None:
    policy, state = corrected(tmp_path, Failing())
    decisions = answers(policy, scenes(Posed()), state)
    assert {decision.status for decision in decisions} == {Status.FALLBACK}
    assert all(abs(decision.steer - 0.9) <= 0.3 for decision in decisions)
    assert max(decision.steer for decision in decisions) <= 1.0


def test_the_base_is_told_what_is_executed(tmp_path: FilePath) -> None:
    policy, state = corrected(tmp_path, Listener())
    steers = []
    for observation in scenes(Posed()):
        decision, state = policy.step(state, observation)
        steers.append(decision.steer)
    assert state.base_state.heard == tuple(steers)
    assert policy.executed(state, 0.123).base_state.heard[-1] == 0.123
    assert max(map(abs, np.diff(steers))) > 0.01


# ----------------------------------------------------------------------------------- training


def test_a_fresh_agent_is_its_base() -> None:
    config = tiny(problem=RESIDUAL)
    agent = config.agent.make(config, PathFollowingVecEnv(config.problem, 4))
    seen = np.random.default_rng(0).normal(size=(20, agent.observation_space.shape[0]))
    assert not agent.act(seen).any()
    assert not agent.weights()["actor_target"][-1]
    agent.learn(400)
    assert agent._n_updates > 0
    assert abs(agent.act(seen)).min() > 0.0


@pytest.mark.parametrize("name", ["DDPG", "TD3", "SAC", "PPO"])
def test_every_kind_of_agent_can_begin_at_zero(name: str) -> None:
    import stable_baselines3 as sb3
    import torch
    from gymnasium import spaces

    box = spaces.Box(-1.0, 1.0, (7,)), spaces.Box(-1.0, 1.0, (1,))
    cls = getattr(sb3, name)
    policy = cls.policy_aliases["MlpPolicy"](*box, lambda _: 1e-3)
    seen = torch.randn(20, 7)
    assert policy._predict(seen, deterministic=True).abs().max() > 0.0
    start_at_base(policy, problem(**RESIDUAL), components("agent")[name.lower()]())
    assert policy._predict(seen, deterministic=True).abs().max() == 0.0


def rows(folder: FilePath) -> list[dict[str, float]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(stream)]


def test_the_first_row_is_the_base_alone(tmp_path: FilePath) -> None:
    config = tiny(problem=RESIDUAL, steps=600)
    told: list[Any] = []
    train(config, tmp_path, told.append)
    table = rows(tmp_path)
    assert [row["steps"] for row in table] == [row.steps for row in told] == [0, 500, 600]
    assert table[0]["updates"] == 0
    without = Validator(config.problem, config.validation).score(lambda x: np.zeros(len(x)))
    assert table[0]["validation_error_mm"] == pytest.approx(1e3 * without.mean_error, rel=1e-6)
    # The policy that is kept is no worse than its base.
    kept = read_policy(tmp_path / "policy.onnx")[1].training["validation"]["total"]
    assert kept <= without.total + 1e-6


def test_a_correction_can_be_learned(tmp_path: FilePath) -> None:
    """Misaligned steering keeps a PD controller off the path."""
    base = {"kind": "pid", "gains": {"k_p": 0.1, "k_i": 0.0, "k_d": 0.05}}
    straight = [{"kind": "straight"}]
    easy: dict[str, Any] = {
        **RESIDUAL, "base": base, "demonstration": {"enabled": False},
        "task": {"kind": "precise", "demonstration": "none"},
        "vehicle": {"kind": "carla_model3", "steer_bias": 0.01},
        "roads": straight, "speeds": [{"kind": "constant_speed", "speed": 8.0}],
        "spread": {"offset": 0.3},
    }  # fmt: skip
    fast: dict[str, Any] = {
        "gamma": 0.9, "tau": 0.02, "batch": 64, "updates": 4,
        "learning_rate": {"kind": "constant", "at": 1e-3},
        "noise": {"kind": "constant", "at": 0.1},
    }  # fmt: skip
    validation = {"roads": straight, "interval": 1000, "vehicles": 4}
    train(tiny(problem=easy, agent=fast, steps=4000, validation=validation), tmp_path)
    errors = [row["validation_error_mm"] for row in rows(tmp_path)]
    assert min(errors[1:]) < 0.3 * errors[0]


# ---------------------------------------------------------------------------------- attenuation


def test_the_bases_share_fades_over_the_training(tmp_path: FilePath) -> None:
    fading = {"kind": "linear", "start": 1.0, "end": 0.2, "until": 0.5}
    config = tiny(
        problem={"action": "residual", "base": {"kind": "lqr"}, "authority": 1.0,
                 "demonstration": {"enabled": False}},
        agent={"updates": 0}, attenuation=fading, steps=400,
        validation={"interval": 200}, checkpoint_interval=100,
    )  # fmt: skip
    shares = [config.base_share(step) for step in (0, 100, 200, 400)]
    assert shares == pytest.approx([1.0, 0.6, 0.2, 0.2])
    train(config, tmp_path / "whole")
    train(config, tmp_path / "parts", until=100)
    train(config, tmp_path / "parts", resume=True)
    whole, parts = (rows(tmp_path / name) for name in ("whole", "parts"))
    errors = [[row["validation_error_mm"] for row in each] for each in (whole, parts)]
    assert errors[0] == errors[1]
    assert errors[0][0] < errors[0][1] == errors[0][2]  # a fifth of the base alone is less than it
    _, card = read_policy(tmp_path / "whole" / "policy.onnx")
    assert card.base_share == 1.0  # the first, which nothing learned afterwards


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "attenuation: there is no base to attenuate; set problem.action=residual"),
        ({"problem": RESIDUAL, "keep": True}, "attenuation: drives with a changing share cannot"),
        (
            {"problem": {**RESIDUAL, "demonstration": {"warm_start": {"data": "x"}}}},
            "attenuation: recorded data have all of the base; leave out data",
        ),
    ],
)
def test_attenuation_is_refused_where_it_cannot_be(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        tiny(**changes, attenuation={"kind": "linear"})
