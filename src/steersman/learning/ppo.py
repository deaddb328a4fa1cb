"""PPO of Stable-Baselines3 for the training loop.

It learns from each stretch of driving once, while it still is what its own policy would do. There
is no replay buffer and no seam: actions that the policy did not choose have no probability by
which PPO could weigh them, so the demonstrator pays or costs rewards, but never acts.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from torch import nn

from steersman.learning import memory, updates
from steersman.learning.algorithms import Ppo
from steersman.learning.config import TrainConfig
from steersman.learning.residual import start_at_zero
from steersman.learning.seam import AT_LIMIT
from steersman.learning.snapshot import Tree, fill
from steersman.learning.vec_env import PathFollowingVecEnv

_COUNTERS = (
    "num_timesteps",
    "_n_updates",
    "_current_progress_remaining",
    "saturated_steps",
    "sampled_steps",
    "last_losses",
)
# After the hidden layers, for torch and for arrays.
_ACTIVATIONS: dict[str, tuple[type[nn.Module], Callable[[Any], Any]]] = {
    "tanh": (nn.Tanh, np.tanh),
    "relu": (nn.ReLU, partial(np.maximum, np.float32(0.0))),
}


class SelfTaughtPPO(PPO):
    """PPO whose policy is laid flat, with a learning rate for every update.

    Attributes:
        rate: learning rate as a function of the environment steps at an update.
    """

    rate: Callable[[float], float] | None = None
    demonstrable = False
    demonstrated_steps = 0
    saturated_steps = 0
    sampled_steps = 0
    last_losses: tuple[float, float, float] = (float("nan"),) * 3
    _actor: updates.Net | None = None
    _turn = 0

    def prepare(self, rate: Callable[[float], float], activation: str) -> None:
        """Set learning rate and what stands after hidden layers; once, before learning."""
        self.rate, self._hidden = rate, _ACTIVATIONS[activation][1]
        self.policy.optimizer.register_step_pre_hook(self._set_rate)

    def _set_rate(self, optimiser: Any, *_: Any) -> None:
        """Before each update: the updates after a stretch of driving are spread over its steps."""
        self._turn += 1
        collected = self.n_steps * self.n_envs
        count = self.n_epochs * collected // self.batch_size
        rate = self._rate_at(self.num_timesteps - collected * (1.0 - self._turn / count))
        for group in optimiser.param_groups:
            group["lr"] = rate

    def _rate_at(self, step: float) -> float:
        if self.rate is None:
            return float(self.lr_schedule(self._current_progress_remaining))
        return self.rate(step)

    def current_rate(self) -> float:
        """Learning rate of the next update."""
        return self._rate_at(self.num_timesteps)

    def train(self) -> None:
        """SB3's updates; and how often the policy that collected wanted an action at a limit."""
        buffer = self.rollout_buffer
        wanted = self.act(buffer.observations.reshape(-1, buffer.observations.shape[-1]))
        self.sampled_steps += wanted.size
        self.saturated_steps += int((np.abs(wanted) >= AT_LIMIT).sum())
        self._turn = 0
        super().train()
        said = self.logger.name_to_value
        self.last_losses = (
            float(said["train/policy_gradient_loss"]),
            float(said["train/value_loss"]),
            float(buffer.values.mean()),
        )

    def act(self, features: Any) -> Any:
        """The policy's actions (n,) for features (n, k), without noise."""
        net, hidden = self.actor_net(), self._hidden
        h1 = hidden(features.astype(np.float32) @ net.w1.T + net.b1)
        h2 = hidden(h1 @ net.w2.T + net.b2)
        return np.clip((h2 @ net.w3.T + net.b3)[:, 0], -1.0, 1.0).astype(np.float64)

    def actor_net(self) -> updates.Net:
        """The weights of the policy's mean."""
        if self._actor is None:
            policy = self.policy
            parameters = [
                *policy.mlp_extractor.policy_net.parameters(),
                *policy.action_net.parameters(),
            ]
            self._actor = memory.as_net(memory.flatten(parameters), parameters[::2])
        return self._actor

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, as arrays that are torch's memory."""
        self.actor_net()
        return memory.torch_arrays(self.policy.named_parameters(), self.policy.optimizer)

    def snapshot(self) -> dict[str, Any]:
        """All that changes, the environment apart; taken when everything collected was learned."""
        return {
            "weights": self.weights(),
            "counters": {name: getattr(self, name) for name in _COUNTERS},
            "observation": self._last_obs,
            "starts": self._last_episode_starts,
        }

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        fill(self.weights(), saved["weights"])
        for name in _COUNTERS:
            setattr(self, name, saved["counters"][name])
        self._last_obs, self._last_episode_starts = saved["observation"], saved["starts"]


def make_ppo(config: TrainConfig, env: PathFollowingVecEnv, settings: Ppo) -> SelfTaughtPPO:
    """The agent of a training configuration by PPO."""
    rate, total = settings.learning_rate, config.steps
    seed = int(np.random.SeedSequence(config.seed).generate_state(3)[1] % 2**31)
    names = "n_epochs gae_lambda clip_range clip_range_vf normalize_advantage ent_coef vf_coef"
    names += " max_grad_norm target_kl n_steps gamma"
    agent = SelfTaughtPPO(
        "MlpPolicy",
        env,
        learning_rate=rate.value(0, total),
        batch_size=settings.batch,
        policy_kwargs={
            "net_arch": list(settings.hidden),
            "activation_fn": _ACTIVATIONS[settings.activation][0],
            "log_std_init": settings.log_std_init,
        },
        seed=seed,
        device="cpu",
        **{name: getattr(settings, name) for name in names.split()},
    )
    if config.problem.base is not None:
        start_at_zero(agent.policy)
    agent.prepare(lambda step: rate.value(step, total), settings.activation)
    return agent
