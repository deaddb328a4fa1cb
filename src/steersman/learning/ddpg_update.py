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
from numba import njit
from stable_baselines3 import DDPG

from steersman.learning.networks import (
    FAST,
    Moments,
    Net,
    adam,
    back_hidden,
    follow,
    forward,
    make_moments,
    view_net,
    weight_gradients,
)
from steersman.learning.off_policy import BUFFER_ARRAYS, OffPolicySteering
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


class Draw(NamedTuple):
    """Which transitions each update learns from; the first three are (updates, B)."""

    rows: Any
    """Row of the buffer (int64)."""
    envs: Any
    """Vehicle (int64)."""
    sides: Any
    """1: the transition itself; -1: its mirror image, left for right (float32)."""
    mirror: Any
    """(features,) factor on each feature that mirrors it (float32)."""


class Scratch(NamedTuple):
    """Scratch arrays for a batch: inputs, hidden layers, gradients."""

    x: Any
    z: Any
    a1: Any
    a2: Any
    c1: Any
    c2: Any
    y: Any
    q: Any
    target: Any
    d1: Any
    d2: Any
    dy: Any
    actor_grad: Net
    critic_grad: Net


def make_scratch(batch: int, actor: Net, critic: Net) -> Scratch:
    """Scratch arrays for a batch size and the two networks.

    Raises:
        ValueError: their hidden layers differ in size.
    """

    def like(net: Net) -> Net:
        sizes = (net.w1.shape[1], net.w1.shape[0], net.w2.shape[0], net.w3.shape[0])
        return view_net(np.zeros_like(net.flat), sizes)

    inputs, pair = actor.w1.shape[1], critic.w1.shape[1]
    h1, h2 = actor.w1.shape[0], actor.w2.shape[0]
    if (h1, h2) != (critic.w1.shape[0], critic.w2.shape[0]):
        raise ValueError("actor and critic need hidden layers of the same sizes")
    widths = (inputs, pair, h1, h2, h1, h2, 1, 1, 1, h1, h2, 1)
    arrays: list[Any] = [np.zeros((batch, width), np.float32) for width in widths]
    return Scratch._make([*arrays, like(actor), like(critic)])


def draw_batches(buffer: Any, count: int, batch: int, mirror: Any) -> Draw:
    """Transitions for ``count`` updates, drawn as SB3's buffer draws them.

    So the same seed trains on the same batches. ``mirror`` holds the factor on each feature, or is
    None for no mirror images; otherwise half of each batch is mirrored.
    """
    size = buffer.buffer_size if buffer.full else buffer.pos
    rows = np.empty((count, batch), np.int64)
    envs = np.empty((count, batch), np.int64)
    for k in range(count):
        rows[k] = np.random.randint(0, size, size=batch)  # noqa: NPY002 - SB3's generator
        envs[k] = np.random.randint(0, high=buffer.n_envs, size=(batch,))  # noqa: NPY002
    sides = np.ones(rows.shape, np.float32)
    if mirror is None:
        return Draw(rows, envs, sides, np.ones(buffer.obs_shape, np.float32))
    coins = np.random.randint(0, 2, size=rows.shape)  # noqa: NPY002 - SB3's generator
    sides[coins == 0] = -1.0
    return Draw(rows, envs, sides, mirror)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def gather(source: Any, draw: Draw, k: int, out: Any) -> None:
    """Observations of update ``k``; those whose side is -1 mirrored."""
    for i in range(out.shape[0]):
        row, env, mirrored = draw.rows[k, i], draw.envs[k, i], draw.sides[k, i] < 0.0
        for j in range(source.shape[2]):
            value = source[row, env, j]
            out[i, j] = value * draw.mirror[j] if mirrored else value


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _targets(
    batch: Batch, draw: Draw, k: int, actor: Net, critic: Net, gamma: float, work: Scratch
) -> None:
    """Bootstrapped values r + gamma (1 - done) Q'(s', mu'(s')) into ``work.target``."""
    n = work.x.shape[1]
    gather(batch.next_observations, draw, k, work.x)
    forward(actor, work.x, work.a1, work.a2, work.y)
    work.z[:, :n] = work.x
    for i in range(work.x.shape[0]):
        work.z[i, n] = math.tanh(work.y[i, 0])
    forward(critic, work.z, work.c1, work.c2, work.q)
    for i in range(work.x.shape[0]):
        row, env = draw.rows[k, i], draw.envs[k, i]
        final = batch.dones[row, env] * (_ONE - batch.timeouts[row, env])
        work.target[i, 0] = (
            batch.rewards[row, env] + (_ONE - final) * np.float32(gamma) * work.q[i, 0]
        )


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _improve_critic(
    batch: Batch, draw: Draw, k: int, critic: Net, moments: Moments, rate: float, work: Scratch
) -> tuple[float, float]:
    """Descend the squared Bellman error; returns the loss and the mean value."""
    n, count = work.x.shape[1], work.x.shape[0]
    gather(batch.observations, draw, k, work.x)
    work.z[:, :n] = work.x
    for i in range(count):
        action = batch.actions[draw.rows[k, i], draw.envs[k, i], 0]
        work.z[i, n] = action * draw.sides[k, i]
    forward(critic, work.z, work.c1, work.c2, work.q)
    loss, mean = 0.0, 0.0
    for i in range(count):
        gap = work.q[i, 0] - work.target[i, 0]
        work.dy[i, 0] = np.float32(2.0 / count) * gap
        loss += gap * gap / count
        mean += work.q[i, 0] / count
    d1, d2 = work.d1, work.d2
    back_hidden(critic, work.dy, work.c1, work.c2, d1, d2)
    weight_gradients(work.z, work.c1, work.c2, work.dy, d1, d2, work.critic_grad)
    adam(critic.flat, work.critic_grad.flat, moments, rate)
    return loss, mean


@njit(cache=True, error_model="numpy", fastmath=FAST)
def improve_actor(actor: Net, critic: Net, moments: Moments, rate: float, work: Scratch) -> float:
    """Ascend Q(s, mu(s)) for the observations in ``work.x``; returns the loss, -mean Q."""
    n, count = work.x.shape[1], work.x.shape[0]
    forward(actor, work.x, work.a1, work.a2, work.y)
    for i in range(count):
        work.y[i, 0] = math.tanh(work.y[i, 0])
        work.z[i, n] = work.y[i, 0]
    forward(critic, work.z, work.c1, work.c2, work.q)
    work.dy[:] = np.float32(-1.0 / count)
    d1, d2 = work.d1, work.d2
    back_hidden(critic, work.dy, work.c1, work.c2, d1, d2)
    loss = 0.0
    for i in range(count):
        slope = np.float32(0.0)
        for j in range(critic.w1.shape[0]):
            slope += d1[i, j] * critic.w1[j, n]
        loss -= work.q[i, 0] / count
        work.dy[i, 0] = slope * (_ONE - work.y[i, 0] * work.y[i, 0])
    back_hidden(actor, work.dy, work.a1, work.a2, d1, d2)
    weight_gradients(work.x, work.a1, work.a2, work.dy, d1, d2, work.actor_grad)
    adam(actor.flat, work.actor_grad.flat, moments, rate)
    return loss


@njit(cache=True, error_model="numpy", fastmath=FAST)
def update(
    batch: Batch,
    draw: Draw,
    rates: Any,
    nets: tuple[Net, Net, Net, Net],
    moments: tuple[Moments, Moments],
    gamma: float,
    tau: float,
    work: Scratch,
) -> tuple[float, float, float]:
    """Several updates from the transitions of ``draw``, with learning ``rates`` (updates,).

    ``nets`` are actor, critic and their targets; ``moments`` the actor's and the critic's.
    Returns the mean actor loss, critic loss and value.
    """
    actor, critic, actor_target, critic_target = nets
    actor_loss, critic_loss, value = 0.0, 0.0, 0.0
    steps = rates.shape[0]
    for k in range(steps):
        _targets(batch, draw, k, actor_target, critic_target, gamma, work)
        loss, mean = _improve_critic(batch, draw, k, critic, moments[1], rates[k], work)
        actor_loss += improve_actor(actor, critic, moments[0], rates[k], work) / steps
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
            self._scratch = make_scratch(self.batch_size, actor, critic)
            self._arrays = Batch(*(getattr(self.replay_buffer, name) for name in BUFFER_ARRAYS))
        return self._nets

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """Update ``gradient_steps`` times, as SB3's TD3.train with DDPG's settings."""
        nets = self._flat()
        self.last_losses = update(
            self._arrays,
            draw_batches(self.replay_buffer, gradient_steps, batch_size, self.mirror),
            np.array([self.rate_at(k, gradient_steps) for k in range(gradient_steps)]),
            nets,
            self.moments,
            self.gamma,
            self.tau,
            self._scratch,
        )
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
