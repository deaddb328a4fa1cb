"""Agents that learn from a replay buffer: which action is executed, and which is stored.

One class stands before every off-policy algorithm of Stable-Baselines3. ``_sample_action`` chooses
the executed and the stored action; ``train`` runs Stable-Baselines3's updates one by one, each with
its own learning rate. docs/decisions/0004-sb3-seam.md
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import torch
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.utils import update_learning_rate

from steersman.errors import DataError
from steersman.learning.noise import OrnsteinUhlenbeck
from steersman.learning.sb3 import AT_LIMIT, SteeringAgent, start_at_zero
from steersman.learning.snapshot import Tree, fill

if TYPE_CHECKING:
    from steersman.learning.algorithms.base import OffPolicyComponent
    from steersman.learning.config import TrainConfig
    from steersman.learning.vec_env import PathFollowingVecEnv

BUFFER_ARRAYS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class MirroredReplayBuffer(ReplayBuffer):
    """A replay buffer that mirrors half of each batch, left for right.

    Attributes:
        mirror: (features,) factor on each feature that mirrors it; None: no mirror images.
    """

    mirror: Any = None

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """A batch; which half is mirrored is drawn after it, from the same generator."""
        data = super().sample(batch_size, env)
        if self.mirror is None:
            return data
        coins = np.random.randint(0, 2, size=(batch_size, 1))  # noqa: NPY002 - SB3's generator
        mirrored = torch.from_numpy(coins == 0)
        factors = torch.where(mirrored, torch.from_numpy(self.mirror), 1.0)
        return data._replace(
            observations=data.observations * factors,
            next_observations=data.next_observations * factors,
            actions=torch.where(mirrored, -data.actions, data.actions),
        )


class OffPolicySteering(SteeringAgent, OffPolicyAlgorithm):
    """An off-policy algorithm in which the demonstrator sometimes acts.

    Attributes:
        p_action: gives the present probability of the demonstrator's action.
        mirror: (features,) factor on each feature that mirrors it, float32; None: no mirror images.
        store_agent: keep the agent's own action in the buffer instead of the executed one.
    """

    p_action: Callable[[], float] = staticmethod(lambda: 0.0)
    store_agent = False
    mirror: Any = None
    demonstrable = True
    counters = (*SteeringAgent.counters, "_episode_num", "demonstrated_steps")
    _turn = (0, 1)
    critic: Any
    _values: Any = None

    def prepare_demonstration(
        self, p_action: Callable[[], float], *, store_agent: bool, seed: int
    ) -> None:
        """Set when the demonstrator acts; to be called before learning."""
        self.p_action, self.store_agent = p_action, store_agent
        self.demo_rng = np.random.default_rng(seed)

    def _sample_action(
        self, learning_starts: int, action_noise: ActionNoise | None = None, n_envs: int = 1
    ) -> tuple[Any, Any]:
        """Executed and stored action, each (n_envs, 1); the demonstrator acts with p_action."""
        own = self._own_action(learning_starts, action_noise, n_envs)
        self.sampled_steps += n_envs
        takes = self.demo_rng.random(n_envs) < self.p_action()
        env = cast("PathFollowingVecEnv", self.env)
        env.choice = own[:, 0], takes
        if not takes.any():
            return own, own
        executed = own.copy()
        executed[takes, 0] = env.demonstrated_actions()[takes]
        self.demonstrated_steps += int(takes.sum())
        return executed, own if self.store_agent else executed

    def _own_action(
        self, learning_starts: int, action_noise: ActionNoise | None, n_envs: int
    ) -> Any:
        """The agent's action with exploration, (n_envs, 1); random before learning.

        As SB3's; a deterministic policy's without the detour through torch at every step.
        """
        if self.num_timesteps >= learning_starts:
            mean = self.act(self._last_obs)[:, None]
            # Before the noise, which takes every other action off the limit again.
            self.saturated_steps += int((np.abs(mean) >= AT_LIMIT).sum())
            if action_noise is not None:
                return np.clip(mean + action_noise(), -1.0, 1.0).astype(np.float32)
        return super()._sample_action(learning_starts, action_noise, n_envs)[1]

    def rate_at(self, k: int, gradient_steps: int) -> float:
        """Learning rate of update ``k``; updates are spread evenly over the steps collected."""
        return self._rate(self.num_timesteps - self.n_envs * (1.0 - (k + 1) / gradient_steps))

    def _update_learning_rate(self, optimizers: Any) -> None:
        """SB3 calls this once before each update."""
        rate = self.rate_at(*self._turn)
        for optimiser in optimizers if isinstance(optimizers, list) else [optimizers]:
            update_learning_rate(optimiser, rate)

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """SB3's updates, one by one."""
        if self._values is None:
            self.critic.register_forward_hook(self._watch)
        for k in range(gradient_steps):
            self._turn = k, gradient_steps
            super().train(1, batch_size)
        said, before = self.logger.name_to_value, self.last_losses
        self.last_losses = (
            # Between two updates of TD3's actor the last loss stands.
            float(said.get("train/actor_loss", before[0])),
            float(said.get("train/critic_loss", before[1])),
            float(self._values.mean()),
        )

    def _watch(self, module: Any, given: Any, values: Any) -> None:
        """Keep the first critic's values of the last batch."""
        self._values = values[0].detach()

    def _stored(self, size: int) -> dict[str, Any]:
        """The filled part of the replay buffer."""
        return {name: getattr(self.replay_buffer, name)[:size] for name in BUFFER_ARRAYS}

    def _generators(self) -> dict[str, Any]:
        """Generators of noise, of the demonstrator's turns and of random actions."""
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
            **super().snapshot(),
            "buffer": {"position": buffer.pos, "full": buffer.full, "size": size}
            | self._stored(size),
            "noise": None if noise is None else noise.state,
            "generators": {name: bits.state for name, bits in self._generators().items()},
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot.

        Raises:
            DataError: it is of another network or of a larger buffer.
        """
        buffer, kept = self.replay_buffer, saved["buffer"]
        assert buffer is not None
        if not 0 <= kept["size"] <= buffer.buffer_size:
            raise DataError(f"the replay buffer holds {buffer.buffer_size} rows")
        super().restore(saved)
        fill(self._stored(kept["size"]), kept)
        buffer.pos, buffer.full = kept["position"], kept["full"]
        if self.action_noise is not None:
            cast(OrnsteinUhlenbeck, self.action_noise).state = saved["noise"]
        for name, bits in self._generators().items():
            bits.state = saved["generators"][name]


@cache
def steering(algorithm: type[OffPolicyAlgorithm]) -> type[OffPolicySteering]:
    """An off-policy algorithm of Stable-Baselines3 with the seam before it."""
    if issubclass(algorithm, OffPolicySteering):
        return algorithm
    return type(f"Steering{algorithm.__name__}", (OffPolicySteering, algorithm), {})


def make_off_policy(
    settings: OffPolicyComponent, config: TrainConfig, env: PathFollowingVecEnv
) -> OffPolicySteering:
    """The agent of a training configuration.

    Args:
        settings: the algorithm and its options; ``config.agent``.
        config: the training.
        env: the vehicles that it drives.
    """
    demo, total, own = config.problem.demonstration, config.steps, settings.options()
    seeds = np.random.SeedSequence(config.seed).generate_state(3)
    agent: OffPolicySteering

    def p_action() -> float:
        return demo.p_action.value(agent.num_timesteps, total) if demo.enabled else 0.0

    if settings.exploration is not None:
        sigma, theta, dt = settings.exploration
        own["action_noise"] = OrnsteinUhlenbeck(
            env.num_envs,
            theta,
            lambda: sigma.value(agent.num_timesteps, total),
            dt,
            int(seeds[0]),
        )
    agent = steering(settings.algorithm())(
        "MlpPolicy",
        env,
        learning_rate=settings.learning_rate.value(0, total),
        buffer_size=settings.buffer,
        replay_buffer_class=MirroredReplayBuffer,
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
    if settings.mirror:
        agent.mirror = env.mirror.astype(np.float32)
        cast(MirroredReplayBuffer, agent.replay_buffer).mirror = agent.mirror
    agent.rate = lambda step: settings.learning_rate.value(step, total)
    agent.prepare_demonstration(p_action, store_agent=demo.store == "agent", seed=int(seeds[2]))
    return agent
