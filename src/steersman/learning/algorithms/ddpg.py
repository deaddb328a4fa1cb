"""DDPG: one deterministic policy, one critic. Its update is compiled (``learning.ddpg_update``)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from steersman.config import register
from steersman.learning.algorithms.base import DeterministicComponent

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.sb3 import SteeringAgent
    from steersman.learning.vec_env import PathFollowingVecEnv


@register("agent", "ddpg")
class Ddpg(DeterministicComponent):
    """DDPG (Lillicrap et al., 2016): one critic, an update of the actor with each of its own."""

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> SteeringAgent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.ddpg_update import CompiledDDPG
        from steersman.learning.off_policy import make_off_policy

        return make_off_policy(CompiledDDPG, self, config, env)
