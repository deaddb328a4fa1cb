"""DDPG of Stable-Baselines3 with a demonstrator beside it.

One seam and one replacement, both tested: ``_sample_action`` chooses the executed action (and so
the stored one), ``train`` does the same updates as SB3's with less overhead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import DDPG
from stable_baselines3.common.noise import ActionNoise

from steersman.errors import DataError
from steersman.learning import updates
from steersman.learning.config import TrainConfig
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.residual import start_at_zero
from steersman.learning.snapshot import Tree, fill
from steersman.learning.vec_env import PathFollowingVecEnv

# A policy's action beyond this is at its limit.
_AT_LIMIT = 0.99
# What SB3 and this module count; the rest of an agent's state are arrays and generators.
_COUNTERS = (
    "num_timesteps",
    "_n_updates",
    "_episode_num",
    "_current_progress_remaining",
    "demonstrated_steps",
    "saturated_steps",
    "sampled_steps",
    "last_losses",
)


class DemonstratedDDPG(DDPG):
    """DDPG whose demonstrator sometimes takes the wheel.

    Attributes:
        p_action: probability of the extra action as a function of nothing (reads the schedule).
        mirror: learn from mirror images in half of each batch.
        store_agent: keep the agent's own action in the buffer instead of the executed one.
        rate: learning rate as a function of the environment steps at an update.
    """

    p_action: Callable[[], float] = staticmethod(lambda: 0.0)
    rate: Callable[[float], float] | None = None
    store_agent = False
    mirror = False
    _nets: Any = None
    demonstrated_steps = 0
    saturated_steps = 0
    sampled_steps = 0
    last_losses: tuple[float, float, float] = (float("nan"),) * 3

    def prepare_demonstration(
        self, p_action: Callable[[], float], *, store_agent: bool, seed: int
    ) -> None:
        """Set who acts; to be called before learning."""
        self.p_action, self.store_agent = p_action, store_agent
        self.demo_rng = np.random.default_rng(seed)

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[Any, Any]:
        """Executed and stored action, each (n_envs, 1); the demonstrator acts with p_action."""
        own = self._own_action(learning_starts, action_noise, n_envs)
        self.sampled_steps += n_envs
        takes = self.demo_rng.random(n_envs) < self.p_action()
        if not takes.any():
            return own, own
        executed = own.copy()
        executed[takes, 0] = cast(PathFollowingVecEnv, self.env).demonstrated_actions()[takes]
        self.demonstrated_steps += int(takes.sum())
        return executed, own if self.store_agent else executed

    def _own_action(
        self, learning_starts: int, action_noise: ActionNoise | None, n_envs: int
    ) -> Any:
        """The agent's action with exploration noise, (n_envs, 1); random before learning.

        As SB3's, without its detour through torch at every step.
        """
        if self.num_timesteps < learning_starts or action_noise is None:
            return super()._sample_action(learning_starts, action_noise, n_envs)[1]
        action = self.act(self._last_obs)[:, None]
        # Without the noise, which takes every other action off the limit that a policy is stuck at.
        self.saturated_steps += int((np.abs(action) >= _AT_LIMIT).sum())
        return np.clip(action + action_noise(), -1.0, 1.0).astype(np.float32)

    def _compile(self) -> None:
        """Lay the weights of all four networks flat, so that the compiled update shares them."""
        nets = (self.actor, self.critic, self.actor_target, self.critic_target)
        self._nets = tuple(_flatten(net) for net in nets)
        actor, critic = self._nets[:2]
        self.moments = (
            updates.make_moments(actor.flat.size),
            updates.make_moments(critic.flat.size),
        )
        self._work = updates.make_work(self.batch_size, *self._nets[:2])
        buffer = self.replay_buffer
        assert buffer is not None
        self._arrays = updates.Batch(
            buffer.observations,
            buffer.next_observations,
            buffer.actions,
            buffer.rewards,
            buffer.dones,
            buffer.timeouts,
        )
        self._mirror = self._mirror_factors()

    def _mirror_factors(self) -> Any:
        if self.mirror:
            return cast(PathFollowingVecEnv, self.env).mirror.astype(np.float32)
        return np.ones(self.observation_space.shape or (), np.float32)

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """The updates of SB3's TD3.train for DDPG's settings, compiled (see ``updates``).

        Samples are drawn as SB3's buffer draws them, so the same seed trains on the same batches.
        """
        if self._nets is None:
            self._compile()
        buffer = self.replay_buffer
        assert buffer is not None
        size = buffer.buffer_size if buffer.full else buffer.pos
        rows = np.empty((gradient_steps, batch_size), np.int64)
        envs = np.empty((gradient_steps, batch_size), np.int64)
        for k in range(gradient_steps):
            rows[k] = np.random.randint(0, size, size=batch_size)  # noqa: NPY002 - SB3's generator
            envs[k] = np.random.randint(0, high=self.n_envs, size=(batch_size,))  # noqa: NPY002
        sides = np.ones(rows.shape, np.float32)
        if self.mirror:
            coins = np.random.randint(0, 2, size=rows.shape)  # noqa: NPY002 - SB3's generator
            sides[coins == 0] = -1.0
        rates = np.array([self._rate_at(k, gradient_steps) for k in range(gradient_steps)])
        self.last_losses = updates.update(
            self._arrays,
            updates.Draw(rows, envs, sides, self._mirror),
            rates,
            self._nets,
            self.moments,
            self.gamma,
            self.tau,
            self._work,
        )
        self._n_updates += gradient_steps

    def _rate_at(self, k: int, gradient_steps: int) -> float:
        """Learning rate of an update; updates are spread evenly over the steps collected."""
        if self.rate is None:
            return float(self.lr_schedule(self._current_progress_remaining))
        return self.rate(self.num_timesteps - self.n_envs * (1.0 - (k + 1) / gradient_steps))

    def act(self, features: Any) -> Any:
        """The policy's actions (n,) for features (n, k), without noise."""
        if self._nets is None:
            self._compile()
        return updates.act(self._nets[0], features)

    def actor_net(self) -> updates.Net:
        """The actor's weights."""
        if self._nets is None:
            self._compile()
        return cast(updates.Net, self._nets[0])

    def current_rate(self) -> float:
        """Learning rate of the next update."""
        return self._rate_at(0, 1)

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, flat."""
        if self._nets is None:
            self._compile()
        names = ("actor", "critic", "actor_target", "critic_target")
        out = {name: net.flat for name, net in zip(names, self._nets, strict=True)}
        for name, m in zip(names, self.moments, strict=False):
            out |= {f"{name}_first": m.first, f"{name}_second": m.second, f"{name}_count": m.count}
        return out

    def _stored(self, size: int) -> dict[str, Any]:
        """The filled part of the replay buffer."""
        return {name: getattr(self.replay_buffer, name)[:size] for name in updates.Batch._fields}

    def _generators(self) -> dict[str, Any]:
        """Noise's, demonstrator's, and that of the random actions before learning."""
        noise = cast(OrnsteinUhlenbeck, self.action_noise)
        return {
            "noise": noise.rng.bit_generator,
            "demonstrator": self.demo_rng.bit_generator,
            "actions": self.action_space.np_random.bit_generator,
        }

    def snapshot(self) -> dict[str, Any]:
        """All that changes from step to step, the environment apart; taken between two steps."""
        buffer = self.replay_buffer
        assert buffer is not None
        size = buffer.buffer_size if buffer.full else buffer.pos
        return {
            "weights": self.weights(),
            "buffer": {"position": buffer.pos, "full": buffer.full, "size": size}
            | self._stored(size),
            "noise": cast(OrnsteinUhlenbeck, self.action_noise).state,
            "generators": {name: bits.state for name, bits in self._generators().items()},
            "counters": {name: getattr(self, name) for name in _COUNTERS},
            "observation": self._last_obs,
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        buffer, kept = self.replay_buffer, saved["buffer"]
        assert buffer is not None
        if not 0 <= kept["size"] <= buffer.buffer_size:
            raise DataError(f"the replay buffer holds {buffer.buffer_size} rows")
        fill(self.weights(), saved["weights"])
        fill(self._stored(kept["size"]), kept)
        buffer.pos, buffer.full = kept["position"], kept["full"]
        cast(OrnsteinUhlenbeck, self.action_noise).state = saved["noise"]
        for name, bits in self._generators().items():
            bits.state = saved["generators"][name]
        for name in _COUNTERS:
            setattr(self, name, saved["counters"][name])
        self._last_obs = saved["observation"]


def make_agent(config: TrainConfig, env: PathFollowingVecEnv) -> DemonstratedDDPG:
    """The agent of a training configuration."""
    settings, demo, total = config.agent, config.problem.demonstration, config.steps
    seeds = np.random.SeedSequence(config.seed).generate_state(3)
    agent: DemonstratedDDPG

    def sigma() -> float:
        return settings.noise.value(agent.num_timesteps, total)

    def p_action() -> float:
        return demo.p_action.value(agent.num_timesteps, total) if demo.enabled else 0.0

    agent = DemonstratedDDPG(
        "MlpPolicy",
        env,
        learning_rate=settings.learning_rate.value(0, total),
        buffer_size=settings.buffer,
        batch_size=settings.batch,
        gamma=settings.gamma,
        tau=settings.tau,
        train_freq=1,
        gradient_steps=settings.updates,
        learning_starts=settings.learning_starts,
        action_noise=OrnsteinUhlenbeck(
            env.num_envs, settings.noise_theta, sigma, settings.noise_dt, int(seeds[0])
        ),
        policy_kwargs={"net_arch": list(settings.hidden)},
        seed=int(seeds[1] % 2**31),
        device="cpu",
    )
    if config.problem.base is not None:
        start_at_zero(agent.policy)
    agent.mirror = settings.mirror
    agent.rate = lambda step: settings.learning_rate.value(step, total)
    agent.prepare_demonstration(p_action, store_agent=demo.store == "agent", seed=int(seeds[2]))
    return agent


def _flatten(module: Any) -> updates.Net:
    """Make a module's parameters views of one flat array, and return that array's views."""
    parameters = list(module.parameters())
    flat = torch.cat([p.data.reshape(-1) for p in parameters])
    at = 0
    for p in parameters:
        p.data = flat[at : at + p.numel()].view(p.shape)
        at += p.numel()
    shapes = [tuple(p.shape) for p in parameters[::2]]
    return updates.view_net(flat.numpy(), (shapes[0][1], shapes[0][0], shapes[1][0], shapes[2][0]))
