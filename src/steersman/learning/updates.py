"""DDPG's update for two-hidden-layer ReLU networks as one compiled function over BLAS.

The arithmetic is that of ``stable_baselines3.TD3.train`` with DDPG's settings (one critic, no
target noise, no delay) and of ``torch.optim.Adam``; a test compares both update by update.
Weights are torch's own memory: every network's parameters are views of one flat array. On CPUs
where torch's BLAS is slow (MKL on AMD) this is several times faster than autograd.

Sources: Lillicrap et al., Continuous control with deep reinforcement learning, 2016, alg. 1;
Kingma and Ba, Adam, 2015, alg. 1.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

_BETA1, _BETA2, _EPS = np.float32(0.9), np.float32(0.999), np.float32(1e-8)
_ONE = np.float32(1.0)
# Sums may be reordered (so that they vectorise); NaN and infinity keep their meaning.
FAST = {"reassoc", "contract", "nsz", "arcp"}


class Net(NamedTuple):
    """Weights (out, in) and biases of one network, views of ``flat``."""

    w1: Any
    b1: Any
    w2: Any
    b2: Any
    w3: Any
    b3: Any
    flat: Any


class Moments(NamedTuple):
    """Adam's first and second moments, flat, and the number of updates as ``count[0]``."""

    first: Any
    second: Any
    count: Any


class Batch(NamedTuple):
    """The arrays of SB3's replay buffer."""

    observations: Any
    next_observations: Any
    actions: Any
    rewards: Any
    dones: Any
    timeouts: Any


class Draw(NamedTuple):
    """Which transitions several updates learn from; the first three are (updates, B)."""

    rows: Any
    """Row of the buffer (int64)."""
    envs: Any
    """Vehicle (int64)."""
    sides: Any
    """1: as it was; -1: its mirror image, left for right (float32)."""
    mirror: Any
    """(features,) factor on each feature that mirrors it (float32)."""


class Work(NamedTuple):
    """Scratch for a batch of B: inputs, hidden layers, gradients."""

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


def view_net(flat: Any, sizes: tuple[int, int, int, int]) -> Net:
    """Views of a flat array as (input, hidden, hidden, output) layers in torch's order."""
    parts, at = [], 0
    for rows, columns in zip(sizes[1:], sizes[:-1], strict=True):
        parts.append(flat[at : at + rows * columns].reshape(rows, columns))
        at += rows * columns
        parts.append(flat[at : at + rows])
        at += rows
    if at != flat.size:
        raise ValueError(f"{flat.size} parameters do not fill layers of {sizes}, which have {at}")
    w1, b1, w2, b2, w3, b3 = parts
    return Net(w1, b1, w2, b2, w3, b3, flat)


def act(net: Net, features: Any) -> Any:
    """A policy's actions tanh(network(features)), (n,) in [-1, 1], for features (n, k)."""
    h1 = np.maximum(features.astype(np.float32) @ net.w1.T + net.b1, 0.0)
    h2 = np.maximum(h1 @ net.w2.T + net.b2, 0.0)
    return np.tanh((h2 @ net.w3.T + net.b3)[:, 0]).astype(np.float64)


def make_moments(size: int) -> Moments:
    """Adam's state before the first update."""
    return Moments(np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(1, np.int64))


def make_work(batch: int, actor: Net, critic: Net) -> Work:
    """Scratch arrays for a batch size and the two networks."""

    def zeros(*shape: int) -> Any:
        return np.zeros(shape, np.float32)

    def like(net: Net) -> Net:
        sizes = (net.w1.shape[1], net.w1.shape[0], net.w2.shape[0], net.w3.shape[0])
        return view_net(np.zeros_like(net.flat), sizes)

    h1, h2 = actor.w1.shape[0], actor.w2.shape[0]
    if (h1, h2) != (critic.w1.shape[0], critic.w2.shape[0]):
        raise ValueError("actor and critic need hidden layers of the same sizes")
    return Work(
        x=zeros(batch, actor.w1.shape[1]),
        z=zeros(batch, critic.w1.shape[1]),
        a1=zeros(batch, actor.w1.shape[0]),
        a2=zeros(batch, actor.w2.shape[0]),
        c1=zeros(batch, critic.w1.shape[0]),
        c2=zeros(batch, critic.w2.shape[0]),
        y=zeros(batch, 1),
        q=zeros(batch, 1),
        target=zeros(batch, 1),
        d1=zeros(batch, h1),
        d2=zeros(batch, h2),
        dy=zeros(batch, 1),
        actor_grad=like(actor),
        critic_grad=like(critic),
    )


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _bias_relu(h: Any, b: Any) -> None:
    for i in range(h.shape[0]):
        for j in range(h.shape[1]):
            value = h[i, j] + b[j]
            h[i, j] = value if value > 0.0 else np.float32(0.0)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def forward(net: Net, x: Any, h1: Any, h2: Any, y: Any) -> None:
    """Fill y (B, 1) with network(x), keeping the hidden layers for the way back."""
    np.dot(x, net.w1.T, h1)
    _bias_relu(h1, net.b1)
    np.dot(h1, net.w2.T, h2)
    _bias_relu(h2, net.b2)
    for i in range(x.shape[0]):
        total = net.b3[0]
        for j in range(h2.shape[1]):
            total += h2[i, j] * net.w3[0, j]
        y[i, 0] = total


@njit(cache=True, error_model="numpy", fastmath=FAST)
def back_hidden(net: Net, dy: Any, h1: Any, h2: Any, d1: Any, d2: Any) -> None:
    """Gradients at the hidden layers' inputs from the gradient at the output."""
    for i in range(dy.shape[0]):
        for j in range(h2.shape[1]):
            d2[i, j] = dy[i, 0] * net.w3[0, j] if h2[i, j] > 0.0 else np.float32(0.0)
    np.dot(d2, net.w2, d1)
    for i in range(dy.shape[0]):
        for j in range(h1.shape[1]):
            if h1[i, j] <= 0.0:
                d1[i, j] = np.float32(0.0)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def weight_gradients(x: Any, h1: Any, h2: Any, dy: Any, d1: Any, d2: Any, grad: Net) -> None:
    """Gradients of all weights from those at the layers' inputs; sums over the batch."""
    np.dot(d1.T, x, grad.w1)
    np.dot(d2.T, h1, grad.w2)
    grad.b1[:] = np.float32(0.0)
    grad.b2[:] = np.float32(0.0)
    grad.w3[:] = np.float32(0.0)
    total = np.float32(0.0)
    for i in range(dy.shape[0]):
        total += dy[i, 0]
        for j in range(d1.shape[1]):
            grad.b1[j] += d1[i, j]
        for j in range(d2.shape[1]):
            grad.b2[j] += d2[i, j]
            grad.w3[0, j] += dy[i, 0] * h2[i, j]
    grad.b3[0] = total


@njit(cache=True, error_model="numpy", fastmath=FAST)
def adam(weights: Any, gradient: Any, moments: Moments, rate: float) -> None:
    """One step of Adam in torch's arrangement (bias corrections in double precision)."""
    moments.count[0] += 1
    count = moments.count[0]
    step = np.float32(rate / (1.0 - 0.9**count))
    root = np.float32(1.0 / math.sqrt(1.0 - 0.999**count))
    first, second = moments.first, moments.second
    for i in range(weights.shape[0]):
        g = gradient[i]
        first[i] += (_ONE - _BETA1) * (g - first[i])
        second[i] = _BETA2 * second[i] + (_ONE - _BETA2) * g * g
        weights[i] -= step * first[i] / (np.sqrt(second[i]) * root + _EPS)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def follow(slow: Any, own: Any, tau: float) -> None:
    """Move a target's weights by the share ``tau`` towards a network's own."""
    share = np.float32(tau)
    for i in range(slow.shape[0]):
        slow[i] += share * (own[i] - slow[i])


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
    batch: Batch, draw: Draw, k: int, actor: Net, critic: Net, gamma: float, work: Work
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
    batch: Batch, draw: Draw, k: int, critic: Net, moments: Moments, rate: float, work: Work
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
def improve_actor(actor: Net, critic: Net, moments: Moments, rate: float, work: Work) -> float:
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
    work: Work,
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
