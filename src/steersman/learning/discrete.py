"""DQN of Stable-Baselines3 on a list of actions.

The environment's actions stay numbers in [-1, 1], and so do those of the replay buffer, where
mirror images and demonstrated actions need them. Stable-Baselines3 gets places in the list
only where it learns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import DQN
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from steersman.learning.networks import nearest
from steersman.learning.off_policy import OffPolicySteering
from steersman.learning.replay_buffer import DemonstrationBuffer
from steersman.learning.sb3 import AT_LIMIT
from steersman.learning.schedules import Schedule

if TYPE_CHECKING:
    from steersman.learning.vec_env import PathFollowingVecEnv


class ListedBuffer(DemonstrationBuffer):
    """A replay buffer of actions that gives each batch their places in a list."""

    def __init__(self, *given: Any, levels: Sequence[float], **named: Any) -> None:
        """As Stable-Baselines3's; ``levels`` is the list, ascending."""
        super().__init__(*given, **named)
        self.levels = levels
        self.actions = np.zeros(self.actions.shape, np.float32)

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """A batch; actions are places in the list, (batch, 1)."""
        data = super().sample(batch_size, env)
        places = nearest(data.actions.numpy(), self.levels)
        return data._replace(actions=torch.from_numpy(places))


class DiscreteSteering(OffPolicySteering, DQN):
    """DQN beside a demonstrator.

    Attributes:
        levels: the list of actions, ascending in [-1, 1].
        epsilon: share of random actions.
    """

    buffer_class = ListedBuffer
    counters = (*OffPolicySteering.counters, "_n_calls")

    def __init__(
        self,
        policy: Any,
        env: PathFollowingVecEnv,
        *,
        levels: Sequence[float],
        epsilon: Schedule,
        **named: Any,
    ) -> None:
        """As Stable-Baselines3's, whose target network follows once in a step of all vehicles."""
        self.levels, self.epsilon = np.array(levels), epsilon
        env.action_space = spaces.Discrete(len(levels))  # what Stable-Baselines3's accepts
        named |= {"replay_buffer_kwargs": {"levels": levels}}
        super().__init__(policy, env, target_update_interval=env.num_envs, **named)

    def act(self, features: Any) -> Any:
        """The policy's actions (n, 1), of the list, for features (n, k)."""
        with np.errstate(over="ignore", invalid="ignore"):  # a check tells of what diverges
            return super().act(features) @ self.levels[:, None]

    def allowed(self, actions: Any) -> Any:
        """The nearest of the list; NaN stays NaN."""
        listed = self.levels[nearest(actions, self.levels)]
        return np.where(np.isnan(actions), np.nan, listed)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Actions (n, 1) as the environment takes them."""
        places, state = super().predict(observation, state, episode_start, deterministic)
        return self.levels[places][..., None], state

    def _own_action(
        self, learning_starts: int, action_noise: ActionNoise | None, n_envs: int
    ) -> Any:
        """The agent's action, or for each vehicle by chance any of the list, (n_envs, 1)."""
        share = 1.0
        own = self.act(self._last_obs)
        if self.num_timesteps >= learning_starts:
            share = self.epsilon.value(self.num_timesteps, self.total)
            self.saturated_steps += int((np.abs(own) >= AT_LIMIT).sum())
        rng = self.action_space.np_random
        some = rng.random((n_envs, 1)) < share
        return np.where(some, rng.choice(self.levels, (n_envs, 1)), own).astype(np.float32)

    @property
    def critic(self) -> Any:
        """The network of the values."""
        return self.q_net

    def _losses(self, said: dict[str, Any]) -> tuple[float, float, float]:
        """The arg max has no loss of its own; what it ascends is the highest value."""
        value = float(self._values.mean())
        return -value, float(said["train/loss"]), value

    def _watch(self, module: Any, given: Any, values: Any) -> None:
        """Keep the highest values of the last batch."""
        self._values = values.detach().max(dim=1).values
