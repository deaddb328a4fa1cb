"""DDPG of Stable-Baselines3 with its update as one compiled function over BLAS.

The arithmetic is that of ``stable_baselines3.TD3.train`` with DDPG's settings (one critic, no
target noise, no delay) for two hidden ReLU layers; a test compares both update by update. It works
on torch's own memory (see ``networks``). SB3's own takes three to four times as long:
results/benchmarks/updates.json.

Source: Lillicrap et al., Continuous control with deep reinforcement learning, 2016, alg. 1.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from stable_baselines3 import DDPG

from steersman.learning.networks import (
    Draw,
    Moments,
    Net,
    Work,
    back_hidden,
    descend,
    fast,
    follow,
    forward,
    gather,
    make_moments,
    make_work,
)
from steersman.learning.off_policy import OffPolicySteering
from steersman.learning.replay_buffer import BUFFER_ARRAYS
from steersman.learning.sb3 import lay_flat

_ONE = np.float32(1.0)
_NETS = ("actor", "critic", "actor_target", "critic_target")


class Batch(NamedTuple):
    """The arrays of SB3's replay buffer."""

    observations: Any
    next_observations: Any
    actions: Any
    rewards: Any
    dones: Any
    timeouts: Any
    demonstrated: Any


class UpdateNumbers(NamedTuple):
    """The numbers of several updates."""

    rates: Any
    """(updates,) learning rates."""
    imitation: Any
    """(updates,) weights of the imitation loss."""
    q_filter: bool
    """Whether only demonstrated actions count that the critic rates above the actor's."""
    gamma: float
    tau: float


class Scratch(NamedTuple):
    """Scratch for a batch of B; actor and critic share theirs with their targets."""

    actor: Work
    critic: Work
    target: Any
    """(B, 1) bootstrapped values."""


@fast
def _drawn(actions: Any, draw: Draw, k: int, i: int, j: int) -> float:
    """Action ``j`` of sample ``i`` out of (rows, vehicles, actions); side -1 mirrored."""
    value = actions[draw.rows[k, i], draw.envs[k, i], j]
    return value * draw.turned[j] if draw.sides[k, i] < 0.0 else value  # type: ignore[no-any-return]


@fast
def _targets(
    batch: Batch, draw: Draw, k: int, actor: Net, critic: Net, gamma: float, work: Scratch
) -> None:
    """Bootstrapped values r + gamma (1 - done) Q'(s', mu'(s')) into ``work.target``."""
    of_actor, of_critic = work.actor, work.critic
    n = of_actor.x.shape[1]
    gather(batch.next_observations, draw, k, of_actor.x)
    forward(actor, of_actor)
    of_critic.x[:, :n] = of_actor.x
    for i in range(of_actor.x.shape[0]):
        for j in range(of_actor.y.shape[1]):
            of_critic.x[i, n + j] = math.tanh(of_actor.y[i, j])
    forward(critic, of_critic)
    for i in range(of_actor.x.shape[0]):
        row, env = draw.rows[k, i], draw.envs[k, i]
        final = batch.dones[row, env] * (_ONE - batch.timeouts[row, env])
        work.target[i, 0] = (
            batch.rewards[row, env] + (_ONE - final) * np.float32(gamma) * of_critic.y[i, 0]
        )


@fast
def _improve_critic(
    batch: Batch, draw: Draw, k: int, critic: Net, moments: Moments, rate: float, work: Scratch
) -> tuple[float, float]:
    """Descend the squared Bellman error; returns the loss and the mean value."""
    of_critic = work.critic
    n, count = work.actor.x.shape[1], work.actor.x.shape[0]
    gather(batch.observations, draw, k, work.actor.x)
    of_critic.x[:, :n] = work.actor.x
    for i in range(count):
        for j in range(draw.turned.shape[0]):
            of_critic.x[i, n + j] = _drawn(batch.actions, draw, k, i, j)
    forward(critic, of_critic)
    loss, mean = 0.0, 0.0
    for i in range(count):
        gap = of_critic.y[i, 0] - work.target[i, 0]
        of_critic.dy[i, 0] = np.float32(2.0 / count) * gap
        loss += gap * gap / count
        mean += of_critic.y[i, 0] / count
    descend(critic, moments, rate, of_critic)
    return loss, mean


@fast
def _imitate(
    batch: Batch, draw: Draw, k: int, critic: Net, numbers: UpdateNumbers, work: Scratch
) -> None:
    """Add the gradient of weight * mean (mu(s) - demonstrated action)^2 to ``work.actor.dy``.

    ``work`` holds mu(s) and Q(s, mu(s)). As ``imitation_loss.imitate`` does for other algorithms.
    """
    of_actor, of_critic, own = work.actor, work.critic, work.target
    n, count, weight = of_actor.x.shape[1], of_actor.x.shape[0], numbers.imitation[k]
    if numbers.q_filter:
        own[:] = of_critic.y
        for i in range(count):
            for j in range(draw.turned.shape[0]):
                wanted = _drawn(batch.demonstrated, draw, k, i, j)
                of_critic.x[i, n + j] = np.float32(0.0) if np.isnan(wanted) else wanted
        forward(critic, of_critic)
    for i in range(count):
        for j in range(draw.turned.shape[0]):
            wanted = _drawn(batch.demonstrated, draw, k, i, j)
            if not np.isnan(wanted) and (not numbers.q_filter or of_critic.y[i, 0] > own[i, 0]):
                y = of_actor.y[i, j]
                slope = np.float32(2.0 * weight / count) * (y - wanted)
                of_actor.dy[i, j] += slope * (_ONE - y * y)


@fast
def _improve_actor(
    batch: Batch,
    draw: Draw,
    k: int,
    actor: Net,
    critic: Net,
    moments: Moments,
    numbers: UpdateNumbers,
    work: Scratch,
) -> float:
    """Ascend Q(s, mu(s)) for the observations in ``work.actor.x``; returns the loss, -mean Q."""
    of_actor, of_critic = work.actor, work.critic
    n, count = of_actor.x.shape[1], of_actor.x.shape[0]
    forward(actor, of_actor)
    for i in range(count):
        for j in range(of_actor.y.shape[1]):
            of_actor.y[i, j] = math.tanh(of_actor.y[i, j])
            of_critic.x[i, n + j] = of_actor.y[i, j]
    forward(critic, of_critic)
    of_critic.dy[:] = np.float32(-1.0 / count)
    back_hidden(critic, of_critic)
    loss = 0.0
    for i in range(count):
        loss -= of_critic.y[i, 0] / count
        for o in range(of_actor.y.shape[1]):
            slope = np.float32(0.0)
            for j in range(critic.w1.shape[0]):
                slope += of_critic.d1[i, j] * critic.w1[j, n + o]
            of_actor.dy[i, o] = slope * (_ONE - of_actor.y[i, o] * of_actor.y[i, o])
    if numbers.imitation[k] > 0.0:
        _imitate(batch, draw, k, critic, numbers, work)
    descend(actor, moments, numbers.rates[k], of_actor)
    return loss


@fast
def update(
    batch: Batch,
    draw: Draw,
    numbers: UpdateNumbers,
    nets: tuple[Net, Net, Net, Net],
    moments: tuple[Moments, Moments],
    work: Scratch,
) -> tuple[float, float, float]:
    """Several updates from the transitions of ``draw``.

    ``nets`` are actor, critic and their targets; ``moments`` the actor's and the critic's.
    Returns the mean actor loss (without imitation), critic loss and value.
    """
    actor, critic, actor_target, critic_target = nets
    actor_loss, critic_loss, value = 0.0, 0.0, 0.0
    steps, tau = numbers.rates.shape[0], numbers.tau
    for k in range(steps):
        _targets(batch, draw, k, actor_target, critic_target, numbers.gamma, work)
        loss, mean = _improve_critic(batch, draw, k, critic, moments[1], numbers.rates[k], work)
        lost = _improve_actor(batch, draw, k, actor, critic, moments[0], numbers, work)
        actor_loss += lost / steps
        critic_loss += loss / steps
        value += mean / steps
        follow(critic_target.flat, critic.flat, tau)
        follow(actor_target.flat, actor.flat, tau)
    return actor_loss, critic_loss, value


class CompiledDDPG(OffPolicySteering, DDPG):
    """DDPG whose weights and Adam's moments are flat arrays that compiled code updates."""

    _nets: tuple[Net, Net, Net, Net] | None = None

    def _flat(self) -> tuple[Net, Net, Net, Net]:
        """All four networks, laid flat at the first call."""
        if self._nets is None:
            nets = [lay_flat([getattr(self, name)]) for name in _NETS]
            actor, critic, actor_target, critic_target = nets
            self._nets = actor, critic, actor_target, critic_target
            self.moments = make_moments(actor.flat.size), make_moments(critic.flat.size)
            size = self.batch_size
            works = make_work(actor, size), make_work(critic, size)
            self._scratch = Scratch(*works, np.zeros((size, 1), np.float32))
            self._arrays = Batch(*(getattr(self.buffer, name) for name in BUFFER_ARRAYS))
        return self._nets

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """Update ``gradient_steps`` times, as SB3's TD3.train with DDPG's settings."""
        nets, turns = self._flat(), [(k, gradient_steps) for k in range(gradient_steps)]
        loss = self.demonstration.loss
        numbers = UpdateNumbers(
            np.array([self.rate_at(*turn) for turn in turns]),
            np.array([self.loss_weight_at(*turn) for turn in turns]),
            loss is not None and loss.q_filter,
            self.gamma,
            self.tau,
        )
        draw = self.buffer.draw(gradient_steps, batch_size)
        self.last_losses = update(self._arrays, draw, numbers, nets, self.moments, self._scratch)
        self._n_updates += gradient_steps

    def actor_net(self) -> Net:
        """The actor's weights."""
        return self._flat()[0]

    def weights(self) -> dict[str, Any]:
        """All weights and Adam's moments, flat."""
        out = {name: net.flat for name, net in zip(_NETS, self._flat(), strict=True)}
        for name, m in zip(_NETS, self.moments, strict=False):
            out |= {f"{name}_first": m.first, f"{name}_second": m.second, f"{name}_count": m.count}
        return out
