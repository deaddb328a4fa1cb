"""The seam in Stable-Baselines3: exploration noise, executed and stored actions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.learning.ddpg_update import CompiledDDPG
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.vec_env import PathFollowingVecEnv

from .problems import tiny


class Recording(PathFollowingVecEnv):
    """Keeps what was executed, and what the demonstrator would have done."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.executed: list[Any] = []
        self.proposed: list[Any] = []

    def step_async(self, actions: Any) -> None:
        self.executed.append(np.array(actions))
        self.proposed.append(self.demonstrated_actions()[:, 0])
        super().step_async(actions)


def learn(steps: int = 400, **demonstration: Any) -> tuple[CompiledDDPG, Recording]:
    config = tiny(problem={"demonstration": demonstration})
    env = Recording(config.problem, config.agent.vehicles)
    agent = config.agent.make(config, env)
    agent.learn(steps)
    return agent, env


def stored(agent: CompiledDDPG) -> Any:
    buffer = agent.replay_buffer
    assert buffer is not None
    return buffer.actions[: buffer.pos, :, 0]


def half(at: float = 0.5) -> dict[str, Any]:
    return {"p_action": {"kind": "constant", "at": at}}


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_stored_action_is_the_executed_one(share: float) -> None:
    agent, env = learn(**half(share))
    executed = np.array(env.executed)[:, :, 0].astype(np.float32)
    assert np.array_equal(stored(agent), executed)
    demonstrated = executed == np.array(env.proposed).astype(np.float32)
    assert demonstrated.mean() == pytest.approx(share, abs=0.1)
    assert agent.demonstrated_steps / agent.sampled_steps == pytest.approx(share, abs=0.1)


def test_storing_the_agents_own_action_is_an_option() -> None:
    agent, env = learn(**half(), store="agent")
    executed = np.array(env.executed)[:, :, 0].astype(np.float32)
    differs = abs(stored(agent) - executed) > 1e-6
    demonstrated = executed == np.array(env.proposed).astype(np.float32)
    assert differs.mean() == pytest.approx(0.5, abs=0.1)
    assert demonstrated[differs].all()


def test_demonstrator_switched_off_never_acts() -> None:
    agent, env = learn(100, enabled=False, **half())
    assert agent.demonstrated_steps == 0
    assert not env.driver.demonstrates


@pytest.mark.parametrize(("bias", "share"), [(50.0, 1.0), (-50.0, 1.0), (0.0, 0.0)])
def test_a_policy_at_its_limit_is_seen_through_the_noise(bias: float, share: float) -> None:
    """As after a collapse: noise takes the executed action off the limit half of the time."""
    noise = {"kind": "constant", "at": 0.3}
    config = tiny(agent={"learning_starts": 0, "updates": 0, "noise": noise})
    agent = config.agent.make(config, PathFollowingVecEnv(config.problem, config.agent.vehicles))
    net = agent.actor_net()
    net.w3[:], net.b3[:] = 0.0, bias
    agent.learn(400)
    executed = stored(agent)
    assert (abs(executed) < 1.0).mean() > 0.2
    assert agent.saturated_steps / agent.sampled_steps == pytest.approx(share, abs=0.05)


def test_executed_rate_is_within_its_limit() -> None:
    _, env = learn(**half())
    assert max(abs(np.array(env.executed)).max(), abs(np.array(env.proposed)).max()) <= 1.0


def test_buffer_holds_the_end_of_an_episode_not_the_next_ones_start() -> None:
    agent, _ = learn(800, **half())
    buffer = agent.replay_buffer
    assert buffer is not None
    n = buffer.pos - 1
    joined = (buffer.next_observations[:n] == buffer.observations[1 : n + 1]).all(axis=2)
    done = buffer.dones[:n] > 0.0
    assert done.any()
    assert joined[~done].all()
    assert not joined[done].any()


def test_schedules_follow_the_steps() -> None:
    config = tiny(
        problem={"demonstration": {"p_action": {"kind": "linear", "start": 1.0, "end": 0.0}}},
        agent={"learning_rate": {"kind": "linear", "start": 1e-3, "end": 0.0}},
        steps=400,
    )
    agent = config.agent.make(config, PathFollowingVecEnv(config.problem, 4))
    assert agent.p_action() == 1.0
    assert agent.current_rate() == pytest.approx(1e-3)
    agent.num_timesteps = 200
    assert agent.p_action() == pytest.approx(0.5)
    assert agent.current_rate() == pytest.approx(5e-4)
    agent.num_timesteps = 400
    assert agent.p_action() == 0.0


def noise(n: int, theta: float, dt: float, sigma: float = 0.2, seed: int = 0) -> OrnsteinUhlenbeck:
    return OrnsteinUhlenbeck((n, 1), theta, lambda: sigma, dt, seed)


@pytest.mark.parametrize(("theta", "dt"), [(0.15, 1.0), (0.15, 0.1), (0.5, 1.0)])
def test_noise_is_stationary_as_the_formula_says(theta: float, dt: float) -> None:
    """x' = (1 - theta dt) x + sigma sqrt(dt) N: variance and correlation in closed form."""
    source = noise(4000, theta, dt)
    keep = 1.0 - theta * dt
    for _ in range(int(8 / (theta * dt))):
        before = source()[:, 0]
    after = source()[:, 0]
    variance = 0.2**2 * dt / (1.0 - keep**2)
    assert after.mean() == pytest.approx(0.0, abs=5 * (variance / 4000) ** 0.5)
    assert after.var() == pytest.approx(variance, rel=0.1)
    assert np.corrcoef(before, after)[0, 1] == pytest.approx(keep, abs=0.05)


def test_noise_restarts_for_the_vehicles_named() -> None:
    source = noise(3, 0.15, 1.0)
    source()
    kept = source.state.copy()
    source.reset(indices=[1])
    assert source.state[1] == 0.0
    assert np.array_equal(source.state[[0, 2]], kept[[0, 2]])
    source.reset()
    assert (source.state == 0.0).all()


def test_noise_is_that_of_its_seed() -> None:
    first, again, other = (noise(2, 0.15, 1.0, seed=s) for s in (1, 1, 2))
    a, b, c = first(), again(), other()
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_without_sigma_there_is_no_noise() -> None:
    assert (noise(3, 0.15, 1.0, sigma=0.0)() == 0.0).all()
