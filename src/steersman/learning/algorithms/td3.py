"""TD3: DDPG with two critics, smoothed targets and a delayed actor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from steersman.config import param, register
from steersman.learning.algorithms.base import DeterministicComponent

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.sb3 import SteeringAgent
    from steersman.learning.vec_env import PathFollowingVecEnv


@register("agent", "td3")
class Td3(DeterministicComponent):
    """TD3 (Fujimoto et al., 2018): the smaller of two critics, noise on targets, a later actor."""

    policy_delay: int = param(2, "updates", "Actor and targets follow once in so many.", ge=1)
    target_policy_noise: float = param(
        0.2, "-", "Standard deviation of the noise on the targets' actions in [-1, 1].", ge=0
    )
    target_noise_clip: float = param(
        0.5, "-", "Largest noise on the targets' actions in [-1, 1].", ge=0
    )

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> SteeringAgent:
        """The agent of a training configuration, which holds this component."""
        from stable_baselines3 import TD3

        from steersman.learning.off_policy import make_off_policy

        return make_off_policy(
            TD3,
            self,
            config,
            env,
            policy_delay=self.policy_delay,
            target_policy_noise=self.target_policy_noise,
            target_noise_clip=self.target_noise_clip,
        )

    @property
    def first_actor_update(self) -> int:
        """The number of updates after which the actor has a loss."""
        return self.policy_delay
