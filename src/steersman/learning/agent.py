"""DDPG of Stable-Baselines3 with a demonstrator beside it.

One seam and one replacement, both tested: ``_sample_action`` chooses the executed action (and so
the stored one; see ``seam``), ``train`` does the same updates as SB3's with less overhead.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from stable_baselines3 import DDPG

from steersman.learning import memory, updates
from steersman.learning.algorithms import Ddpg
from steersman.learning.config import TrainConfig
from steersman.learning.protocol import Agent
from steersman.learning.seam import Demonstrated, make_off_policy
from steersman.learning.vec_env import PathFollowingVecEnv

_NETS = ("actor", "critic", "actor_target", "critic_target")


class DemonstratedDDPG(Demonstrated, DDPG):
    """DDPG whose demonstrator sometimes takes the wheel."""

    _nets: Any = None

    def _compile(self) -> None:
        """Lay the weights of all four networks flat, so that the compiled update shares them."""
        self._nets = tuple(memory.flat_net(getattr(self, name)) for name in _NETS)
        actor, critic = self._nets[:2]
        self.moments = (
            updates.make_moments(actor.flat.size),
            updates.make_moments(critic.flat.size),
        )
        self._work = updates.make_work(self.batch_size, actor, critic)
        self._arrays = memory.buffer_arrays(self.replay_buffer)

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """The updates of SB3's TD3.train for DDPG's settings, compiled (see ``updates``)."""
        if self._nets is None:
            self._compile()
        rates = np.array([self._rate_at(k, gradient_steps) for k in range(gradient_steps)])
        self.last_losses = updates.update(
            self._arrays,
            memory.draw(self.replay_buffer, gradient_steps, batch_size, self.mirror_factors()),
            rates,
            self._nets,
            self.moments,
            self.gamma,
            self.tau,
            self._work,
        )
        self._n_updates += gradient_steps

    def actor_net(self) -> updates.Net:
        """The actor's weights."""
        if self._nets is None:
            self._compile()
        return cast(updates.Net, self._nets[0])

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, flat."""
        if self._nets is None:
            self._compile()
        out = {name: net.flat for name, net in zip(_NETS, self._nets, strict=True)}
        for name, m in zip(_NETS, self.moments, strict=False):
            out |= {f"{name}_first": m.first, f"{name}_second": m.second, f"{name}_count": m.count}
        return out


def make_agent(config: TrainConfig, env: PathFollowingVecEnv) -> Agent:
    """The agent of a training configuration, by whatever algorithm."""
    return config.agent.make(config, env)


def make_ddpg(config: TrainConfig, env: PathFollowingVecEnv, settings: Ddpg) -> DemonstratedDDPG:
    """The agent of a training configuration by DDPG."""
    return make_off_policy(DemonstratedDDPG, settings, config, env)
