"""SAC of Stable-Baselines3 with a demonstrator beside it."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.utils import update_learning_rate

from steersman.learning import memory, updates
from steersman.learning.algorithms import Sac
from steersman.learning.config import TrainConfig
from steersman.learning.mirror import MirrorBuffer
from steersman.learning.seam import AT_LIMIT, Demonstrated, make_off_policy
from steersman.learning.vec_env import PathFollowingVecEnv


class DemonstratedSAC(Demonstrated, SAC):
    """SAC whose demonstrator sometimes takes the wheel."""

    _present_rate = 0.0
    _actor: updates.Net | None = None

    def _own_action(
        self, learning_starts: int, action_noise: ActionNoise | None, n_envs: int
    ) -> Any:
        """The agent's action, (n_envs, 1), drawn from the policy; random before learning."""
        if self.num_timesteps >= learning_starts:
            mean = self.act(self._last_obs)
            self.saturated_steps += int((np.abs(mean) >= AT_LIMIT).sum())
        return super()._own_action(learning_starts, action_noise, n_envs)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """SB3's updates one by one, each with its learning rate."""
        losses = np.zeros(2)
        for k in range(gradient_steps):
            self._present_rate = self._rate_at(k, gradient_steps)
            super().train(1, batch_size)
            said = self.logger.name_to_value
            losses += [said["train/actor_loss"], said["train/critic_loss"]]
        actor_loss, critic_loss = losses / gradient_steps
        self.last_losses = (float(actor_loss), float(critic_loss), self._mean_value(batch_size))

    def _update_learning_rate(self, optimizers: Any) -> None:
        for optimiser in optimizers if isinstance(optimizers, list) else [optimizers]:
            update_learning_rate(optimiser, self._present_rate)

    def _mean_value(self, count: int) -> float:
        """The first critic's mean value of the newest transitions."""
        buffer = self.replay_buffer
        assert buffer is not None
        size = buffer.buffer_size if buffer.full else buffer.pos
        rows = (buffer.pos - 1 - np.arange(min(-(-count // buffer.n_envs), size))) % size
        seen, done = buffer.observations[rows], buffer.actions[rows]
        with torch.no_grad():
            features = torch.from_numpy(seen.reshape(-1, seen.shape[-1]))
            actions = torch.from_numpy(done.reshape(-1, 1))
            return float(self.critic.q1_forward(features, actions).mean())

    def actor_net(self) -> updates.Net:
        """The weights of the policy's mean."""
        if self._actor is None:
            # Mean and deviation share the hidden layers; the deviation's weights come last.
            *shared, _, _ = parameters = list(self.actor.parameters())
            flat = memory.flatten(parameters)
            self._actor = memory.as_net(flat[: sum(p.numel() for p in shared)], shared[::2])
        return self._actor

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, as arrays that are torch's memory."""
        self.actor_net()
        actor, critic, target = (
            [(f"{name}.{key}", p) for key, p in getattr(self, name).named_parameters()]
            for name in ("actor", "critic", "critic_target")
        )
        out = memory.torch_arrays(actor, self.actor.optimizer)
        out |= memory.torch_arrays(critic, self.critic.optimizer)
        out |= memory.torch_arrays(target)
        if self.ent_coef_optimizer is not None:
            entropy = [("log_ent_coef", self.log_ent_coef)]
            out |= memory.torch_arrays(entropy, self.ent_coef_optimizer)
        return out


def make_sac(config: TrainConfig, env: PathFollowingVecEnv, settings: Sac) -> DemonstratedSAC:
    """The agent of a training configuration by SAC."""
    own: dict[str, Any] = {"ent_coef": settings.ent_coef}
    if settings.ent_coef == "auto":
        own["ent_coef"] = f"auto_{settings.ent_coef_start}"
    if settings.target_entropy is not None:
        own["target_entropy"] = settings.target_entropy
    if settings.mirror:
        own["replay_buffer_class"] = MirrorBuffer
        own["replay_buffer_kwargs"] = {"factors": env.mirror.astype(np.float32)}
    return make_off_policy(DemonstratedSAC, settings, config, env, **own)
