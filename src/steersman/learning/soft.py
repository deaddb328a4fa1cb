"""SAC's update as one compiled function (see ``updates`` for DDPG's, ``twin`` for two critics).

The arithmetic is that of ``stable_baselines3.SAC.train``; a test compares both update by update.
Source: Haarnoja et al., Soft actor-critic algorithms and applications, arXiv:1812.05905, alg. 1 and
app. C (the squashed Gaussian).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from steersman.learning.twin import Critics, bootstrap, critic_gradient, place
from steersman.learning.updates import (
    FAST,
    Batch,
    Draw,
    Moments,
    Net,
    Work,
    adam,
    back_hidden,
    follow,
    forward,
    gather,
    weight_gradients,
)

_ONE = np.float32(1.0)
# SB3's bounds of the deviation's logarithm, and what keeps the squashed density finite.
_LOW, _HIGH, _TINY = np.float32(-20.0), np.float32(2.0), np.float32(1e-6)
_HALF_LOG_2_PI = np.float32(0.5 * math.log(2.0 * math.pi))


class Policy(NamedTuple):
    """A Gaussian, squashed by tanh; ``flat`` holds all its weights, the mean's first."""

    mean: Net
    w: Any
    """(1, hidden) from the mean's last hidden layer to the deviation's logarithm."""
    b: Any
    flat: Any


class Entropy(NamedTuple):
    """The entropy's coefficient."""

    log: Any
    """(1,) its logarithm (float32)."""
    moments: Moments
    target: float
    """Entropy that it aims at [nat]."""
    learns: bool


class Learner(NamedTuple):
    """The networks that SAC trains, the targets that follow, Adam's state, and scratch."""

    policy: Policy
    critics: Critics
    critics_target: Critics
    entropy: Entropy
    policy_moments: Moments
    critic_moments: Moments
    policy_gradient: Policy
    critic_gradient: Critics


class Drawn(NamedTuple):
    """Actions drawn for a batch, each (B,) float32, and scratch beside ``Work``."""

    action: Any
    log_prob: Any
    deviation: Any
    inside: Any
    """1 where the deviation's logarithm is within its bounds, else 0."""
    cost: Any
    slope: Any
    e1: Any
    e2: Any
    q: Any


def make_drawn(work: Work) -> Drawn:
    """Arrays for a batch."""
    six = [np.zeros(work.x.shape[0], np.float32) for _ in range(6)]
    return Drawn(*six, *(np.zeros_like(scratch) for scratch in (work.c1, work.c2, work.q)))


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _act(policy: Policy, noise: Any, work: Work, drawn: Drawn) -> None:
    """Draw actions for ``work.x`` with standard normal ``noise`` (B,), and their densities."""
    forward(policy.mean, work.x, work.a1, work.a2, work.y)
    for i in range(noise.shape[0]):
        log_std = policy.b[0]
        for j in range(work.a2.shape[1]):
            log_std += work.a2[i, j] * policy.w[0, j]
        drawn.inside[i] = _ONE if _LOW <= log_std <= _HIGH else np.float32(0.0)
        log_std = min(max(log_std, _LOW), _HIGH)
        drawn.deviation[i] = math.exp(log_std)
        action = np.float32(math.tanh(work.y[i, 0] + drawn.deviation[i] * noise[i]))
        drawn.action[i] = action
        gaussian = -np.float32(0.5) * noise[i] * noise[i] - log_std - _HALF_LOG_2_PI
        drawn.log_prob[i] = gaussian - math.log(_ONE - action * action + _TINY)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _look_ahead(
    batch: Batch, draw: Draw, k: int, noise: Any, learner: Learner, work: Work, drawn: Drawn
) -> float:
    """Actions for the next observations into ``work.z``; their price into ``drawn.cost``.

    Returns the coefficient of the entropy.
    """
    n = work.x.shape[1]
    alpha = np.float32(math.exp(learner.entropy.log[0]))
    gather(batch.next_observations, draw, k, work.x)
    _act(learner.policy, noise, work, drawn)
    work.z[:, :n] = work.x
    work.z[:, n] = drawn.action
    for i in range(noise.shape[0]):
        drawn.cost[i] = alpha * drawn.log_prob[i]
    return float(alpha)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _slopes(critics: Critics, work: Work, drawn: Drawn) -> float:
    """Slope of the smaller Q over the action into ``drawn.slope``; returns the mean of that Q.

    ``work.z`` holds observations and actions.
    """
    n, count = work.x.shape[1], work.x.shape[0]
    forward(critics.first, work.z, work.c1, work.c2, work.q)
    forward(critics.second, work.z, drawn.e1, drawn.e2, drawn.q)
    total = 0.0
    for i in range(count):
        total += min(work.q[i, 0], drawn.q[i, 0])
        work.dy[i, 0] = _ONE if work.q[i, 0] <= drawn.q[i, 0] else np.float32(0.0)
    back_hidden(critics.first, work.dy, work.c1, work.c2, work.d1, work.d2)
    for i in range(count):
        slope = np.float32(0.0)
        for j in range(work.d1.shape[1]):
            slope += work.d1[i, j] * critics.first.w1[j, n]
        drawn.slope[i] = slope
        work.dy[i, 0] = _ONE - work.dy[i, 0]
    back_hidden(critics.second, work.dy, drawn.e1, drawn.e2, work.d1, work.d2)
    for i in range(count):
        slope = np.float32(0.0)
        for j in range(work.d1.shape[1]):
            slope += work.d1[i, j] * critics.second.w1[j, n]
        drawn.slope[i] += slope
    return float(total / count)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _policy_gradient(
    policy: Policy, noise: Any, alpha: float, grad: Policy, work: Work, drawn: Drawn
) -> None:
    """Gradient of mean (alpha log pi(a) - Q(s, a)), a drawn with ``noise``, into ``grad``.

    With u = m + e^s n and a = tanh u: log pi = -n^2 / 2 - s - log(1 - a^2 + tiny) + constant, so
    its derivative is 2 a (1 - a^2) / (1 - a^2 + tiny) over u, and -1 more over s.
    """
    count, d1, d2 = noise.shape[0], work.d1, work.d2
    grad.w[:] = np.float32(0.0)
    grad.b[0] = np.float32(0.0)
    share, price = np.float32(1.0 / count), np.float32(alpha)
    for i in range(count):
        action = drawn.action[i]
        open_ = _ONE - action * action
        over_action = price * np.float32(2.0) * action / (open_ + _TINY) - drawn.slope[i]
        over_mean = share * over_action * open_
        over_log = over_mean * drawn.deviation[i] * noise[i] - share * price
        over_log *= drawn.inside[i]
        work.dy[i, 0] = over_mean
        grad.b[0] += over_log
        for j in range(d2.shape[1]):
            grad.w[0, j] += over_log * work.a2[i, j]
            back = over_mean * policy.mean.w3[0, j] + over_log * policy.w[0, j]
            d2[i, j] = back if work.a2[i, j] > 0.0 else np.float32(0.0)
    np.dot(d2, policy.mean.w2, d1)
    for i in range(count):
        for j in range(d1.shape[1]):
            if work.a1[i, j] <= 0.0:
                d1[i, j] = np.float32(0.0)
    weight_gradients(work.x, work.a1, work.a2, work.dy, d1, d2, grad.mean)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _improve_policy(
    noise: Any, alpha: float, rate: float, learner: Learner, work: Work, drawn: Drawn
) -> float:
    """Policy and entropy's coefficient learn from the observations in ``work.x``.

    Returns the policy's loss.
    """
    n, count = work.x.shape[1], work.x.shape[0]
    _act(learner.policy, noise, work, drawn)
    work.z[:, n] = drawn.action
    value = _slopes(learner.critics, work, drawn)
    _policy_gradient(learner.policy, noise, alpha, learner.policy_gradient, work, drawn)
    adam(learner.policy.flat, learner.policy_gradient.flat, learner.policy_moments, rate)
    mean = 0.0
    for i in range(count):
        mean += drawn.log_prob[i] / count
    entropy = learner.entropy
    if entropy.learns:
        gradient = np.full(1, -np.float32(mean + entropy.target), np.float32)
        adam(entropy.log, gradient, entropy.moments, rate)
    return alpha * mean - value


@njit(cache=True, error_model="numpy", fastmath=FAST)
def update(
    batch: Batch,
    draw: Draw,
    noise: Any,
    rates: Any,
    learner: Learner,
    constants: tuple[float, float],
    work: Work,
    drawn: Drawn,
) -> tuple[float, float, float]:
    """Several updates from the transitions of ``draw``, with learning ``rates`` (updates,).

    ``noise`` (updates, 2, B) is standard normal, for the actions now and next; ``constants`` are
    gamma and tau. Returns the mean policy loss, critic loss and value of the first critic.
    """
    gamma, tau = constants
    critics, grad = learner.critics, learner.critic_gradient
    policy_loss, critic_loss, value = 0.0, 0.0, 0.0
    steps = rates.shape[0]
    for k in range(steps):
        alpha = _look_ahead(batch, draw, k, noise[k, 1], learner, work, drawn)
        bootstrap(batch, draw, k, learner.critics_target, drawn.cost, gamma, work)
        place(batch, draw, k, work)
        first, mean = critic_gradient(critics.first, grad.first, 0.5, work)
        second, _ = critic_gradient(critics.second, grad.second, 0.5, work)
        adam(critics.flat, grad.flat, learner.critic_moments, rates[k])
        critic_loss += (first + second) / steps
        value += mean / steps
        policy_loss += _improve_policy(noise[k, 0], alpha, rates[k], learner, work, drawn) / steps
        follow(learner.critics_target.flat, critics.flat, tau)
    return policy_loss, critic_loss, value
