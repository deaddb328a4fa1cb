"""SAC of Stable-Baselines3 with a demonstrator beside it, and its update compiled."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.noise import ActionNoise

from steersman.learning import memory, soft, updates
from steersman.learning.algorithms import Sac
from steersman.learning.config import TrainConfig
from steersman.learning.seam import AT_LIMIT, Demonstrated, make_off_policy
from steersman.learning.vec_env import PathFollowingVecEnv


class DemonstratedSAC(Demonstrated, SAC):
    """SAC whose demonstrator sometimes takes the wheel."""

    _learner: soft.Learner | None = None

    def _own_action(
        self, learning_starts: int, action_noise: ActionNoise | None, n_envs: int
    ) -> Any:
        """The agent's action, (n_envs, 1), drawn from the policy; random before learning."""
        if self.num_timesteps >= learning_starts:
            mean = self.act(self._last_obs)
            self.saturated_steps += int((np.abs(mean) >= AT_LIMIT).sum())
        return super()._own_action(learning_starts, action_noise, n_envs)

    def _compiled(self) -> soft.Learner:
        """All networks, laid flat at the first call, so that the compiled update shares them."""
        if self._learner is None:
            policy = memory.flat_policy(self.actor)
            critics = memory.flat_critics(self.critic)
            first, mean = critics.first, policy.mean
            self._learner = soft.Learner(
                policy,
                critics,
                memory.flat_critics(self.critic_target),
                self._entropy(),
                updates.make_moments(policy.flat.size),
                updates.make_moments(critics.flat.size),
                memory.policy_of(np.zeros_like(policy.flat), (mean.w1, mean.w2, mean.w3)),
                memory.critics_of(np.zeros_like(critics.flat), (first.w1, first.w2, first.w3)),
            )
            self._work = updates.make_work(self.batch_size, mean, first)
            self._drawn = soft.make_drawn(self._work)
        return self._learner

    def _entropy(self) -> soft.Entropy:
        if self.log_ent_coef is None:
            log = np.log(self.ent_coef_tensor.numpy().reshape(1))
        else:
            log = self.log_ent_coef.data.numpy()
        target = float(self.target_entropy)
        return soft.Entropy(log, updates.make_moments(1), target, self.log_ent_coef is not None)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """The updates of SB3's SAC.train, compiled (see ``soft``), with the same random numbers."""
        learner = self._compiled()
        shape = gradient_steps, 2, batch_size
        noise = torch.empty(shape)
        for row in noise.view(-1, batch_size):  # drawn as often as torch's distributions draw
            row.normal_()
        self.last_losses = soft.update(
            memory.buffer_arrays(self.replay_buffer),
            memory.draw(self.replay_buffer, gradient_steps, batch_size, self.mirror_factors()),
            noise.numpy(),
            np.array([self._rate_at(k, gradient_steps) for k in range(gradient_steps)]),
            learner,
            (self.gamma, self.tau),
            self._work,
            self._drawn,
        )
        self._n_updates += gradient_steps

    def actor_net(self) -> updates.Net:
        """The weights of the policy's mean."""
        return self._compiled().policy.mean

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, flat."""
        learner = self._compiled()
        out = {
            "actor": learner.policy.flat,
            "critic": learner.critics.flat,
            "critic_target": learner.critics_target.flat,
            "log_ent_coef": learner.entropy.log,
        }
        moments = {
            "actor": learner.policy_moments,
            "critic": learner.critic_moments,
            "log_ent_coef": learner.entropy.moments,
        }
        for name, m in moments.items():
            out |= {f"{name}_first": m.first, f"{name}_second": m.second, f"{name}_count": m.count}
        return out


def make_sac(config: TrainConfig, env: PathFollowingVecEnv, settings: Sac) -> DemonstratedSAC:
    """The agent of a training configuration by SAC."""
    own: dict[str, Any] = {"ent_coef": settings.ent_coef}
    if settings.ent_coef == "auto":
        own["ent_coef"] = f"auto_{settings.ent_coef_start}"
    if settings.target_entropy is not None:
        own["target_entropy"] = settings.target_entropy
    return make_off_policy(DemonstratedSAC, settings, config, env, **own)
