"""The seam in Stable-Baselines3: who acts, and what is stored of it.

One class for every algorithm that learns from a replay buffer; :mod:`~steersman.learning.agent`,
``td3`` and ``sac`` put it before Stable-Baselines3's.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from steersman.errors import DataError
from steersman.learning import updates
from steersman.learning.algorithms import Deterministic, OffPolicy
from steersman.learning.config import TrainConfig
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.residual import start_at_zero
from steersman.learning.snapshot import Tree, fill
from steersman.learning.vec_env import PathFollowingVecEnv

A = TypeVar("A", bound="Demonstrated")
# A policy's action beyond this is at its limit.
AT_LIMIT = 0.99
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


class Demonstrated(OffPolicyAlgorithm):
    """An off-policy algorithm whose demonstrator sometimes takes the wheel.

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
    demonstrable = True
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
        cast(PathFollowingVecEnv, self.env).choice = own[:, 0], takes
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
        self.saturated_steps += int((np.abs(action) >= AT_LIMIT).sum())
        return np.clip(action + action_noise(), -1.0, 1.0).astype(np.float32)

    def mirror_factors(self) -> Any:
        """Factors (features,) on each feature that mirror it, float32; None: no mirror images."""
        if not self.mirror:
            return None
        return cast(PathFollowingVecEnv, self.env).mirror.astype(np.float32)

    def _rate_at(self, k: int, gradient_steps: int) -> float:
        """Learning rate of an update; updates are spread evenly over the steps collected."""
        if self.rate is None:
            return float(self.lr_schedule(self._current_progress_remaining))
        return self.rate(self.num_timesteps - self.n_envs * (1.0 - (k + 1) / gradient_steps))

    def current_rate(self) -> float:
        """Learning rate of the next update."""
        return self._rate_at(0, 1)

    def act(self, features: Any) -> Any:
        """The policy's actions (n,) for features (n, k), without noise."""
        return updates.act(self.actor_net(), features)

    @abstractmethod
    def actor_net(self) -> updates.Net:
        """The actor's weights."""

    @abstractmethod
    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, flat."""

    def _stored(self, size: int) -> dict[str, Any]:
        """The filled part of the replay buffer."""
        return {name: getattr(self.replay_buffer, name)[:size] for name in updates.Batch._fields}

    def _generators(self) -> dict[str, Any]:
        """Noise's, demonstrator's, and that of the random actions before learning."""
        out = {
            "demonstrator": self.demo_rng.bit_generator,
            "actions": self.action_space.np_random.bit_generator,
        }
        if self.action_noise is not None:
            out["noise"] = cast(OrnsteinUhlenbeck, self.action_noise).rng.bit_generator
        return out

    def snapshot(self) -> dict[str, Any]:
        """All that changes from step to step, the environment apart; taken between two steps."""
        buffer, noise = self.replay_buffer, cast(OrnsteinUhlenbeck | None, self.action_noise)
        assert buffer is not None
        size = buffer.buffer_size if buffer.full else buffer.pos
        return {
            "weights": self.weights(),
            "buffer": {"position": buffer.pos, "full": buffer.full, "size": size}
            | self._stored(size),
            "noise": None if noise is None else noise.state,
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
        if self.action_noise is not None:
            cast(OrnsteinUhlenbeck, self.action_noise).state = saved["noise"]
        for name, bits in self._generators().items():
            bits.state = saved["generators"][name]
        for name in _COUNTERS:
            setattr(self, name, saved["counters"][name])
        self._last_obs = saved["observation"]


def make_off_policy(
    cls: Callable[..., A],
    settings: OffPolicy,
    config: TrainConfig,
    env: PathFollowingVecEnv,
    **own: Any,
) -> A:
    """An agent of a training configuration; ``own`` is what only this algorithm is told."""
    demo, total = config.problem.demonstration, config.steps
    seeds = np.random.SeedSequence(config.seed).generate_state(3)
    agent: A

    def p_action() -> float:
        return demo.p_action.value(agent.num_timesteps, total) if demo.enabled else 0.0

    if isinstance(settings, Deterministic):
        sigma = settings.noise
        own["action_noise"] = OrnsteinUhlenbeck(
            env.num_envs,
            settings.noise_theta,
            lambda: sigma.value(agent.num_timesteps, total),
            settings.noise_dt,
            int(seeds[0]),
        )
    agent = cls(
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
        policy_kwargs={"net_arch": list(settings.hidden)},
        seed=int(seeds[1] % 2**31),
        device="cpu",
        **own,
    )
    if config.problem.base is not None:
        start_at_zero(agent.policy)
    agent.mirror = settings.mirror
    agent.rate = lambda step: settings.learning_rate.value(step, total)
    agent.prepare_demonstration(p_action, store_agent=demo.store == "agent", seed=int(seeds[2]))
    return agent
