"""Every learning algorithm: the demonstrator's part, the training, the exported policy."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from steersman.config import build, components, dump, read_yaml, to_yaml
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError, TrainingDiverged
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.learning.algorithms.ddpg import Ddpg
from steersman.learning.algorithms.ppo import Ppo
from steersman.learning.algorithms.sac import Sac
from steersman.learning.algorithms.td3 import Td3
from steersman.learning.arithmetic import arithmetic
from steersman.learning.config import TrainConfig, train_config
from steersman.learning.ddpg_update import CompiledDDPG
from steersman.learning.discrete import DiscreteSteering
from steersman.learning.export import network
from steersman.learning.progress import TrainRow, check_progress
from steersman.learning.train import train
from steersman.learning.validate import Validator
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.network_file import PolicyNetwork

from ..loops import Posed, drive
from .problems import SMALL, TINY
from .test_agent import Recording, half

KINDS = sorted(components("agent"))
OFF_POLICY = ["ddpg", "sac", "td3"]
# DQN, too, learns from a buffer, but executes only actions of its list.
BUFFERED = ["dqn", *OFF_POLICY]
NEVER = {"p_action": {"kind": "constant", "at": 0.0}}
# A training that is short, and looked at three times.
SHORT: dict[str, Any] = {
    "steps": 480,
    "validation": {**TINY["validation"], "interval": 160},
    "checkpoint_interval": 80,
}


def settings(kind: str, **changes: Any) -> dict[str, Any]:
    """A small agent of a kind."""
    known = components("agent")[kind].model_fields
    small = TINY["agent"] | {"learning_starts": 100}
    own = {name: value for name, value in small.items() if name in known}
    if kind == "ppo":
        own["n_steps"] = 32
    if kind == "apg":
        own["horizon"] = 16
    return {"kind": kind, **own, **changes}


def config(kind: str, problem: Any = None, agent: Any = None, **changes: Any) -> TrainConfig:
    """A small training of a kind, with a demonstrator that acts where it may."""
    demonstration = {"demonstration": half(0.2) if kind in BUFFERED else NEVER}
    tree = {"problem": {**SMALL, **demonstration, **(problem or {})}}
    return build(TrainConfig, {**TINY, **tree, "agent": settings(kind, **(agent or {})), **changes})


def learn(kind: str, steps: int = 400, **changes: Any) -> tuple[Any, Recording]:
    made = config(kind, **changes)
    env = Recording(made.problem, made.agent.vehicles)
    agent = made.agent.make(made, env)
    agent.learn(steps)
    return agent, env


def rows(folder: FilePath) -> list[dict[str, str]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


# ------------------------------------------------------------------------------------- the seam


@pytest.mark.parametrize("kind", OFF_POLICY)
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_stored_action_is_the_executed_one(kind: str, share: float) -> None:
    agent, env = learn(kind, problem={"demonstration": half(share)})
    executed = np.array(env.executed)[:, :, 0].astype(np.float32)
    buffer = agent.replay_buffer
    assert np.array_equal(buffer.actions[: buffer.pos, :, 0], executed)
    demonstrated = executed == np.array(env.proposed).astype(np.float32)
    assert demonstrated.mean() == pytest.approx(share, abs=0.1)
    assert agent.demonstrated_steps / agent.sampled_steps == pytest.approx(share, abs=0.1)


@pytest.mark.parametrize("kind", OFF_POLICY)
def test_storing_the_agents_own_action_is_an_option(kind: str) -> None:
    agent, env = learn(kind, problem={"demonstration": {**half(), "store": "agent"}})
    executed = np.array(env.executed)[:, :, 0].astype(np.float32)
    buffer = agent.replay_buffer
    differs = abs(buffer.actions[: buffer.pos, :, 0] - executed) > 1e-6
    demonstrated = executed == np.array(env.proposed).astype(np.float32)
    assert differs.mean() == pytest.approx(0.5, abs=0.1)
    assert demonstrated[differs].all()


def test_ppo_executes_what_its_policy_drew_and_keeps_it_for_one_training() -> None:
    agent, env = learn("ppo", 128)
    executed = np.array(env.executed)[:, :, 0]
    kept = agent.rollout_buffer.actions.reshape(4, 32)  # flattened vehicle by vehicle
    assert np.array_equal(np.clip(kept, -1.0, 1.0), executed.T)
    assert agent.demonstrated_steps == 0
    assert agent.sampled_steps == 128


@pytest.mark.parametrize("kind", KINDS)
def test_the_demonstration_pays_in_every_algorithm(kind: str) -> None:
    _, env = learn(kind, 200)
    assert env.driver.demonstrates
    assert (env.driver.fleet.reward[:, 3] > 0.0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_learning_rate_follows_the_steps_at_every_update(kind: str) -> None:
    line = {"kind": "linear", "start": 1e-3, "end": 0.0}
    made = config(kind, agent={"learning_rate": line}, steps=512)
    agent = made.agent.make(made, PathFollowingVecEnv(made.problem, 4))
    asked: list[float] = []
    agent.rate = lambda step: asked.append(step) or made.agent.learning_rate.value(step, 512)
    agent.learn(512)
    collected = {"ppo": 128, "apg": 64}.get(kind, 4)
    assert asked == sorted(asked)
    assert asked[-1] == 512
    assert np.diff(asked).max() < collected + 1
    assert agent.current_rate() == pytest.approx(0.0)
    if kind == "ppo":
        assert agent.policy.optimizer.param_groups[0]["lr"] == pytest.approx(0.0)
        passes, batches = made.agent.n_epochs, 128 // made.agent.batch
        assert asked[: passes * batches] == pytest.approx(
            128.0 * np.arange(1, passes * batches + 1) / (passes * batches)
        )


# ------------------------------------------------------------------------------- mirror images


@pytest.mark.parametrize("kind", BUFFERED)
def test_half_of_each_batch_is_mirrored(kind: str) -> None:
    agent, env = learn(kind, 40, agent={"mirror": True})
    factors = agent.mirror
    assert np.array_equal(factors, env.mirror)
    assert set(factors) == {-1.0, 1.0}
    plain, _ = learn(kind, 40)
    assert plain.mirror is None
    sides = {made: mirrored(made) for made in (agent, plain)}
    assert sides[agent].mean() == pytest.approx(0.5, abs=0.05)
    assert not sides[plain].any()


def mirrored(agent: Any) -> Any:
    """Which transitions of 20 batches are mirror images, by the sign of their actions."""
    buffer = agent.replay_buffer
    buffer.actions[:] = 0.5
    if isinstance(agent, CompiledDDPG):
        return buffer.draw(20, 100).sides < 0.0
    batches = [buffer.sample(100) for _ in range(20)]
    if isinstance(agent, DiscreteSteering):
        levels = torch.from_numpy(agent.levels)
        batches = [each._replace(actions=levels[each.actions]) for each in batches]
    for batch in batches:
        factors = 1.0 if agent.mirror is None else np.where(batch.actions < 0, agent.mirror, 1.0)
        seen = batch.observations.numpy() * factors
        kept = buffer.observations[: buffer.pos].reshape(-1, seen.shape[1])
        assert (seen[:, None, :] == kept).all(axis=2).any(axis=1).all()
    return np.concatenate([batch.actions.numpy() < 0.0 for batch in batches])


# -------------------------------------------------------------------------------- configuration


def test_a_configuration_that_names_no_algorithm_means_ddpg() -> None:
    assert train_config({}).agent == Ddpg()
    kept = train_config({"agent": {"gamma": 0.9}}).agent
    assert kept == Ddpg(gamma=0.9)
    assert dump(kept) == {"kind": "ddpg", **kept.model_dump(mode="json")}


@pytest.mark.parametrize("kind", KINDS)
def test_configurations_read_back(kind: str, tmp_path: FilePath) -> None:
    (tmp_path / "c.yaml").write_text(to_yaml(config(kind)), encoding="utf-8")
    assert train_config(read_yaml(tmp_path / "c.yaml")) == config(kind)


@pytest.mark.parametrize(
    ("agent", "message"),
    [
        ({"kind": "ddpg", "policy_delay": 2}, "policy_delay: is an option of td3, not of ddpg"),
        ({"kind": "td3", "ent_coef": 0.1}, "agent.ent_coef: is an option of ppo, sac, not of td3"),
        ({"kind": "sac", "noise_dt": 0.1}, "agent.noise_dt: is an option of ddpg, td3, not of sac"),
        ({"kind": "ppo", "mirror": True}, "mirror: is an option of .*, td3, not of ppo"),
        ({"kind": "ppo", "updates": 1}, "agent.updates: is an option of .*, not of ppo"),
        ({"policy_delay": 2}, "policy_delay: is an option of td3, not of ddpg"),
        ({"kind": "td3", "polcy_delay": 2}, "agent.polcy_delay: unknown .* mean 'policy_delay'"),
        ({"kind": "dpg"}, "agent: unknown agent 'dpg'; did you mean 'ddpg'"),
        ({"kind": "ppo", "batch": 100}, "agent.batch: 100 does not divide .* = 2048"),
        ({"kind": "sac", "ent_coef": 0.1, "target_entropy": -2.0}, "belongs to ent_coef: auto"),
        ({"kind": "dqn", "actions": [0.5, 0.1]}, "agent.actions: .* each above the last"),
        ({"kind": "dqn", "actions": [-1, 0, 2]}, "agent.actions: at least two numbers in"),
        ({"kind": "dqn", "mirror": True, "actions": [-1, 0.5]}, "actions: the mirror image of"),
        ({"kind": "sac", "ent_coef": 0.0}, "agent.ent_coef: 0.0 is not allowed; must be greater"),
    ],
)  # fmt: skip
def test_what_an_algorithm_does_not_know_is_refused(agent: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        train_config({"agent": agent, "problem": {"demonstration": NEVER}})


@pytest.mark.parametrize(
    "p_action",
    [{"kind": "constant", "at": 0.01}, {"kind": "linear", "start": 0.5, "end": 0.0, "until": 0.01}],
)
def test_ppo_refuses_the_extra_action(p_action: dict[str, Any]) -> None:
    given = {"agent": "ppo", "problem": {"demonstration": {"p_action": p_action}}}
    with pytest.raises(ConfigError, match=r"^problem\.demonstration\.p_action: ppo .* at: 0}$"):
        train_config(given)
    for off in (NEVER, {"enabled": False}):
        assert train_config({**given, "problem": {"demonstration": off}}).agent == Ppo()


def test_sacs_coefficient_of_the_entropy() -> None:
    """Learned from a given start towards a given entropy, or fixed."""
    agent, _ = learn("sac", 100, agent={"ent_coef_start": 0.5, "target_entropy": -2.0})
    assert float(agent.log_ent_coef.exp().detach()) == pytest.approx(0.5)
    assert agent.target_entropy == -2.0
    agent, _ = learn("sac", 400, agent={"ent_coef": 0.25})
    assert agent.weights()["ent_coef_tensor"] == pytest.approx(0.25)
    assert Sac().target_entropy is None


# ----------------------------------------------------------------------------- the whole training


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> dict[str, FilePath]:
    """A small training of each kind."""
    out = {}
    for kind in KINDS:
        out[kind] = tmp_path_factory.mktemp(kind)
        train(config(kind, **SHORT), out[kind])
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_writes_its_record(kind: str, trained: dict[str, FilePath]) -> None:
    table = rows(trained[kind])
    assert list(table[0]) == [name for name in TrainRow._fields if name != "seconds"]
    assert [float(row["steps"]) for row in table[:3]] == [160.0, 320.0, 480.0]
    for row in table:
        empty = {name for name, value in row.items() if math.isnan(float(value))}
        assert empty == (set() if kind in BUFFERED else {"demo_share"})
    if kind in BUFFERED:
        assert float(table[1]["demo_share"]) == pytest.approx(0.2, abs=0.08)
    assert list((trained[kind] / "tensorboard").glob("events.*"))


@pytest.mark.parametrize("kind", KINDS)
def test_card_and_policy(kind: str, trained: dict[str, FilePath]) -> None:
    card = json.loads((trained[kind] / "policy.json").read_text(encoding="utf-8"))
    assert train_config(card["training"]["config"]) == config(kind, **SHORT)
    policy = Policy(file=str(trained[kind] / "policy.onnx"))
    assert len(drive(policy, Posed(), duration=1.0)) > 10


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3, 1e12])
def test_exported_network_is_sb3s_deterministic_action(
    kind: str, activation: str, size: float
) -> None:
    own = {"activation": activation} if kind == "ppo" else {}
    made = config(kind, agent=own)
    agent = made.agent.make(made, PathFollowingVecEnv(made.problem, 4))
    agent.actor_net().flat[:] *= 2.5  # so that the answer is no plain zero, and meets its limits
    agent.actor_net().b3[:] += 0.3
    scale = made.problem.layout.scale
    run = PolicyNetwork(
        network(agent.actor_net(), scale, made.agent.operators, made.agent.levels),
        "policy.onnx",
        len(scale),
    )
    raw = size * np.random.default_rng(0).normal(size=(40, len(scale)))
    inputs = np.clip(raw * scale, -FEATURE_LIMIT, FEATURE_LIMIT).astype(np.float32)
    expected = agent.predict(inputs, deterministic=True)[0]
    answers = [run(row[None, :].astype(np.float32)) for row in raw]
    assert np.array(answers) == pytest.approx(expected, abs=3e-5)
    assert agent.act(inputs) == pytest.approx(expected, abs=3e-5)
    # Of a list, all small inputs have the same action.
    assert np.std(expected) > 1e-5 or (made.agent.levels and size < 1.0)
    assert abs(expected).max() <= 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_policy(kind: str, trained: dict[str, FilePath], tmp_path: FilePath) -> None:
    train(config(kind, **SHORT), tmp_path / "again")
    train(config(kind, **{**SHORT, "steps": 160}, seed=1), tmp_path / "other")
    again, other = ((tmp_path / name / "policy.onnx").read_bytes() for name in ("again", "other"))
    assert again == (trained[kind] / "policy.onnx").read_bytes() != other
    assert rows(tmp_path / "again") == rows(trained[kind])


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "apg"])  # refuses a base
def test_corrects_a_controller_and_averages_its_weights(kind: str, tmp_path: FilePath) -> None:
    """What surrounds training asks for nothing that only DDPG has."""
    residual = {"action": "residual", "base": {"kind": "pid"}}
    given = config(kind, problem=residual, steps=512, average=0.25)
    agent = given.agent.make(given, PathFollowingVecEnv(given.problem, 4))
    seen = np.random.default_rng(0).normal(size=(9, *agent.observation_space.shape))
    assert not agent.act(seen).any()
    train(given, tmp_path)
    assert [float(row["steps"]) for row in rows(tmp_path)][:2] == [0.0, 500.0]
    assert len(drive(Policy(file=str(tmp_path / "policy.onnx")), Posed(), duration=1.0)) > 10


LEARNING: dict[str, dict[str, Any]] = {
    "ddpg": {},
    "td3": {},
    "sac": {"learning_rate": {"kind": "constant", "at": 1e-3}},
    "ppo": {"learning_rate": {"kind": "constant", "at": 1e-3}, "n_steps": 64, "batch": 64},
    "apg": {},
    "dqn": {"learning_rate": {"kind": "constant", "at": 1e-3}},
}


@pytest.mark.parametrize("kind", KINDS)
def test_learns_to_follow_a_circle(kind: str, tmp_path: FilePath) -> None:
    """Beside the untrained network, the best one stays nearer to the road."""
    easy = {
        "roads": [{"kind": "circle", "radius": 60.0}],
        "speeds": [{"kind": "constant_speed", "speed": 6.0}],
        "action": "direct",
    }
    agent = {"hidden": [32, 32], "gamma": 0.9, **LEARNING[kind]}
    steps = {"apg": 4096, "ppo": 1536}.get(kind, 1024)
    given = config(kind, problem=easy, agent=agent, steps=steps)
    env = PathFollowingVecEnv(given.problem, 4)
    validator = Validator(given.problem, given.validation)
    with arithmetic(1):
        before = validator.score(given.agent.make(given, env).act).mean_error
    train(given, tmp_path)
    card = json.loads((tmp_path / "policy.json").read_text(encoding="utf-8"))
    assert card["training"]["validation"]["mean_error"] < 0.7 * before


# ------------------------------------------------------------------------------- exact resume

# What can carry state: noise on waypoints and cars, an MPC with a rate limit, schedules in the
# middle of their fall, a small buffer that overflows.
CARRIES: dict[str, Any] = {
    "sensor": {"error_range": 0.05},
    "episode_time": 2.0,
}


def carrying(kind: str) -> TrainConfig:
    mpc = {"kind": "mpc_pid", "rate_limit": True, "horizon": 8}
    act = {"p_action": {"kind": "linear", "start": 0.5, "end": 0.0}}
    acts = act if kind in BUFFERED else NEVER
    agent: dict[str, Any] = {} if kind == "ppo" else {"mirror": True}
    if kind in BUFFERED:
        agent["buffer"] = 300
    return config(
        kind,
        problem={**CARRIES, "demonstration": {"controller": mpc, **acts}},
        agent=agent | ({"n_steps": 16} if kind == "ppo" else {}),
        **SHORT,
    )


class Stopped(Exception):
    """Stands for whatever ends a process."""


def assert_same(folder: FilePath, whole: FilePath) -> None:
    assert (folder / "policy.onnx").read_bytes() == (whole / "policy.onnx").read_bytes()
    assert rows(folder) == rows(whole)
    (last,) = {max(f.glob("checkpoints/*.npz")).name for f in (folder, whole)}
    ours, theirs = (dict(np.load(f / "checkpoints" / last)) for f in (folder, whole))
    assert set(ours) == set(theirs)
    assert all(np.array_equal(ours[name], theirs[name]) for name in ours)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, FilePath]:
    """Trainings that nothing stopped."""
    out = {kind: tmp_path_factory.mktemp(kind) for kind in KINDS}
    for kind, folder in out.items():
        train(carrying(kind), folder)
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_stopped_and_resumed_is_uninterrupted(
    kind: str, whole: dict[str, FilePath], tmp_path: FilePath
) -> None:
    for at in (160, 320):

        def stop(row: Any, at: int = at) -> None:
            if row.steps >= at:
                raise Stopped

        with pytest.raises(Stopped):
            train(carrying(kind), tmp_path, stop, resume=True)
    told: list[str] = []
    train(carrying(kind), tmp_path, resume=True, notify=told.append)
    assert "going on after" in told[0]
    assert_same(tmp_path, whole[kind])


def test_a_training_from_before_there_were_others_resumes(
    whole: dict[str, FilePath], tmp_path: FilePath
) -> None:
    """Its config.yaml names no algorithm."""

    def stop(row: Any) -> None:
        raise Stopped

    with pytest.raises(Stopped):
        train(carrying("ddpg"), tmp_path, stop)
    file = tmp_path / "config.yaml"
    text = file.read_text(encoding="utf-8")
    assert text.count("  kind: ddpg\n") == 1
    file.write_text(text.replace("  kind: ddpg\n", ""), encoding="utf-8")
    train(train_config(read_yaml(file)), tmp_path, resume=True)
    assert_same(tmp_path, whole["ddpg"])


# --------------------------------------------------------------------------------------- alarms


@pytest.mark.parametrize("kind", KINDS)
def test_a_training_that_diverges_says_so(kind: str, tmp_path: FilePath) -> None:
    wild = {"learning_rate": {"kind": "constant", "at": 1e12}}
    if kind in OFF_POLICY:
        wild["updates"] = 4
    with pytest.raises(TrainingDiverged) as caught:
        train(config(kind, agent=wild, **{**SHORT, "steps": 4000}), tmp_path)
    assert "\n" not in str(caught.value)
    assert rows(tmp_path)
    assert torch.distributions.Distribution._validate_args  # as it was before


def test_parameters_may_stay_at_a_bound_but_steering_may_not() -> None:
    row = TrainRow(updates=9.0, actor_loss=0.1, critic_loss=0.1, q_mean=0.0, saturated_share=1.0)
    given: Any = SimpleNamespace(agent=Ddpg(), problem=SimpleNamespace(action="parameters"))
    given.validation = SimpleNamespace(interval=10)
    check_progress(given, [row] * 3, 1.0)
    given.problem.action = "residual"
    with pytest.raises(TrainingDiverged, match="sat at a limit"):
        check_progress(given, [row] * 3, 1.0)


def test_td3s_actor_has_no_loss_before_its_turn() -> None:
    row = TrainRow(updates=2.0, critic_loss=0.1, q_mean=0.0, saturated_share=0.0)
    given: Any = SimpleNamespace(agent=Td3(policy_delay=3), validation=None)
    check_progress(given, [row], 1.0)
    with pytest.raises(TrainingDiverged, match="not finite"):
        check_progress(given, [row._replace(updates=3.0)], 1.0)
