"""An agent that learns by the derivatives of its own driving.

Each turn it drives a stretch of ``horizon`` steps, goes back through it (:mod:`tape`) and descends.
What follows the stretch is worth what a critic says, which learns from the same stretch. A drive
that failed is valued as if its last reward were paid for ever after: the end of a drive has no
slope, and nothing after it costs anything.

Source: Xu et al., Accelerated policy learning with parallel differentiable simulation, ICLR 2022
(arXiv:2204.07137): short horizon, critic with TD(lambda) and a slow target.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from steersman.kernels import world as kernel
from steersman.learning.networks import (
    Work,
    adam,
    back_hidden,
    descend,
    follow,
    forward,
    make_moments,
    make_work,
    view_net,
    weight_gradients,
)
from steersman.learning.sb3 import AT_LIMIT, SteeringAgent, lay_flat
from steersman.learning.tape import Recorded
from steersman.types import FloatArray

if TYPE_CHECKING:
    from steersman.learning.algorithms.apg import Apg
    from steersman.learning.config import TrainConfig
    from steersman.learning.vec_env import PathFollowingVecEnv


def _part(work: Work, first: int, last: int) -> Work:
    """The samples of a batch from ``first`` to ``last``; the gradients are those of the whole."""
    return Work._make([*(array[first:last] for array in work[:-1]), work.grad])


class _Ends(NamedTuple):
    """Where the rewards of a stretch stop adding up, and how far their discount has got."""

    last: Any
    """(H, N) a drive or the stretch ends with the step."""
    failed: Any
    """(H, N) the drive failed with the step."""
    discount: FloatArray
    """(H, N) factor on the step's reward."""


class AnalyticSteering(SteeringAgent, OnPolicyAlgorithm):
    """Analytic policy gradients; made by :func:`make_analytic`."""

    settings: Apg

    def prepare(self, settings: Apg, recorded: Recorded, mirror: FloatArray) -> None:
        """Lay networks flat and make scratch; to be called before learning."""
        self.settings, self.recorded = settings, recorded
        sides = np.ones(self.n_envs)
        if settings.mirror:
            sides[1::2] = -1.0
        self._sides = sides
        self._mirrored = np.where(sides[:, None] < 0.0, mirror, 1.0)
        size, n = self.n_steps * self.n_envs, self.n_envs
        actor = self.actor_net()
        self._work = make_work(actor, size)
        self._steps = [_part(self._work, t * n, t * n + n) for t in range(self.n_steps)]
        policy: Any = self.policy
        self._critic = lay_flat([policy.mlp_extractor.value_net, policy.value_net])
        inputs, (first, second) = actor.w1.shape[1], settings.hidden
        self._slow = view_net(self._critic.flat.copy(), (inputs, first, second, 1))
        self._moments = make_moments(actor.flat.size), make_moments(self._critic.flat.size)
        self._valuing = make_work(self._critic, size)
        self._learning = make_work(self._critic, min(settings.batch, size))

    def collect_rollouts(
        self, env: Any, callback: Any, rollout_buffer: Any, n_rollout_steps: int
    ) -> bool:
        """Drive a stretch by the policy alone."""
        callback.on_rollout_start()
        fleet = env.driver.fleet
        for t in range(n_rollout_steps):
            self.recorded.before(t)
            step = self._steps[t]
            step.x[:] = fleet.inputs * self._mirrored
            forward(self.actor_net(), step)
            actions = np.clip(self._sides * step.y[:, 0], -1.0, 1.0)
            self.saturated_steps += int((np.abs(actions) >= AT_LIMIT).sum())
            self.sampled_steps += self.n_envs
            env.watch = lambda t=t, actions=actions: self.recorded.after(t, actions)
            self._last_obs = env.step(actions[:, None])[0]
            self.num_timesteps += self.n_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Descend once with the policy; then fit the critic."""
        ends = self._find_ends()
        count = ends.discount.size
        slopes = np.zeros_like(self.recorded.inputs)
        values = np.zeros_like(ends.discount)
        if self.settings.critic:
            values = self._value(self.recorded.next_inputs)
            goes_on = ends.last & ~ends.failed
            weight = np.where(goes_on, -self.gamma * ends.discount / count, 0.0)
            slopes = self._slopes_of_value(weight / (1.0 - self.gamma))
        self._improve_policy(-ends.discount / count, slopes)
        loss = self._improve_critic(self._targets(ends, values)) if self.settings.critic else 0.0
        returned = float((ends.discount * self.recorded.rewards).sum() / count)
        self.last_losses = -returned, loss, float(values.mean())
        self._n_updates += 1

    def _find_ends(self) -> _Ends:
        ended = self.recorded.tape.ended
        last, discount = ended != kernel.RUNNING, np.ones(ended.shape)
        for t in range(1, len(last)):
            discount[t] = np.where(last[t - 1], 1.0, self.gamma * discount[t - 1])
        failed = np.isin(ended, kernel.FAILED)
        last[-1] = True
        return _Ends(last, failed, discount)

    def _value(self, inputs: FloatArray) -> FloatArray:
        """The slow critic's values (H, N); its network gives the mean reward, (1 - gamma) V."""
        work = self._valuing
        work.x[:] = (inputs * self._mirrored).reshape(work.x.shape)
        forward(self._slow, work)
        values: FloatArray = work.y.reshape(inputs.shape[:2]) / (1.0 - self.gamma)
        return values

    def _slopes_of_value(self, weight: FloatArray) -> FloatArray:
        """``weight`` (H, N) times the derivatives of the network's output in :meth:`_value`."""
        work = self._valuing
        work.dy[:, 0] = weight.reshape(-1)
        back_hidden(self._slow, work)
        by_inputs: FloatArray = (work.d1 @ self._slow.w1).reshape(self.recorded.inputs.shape)
        return by_inputs * self._mirrored

    def _improve_policy(self, weights: FloatArray, ends: FloatArray) -> None:
        net = self.actor_net()

        def through(t: int, by_action: FloatArray) -> FloatArray:
            step = self._steps[t]
            by_output = by_action * self._sides
            output = step.y[:, 0]
            # Beyond a limit only a slope that leads back counts.
            beyond = ((output > 1.0) & (by_output < 0.0)) | ((output < -1.0) & (by_output > 0.0))
            step.dy[:, 0] = np.where(beyond, 0.0, by_output)
            back_hidden(net, step)
            by_inputs: FloatArray = (step.d1 @ net.w1) * self._mirrored
            return by_inputs

        with np.errstate(over="ignore", invalid="ignore"):  # such a gradient changes nothing
            self.recorded.pull(weights, ends, through)
            weight_gradients(self._work)
            gradient = self._work.grad.flat
            length = float(np.linalg.norm(gradient))
        if np.isfinite(length):
            if length > self.settings.max_grad_norm:
                gradient *= np.float32(self.settings.max_grad_norm / length)
            adam(net.flat, gradient, self._moments[0], self.current_rate())

    def _targets(self, ends: _Ends, values: FloatArray) -> FloatArray:
        """TD(lambda) returns (H, N)."""
        rewards, gamma, mix = self.recorded.rewards, self.gamma, self.settings.td_lambda
        values = np.where(ends.failed, rewards / (1.0 - gamma), values)
        out = np.zeros_like(rewards)
        for t in range(len(out) - 1, -1, -1):
            later = values[t]
            if t + 1 < len(out):
                mixed = (1.0 - mix) * later + mix * out[t + 1]
                later = np.where(ends.last[t], later, mixed)
            out[t] = rewards[t] + gamma * later
        return out

    def _improve_critic(self, targets: FloatArray) -> float:
        """Fit the critic to targets (H, N); returns the last pass's mean squared error."""
        work, size = self._learning, len(self._learning.x)
        wanted = ((1.0 - self.gamma) * targets).reshape(-1).astype(np.float32)
        loss = 0.0
        for _ in range(self.settings.critic_epochs):
            order = np.random.permutation(len(wanted))  # noqa: NPY002 - SB3's generator
            parts = len(wanted) // size
            loss = 0.0
            for k in range(parts):
                chosen = order[k * size : (k + 1) * size]
                work.x[:] = self._work.x[chosen]
                forward(self._critic, work)
                gap = work.y[:, 0] - wanted[chosen]
                work.dy[:, 0] = gap * np.float32(2.0 / size)
                descend(self._critic, self._moments[1], self.current_rate(), work)
                loss += float((gap * gap).mean()) / parts
        follow(self._slow.flat, self._critic.flat, self.settings.tau)
        return loss

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, flat."""
        nets = {"actor": self.actor_net(), "critic": self._critic, "critic_target": self._slow}
        out = {name: net.flat for name, net in nets.items()}
        for name, m in zip(nets, self._moments, strict=False):
            out |= {f"{name}_first": m.first, f"{name}_second": m.second, f"{name}_count": m.count}
        return out


def make_analytic(settings: Apg, config: TrainConfig, env: PathFollowingVecEnv) -> AnalyticSteering:
    """The agent of a training configuration by APG; ``settings`` is ``config.agent``.

    Raises:
        ConfigError: the plant or a formula has no derivatives, or a base is corrected.
    """
    rate, total = settings.learning_rate, config.steps
    agent = AnalyticSteering(
        ActorCriticPolicy,
        env,
        learning_rate=rate.value(0, total),
        n_steps=settings.horizon,
        gamma=settings.gamma,
        gae_lambda=settings.td_lambda,
        ent_coef=0.0,
        vf_coef=0.0,
        max_grad_norm=settings.max_grad_norm,
        use_sde=False,
        sde_sample_freq=-1,
        policy_kwargs={"net_arch": list(settings.hidden), "activation_fn": nn.ReLU},
        seed=int(np.random.SeedSequence(config.seed).generate_state(3)[1] % 2**31),
        device="cpu",
    )
    agent.rate, agent.operators = lambda step: rate.value(step, total), settings.operators
    agent.prepare(settings, Recorded(env.driver, settings.horizon), env.mirror)
    return agent
