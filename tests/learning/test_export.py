"""The exported network answers as the agent does, and drives without torch."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.controllers.policy import Policy
from steersman.kernels.compiled import COMPILING
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.learning.config import TrainConfig
from steersman.learning.export import export_policy, network
from steersman.learning.vec_env import PathFollowingVecEnv
from steersman.network_file import PolicyNetwork

from ..loops import Posed, drive, random_net, random_policy
from .problems import problem, tiny


@pytest.mark.parametrize("size", [0.0, 1e-3, 1.0, 1e3, 1e12, 1e38])
def test_network_is_the_agents(size: float) -> None:
    config = tiny()
    agent = config.agent.make(config, PathFollowingVecEnv(config.problem, 4))
    # Larger weights than the fresh ones, so that the answer is no plain zero.
    agent.actor_net().flat[:] *= 4.0
    scale = config.problem.layout.scale
    run = PolicyNetwork(network(agent.actor_net(), scale), "policy.onnx", len(scale))
    raw = size * np.random.default_rng(0).normal(size=(40, len(scale)))
    with np.errstate(over="ignore"):
        single = raw.astype(np.float32)
    inputs = np.clip(raw * scale, -FEATURE_LIMIT, FEATURE_LIMIT)
    expected = agent.act(inputs)
    answers = [run(row[None, :]) for row in single]
    assert np.array(answers) == pytest.approx(expected, abs=1e-5)
    assert size == 0.0 or np.std(expected) > 1e-4


@pytest.mark.parametrize("action", ["rate", "direct", "residual"])
def test_controller_drives_as_the_environment_does(action: str, tmp_path: FilePath) -> None:
    """The exported policy in a rollout, and the agent's network in the environment, agree."""
    road = {"kind": "random_road", "seed": 3}
    task = problem(
        action=action, base="mpc_delay" if action == "residual" else None, roads=[road],
        start="start_area",
        speeds=[{"kind": "constant_speed", "speed": 8.0}],
        spread={"offset": 0.0, "heading": 0.0, "mass": 0.0, "delay": 0.0}, corridor=50.0,
    )  # fmt: skip
    config = TrainConfig(problem=task)
    env = PathFollowingVecEnv(task, 1)
    net = random_net(env.observation_space.shape[0])
    net.flat[:] *= 0.3
    file = export_policy(net, config, tmp_path, {})
    episode = drive(Policy(file=str(file)), task.roads[0], duration=3.0, corridor=50.0)
    inputs, executed = env.reset(), []
    for _ in range(len(episode)):
        h1 = np.maximum(inputs @ net.w1.T + net.b1, 0.0)
        h2 = np.maximum(h1 @ net.w2.T + net.b2, 0.0)
        inputs, *_ = env.step(np.tanh(h2 @ net.w3.T + net.b3))
        executed.append(env.driver.fleet.executed[0])
    assert len(episode) == 60
    assert episode["steer_command"] == pytest.approx(np.array(executed), abs=1e-5)


def test_drives_without_torch(tmp_path: FilePath) -> None:
    file = random_policy(tmp_path)
    code = f"""
import sys
from steersman.rollout import RunConfig, run
from steersman.config import build
fields = {{"controller": {{"kind": "policy", "file": {str(file)!r}}}, "duration": 1.0}}
episode = run(build(RunConfig, fields))
assert len(episode) > 0
print([name for name in ("torch", "stable_baselines3", "onnx", "pickle5") if name in sys.modules])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120
    )
    assert set(done.stderr.splitlines()) <= {COMPILING}  # where nothing was driven before
    assert done.stdout.strip() == "[]"


def test_same_network_same_bytes() -> None:
    net, scale = random_net(5), np.ones(5)
    assert network(net, scale) == network(net, scale)


def test_policies_of_both_actions_know_their_limit(tmp_path: FilePath) -> None:
    for action, step in (("rate", 1.5708 * 0.05), ("direct", 0.0)):
        file = random_policy(tmp_path / action, TrainConfig(problem=problem(action=action)))
        state = Policy(file=str(file)).init(problem().vehicle, 0.05)
        assert state.rate_step == pytest.approx(step)


def test_indirect_policy_keeps_its_rate(tmp_path: FilePath) -> None:
    episode = drive(Policy(file=str(random_policy(tmp_path))), Posed(), duration=3.0)
    assert abs(np.diff(episode["steer_command"])).max() <= 1.5708 * 0.05 + 1e-12
