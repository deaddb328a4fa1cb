"""TD3: DDPG with two critics, smoothed targets and a delayed actor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from steersman.config import param, register
from steersman.learning.algorithms.base import DeterministicComponent

if TYPE_CHECKING:
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm


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

    def algorithm(self) -> type[OffPolicyAlgorithm]:
        """Stable-Baselines3's."""
        from stable_baselines3 import TD3

        return TD3

    def options(self) -> dict[str, Any]:
        """Delay of the actor, and noise on the targets."""
        names = ("policy_delay", "target_policy_noise", "target_noise_clip")
        return {name: getattr(self, name) for name in names}

    @property
    def first_actor_update(self) -> int:
        """The number of updates after which the actor has a loss."""
        return self.policy_delay
