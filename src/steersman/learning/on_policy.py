"""PPO of Stable-Baselines3 for the training loop.

It learns from each stretch of driving once, while the policy is still the one that drove. Actions
that the policy did not choose have no probability by which PPO could weigh them, so the
demonstrator changes rewards, but never acts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from stable_baselines3 import PPO
from torch import nn

from steersman.learning.sb3 import AT_LIMIT, SteeringAgent, start_at_base
from steersman.learning.snapshot import Tree

if TYPE_CHECKING:
    from steersman.learning.algorithms.ppo import Ppo
    from steersman.learning.config import TrainConfig
    from steersman.learning.vec_env import PathFollowingVecEnv

_ACTIVATIONS = {"tanh": nn.Tanh, "relu": nn.ReLU}
# Options that PPO of Stable-Baselines3 has under the same names.
_SAME = (
    *("n_steps", "n_epochs", "gamma", "gae_lambda", "clip_range", "clip_range_vf"),
    *("normalize_advantage", "ent_coef", "vf_coef", "max_grad_norm", "target_kl"),
)


class OnPolicySteering(SteeringAgent, PPO):
    """PPO with a learning rate for every update."""

    _turn = 0

    def set_rate(self, optimiser: Any, *_: Any) -> None:
        """Before each update: the updates after a stretch of driving are spread over its steps."""
        self._turn += 1
        collected = self.n_steps * self.n_envs
        count = self.n_epochs * collected // self.batch_size
        rate = self._rate(self.num_timesteps - collected * (1.0 - self._turn / count))
        for group in optimiser.param_groups:
            group["lr"] = rate

    def train(self) -> None:
        """SB3's updates; and how often the policy that collected was at a limit."""
        buffer = self.rollout_buffer
        wanted = self.act(buffer.observations.reshape(-1, buffer.observations.shape[-1]))
        self.sampled_steps += len(wanted)
        self.saturated_steps += int((np.abs(wanted) >= AT_LIMIT).any(axis=1).sum())
        self._turn = 0
        super().train()
        said = self.logger.name_to_value
        self.last_losses = (
            float(said["train/policy_gradient_loss"]),
            float(said["train/value_loss"]),
            float(buffer.values.mean()),
        )

    def snapshot(self) -> dict[str, Any]:
        """All that changes, the environment apart; taken when everything collected was learned."""
        return {**super().snapshot(), "starts": self._last_episode_starts}

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        super().restore(saved)
        self._last_episode_starts = saved["starts"]


def make_on_policy(
    settings: Ppo, config: TrainConfig, env: PathFollowingVecEnv
) -> OnPolicySteering:
    """The agent of a training configuration by PPO; ``settings`` is ``config.agent``."""
    rate, total = settings.learning_rate, config.steps
    agent = OnPolicySteering(
        "MlpPolicy",
        env,
        learning_rate=rate.value(0, total),
        batch_size=settings.batch,
        policy_kwargs={
            "net_arch": list(settings.hidden),
            "activation_fn": _ACTIVATIONS[settings.activation],
            "log_std_init": settings.log_std_init,
        },
        seed=int(np.random.SeedSequence(config.seed).generate_state(3)[1] % 2**31),
        device="cpu",
        **{name: getattr(settings, name) for name in _SAME},
    )
    start_at_base(agent.policy, config.problem, settings)
    agent.rate, agent.operators = lambda step: rate.value(step, total), settings.operators
    agent.policy.optimizer.register_step_pre_hook(agent.set_rate)
    return agent
