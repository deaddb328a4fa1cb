"""TD3 of Stable-Baselines3 with a demonstrator beside it, and its update compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from stable_baselines3 import TD3

from steersman.learning import memory, twin, updates
from steersman.learning.algorithms import Td3
from steersman.learning.config import TrainConfig
from steersman.learning.seam import Demonstrated, make_off_policy
from steersman.learning.vec_env import PathFollowingVecEnv


class DemonstratedTD3(Demonstrated, TD3):
    """TD3 whose demonstrator sometimes takes the wheel."""

    _learner: twin.Learner | None = None

    def _compiled(self) -> twin.Learner:
        """All networks, laid flat at the first call, so that the compiled update shares them."""
        if self._learner is None:
            actor, critics = memory.flat_net(self.actor), memory.flat_critics(self.critic)
            first = critics.first
            self._learner = twin.Learner(
                actor,
                critics,
                memory.flat_net(self.actor_target),
                memory.flat_critics(self.critic_target),
                updates.make_moments(actor.flat.size),
                updates.make_moments(critics.flat.size),
                memory.critics_of(np.zeros_like(critics.flat), (first.w1, first.w2, first.w3)),
            )
            self._work = updates.make_work(self.batch_size, actor, first)
        return self._learner

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """The updates of SB3's TD3.train, compiled (see ``twin``), with the same random numbers."""
        learner = self._compiled()
        losses = twin.update(
            memory.buffer_arrays(self.replay_buffer),
            memory.draw(self.replay_buffer, gradient_steps, batch_size, self.mirror_factors()),
            self._noise(gradient_steps, batch_size),
            np.array([self._rate_at(k, gradient_steps) for k in range(gradient_steps)]),
            learner,
            twin.Rules(self.gamma, self.tau, self.policy_delay, self._n_updates),
            self._work,
        )
        # Between two updates of the actor the last loss stands.
        actor_loss = self.last_losses[0] if math.isnan(losses[0]) else losses[0]
        self.last_losses = (actor_loss, *losses[1:])
        self._n_updates += gradient_steps

    def _noise(self, count: int, batch_size: int) -> Any:
        """Noise on the targets' actions (count, batch_size), float32."""
        noise = torch.empty(count, batch_size)
        for row in noise:  # torch draws many numbers otherwise than a few at a time
            row.normal_(0.0, self.target_policy_noise)
        return noise.clamp(-self.target_noise_clip, self.target_noise_clip).numpy()

    def actor_net(self) -> updates.Net:
        """The actor's weights."""
        return self._compiled().actor

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, flat."""
        learner = self._compiled()
        out = {
            "actor": learner.actor.flat,
            "critic": learner.critics.flat,
            "actor_target": learner.actor_target.flat,
            "critic_target": learner.critics_target.flat,
        }
        moments = {"actor": learner.actor_moments, "critic": learner.critic_moments}
        for name, m in moments.items():
            out |= {f"{name}_first": m.first, f"{name}_second": m.second, f"{name}_count": m.count}
        return out


def make_td3(config: TrainConfig, env: PathFollowingVecEnv, settings: Td3) -> DemonstratedTD3:
    """The agent of a training configuration by TD3."""
    return make_off_policy(
        DemonstratedTD3,
        settings,
        config,
        env,
        policy_delay=settings.policy_delay,
        target_policy_noise=settings.target_policy_noise,
        target_noise_clip=settings.target_noise_clip,
    )
