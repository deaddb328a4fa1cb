"""DDPG: one deterministic policy, one critic. Its update is compiled (``learning.ddpg_update``)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from steersman.config import register
from steersman.learning.algorithms.base import DeterministicComponent

if TYPE_CHECKING:
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm


@register("agent", "ddpg")
class Ddpg(DeterministicComponent):
    """DDPG (Lillicrap et al., 2016): one critic, an update of the actor with each of its own."""

    def algorithm(self) -> type[OffPolicyAlgorithm]:
        """Stable-Baselines3's with a compiled update."""
        from steersman.learning.ddpg_update import CompiledDDPG

        return CompiledDDPG
