"""Two critics as compiled functions, and TD3's update made of them (see ``updates`` for DDPG's).

The arithmetic is that of ``stable_baselines3.TD3.train``; a test compares both update by update.
Source: Fujimoto, van Hoof and Meger, Addressing function approximation error in actor-critic
methods, ICML 2018, alg. 1.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

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
    improve_actor,
    weight_gradients,
)

_ONE = np.float32(1.0)


class Critics(NamedTuple):
    """Two critics; ``flat`` holds the weights of both, one after the other."""

    first: Net
    second: Net
    flat: Any


class Learner(NamedTuple):
    """The networks that TD3 trains, the targets that follow them, and Adam's state."""

    actor: Net
    critics: Critics
    actor_target: Net
    critics_target: Critics
    actor_moments: Moments
    critic_moments: Moments
    gradient: Critics
    """Scratch."""


class Rules(NamedTuple):
    """TD3's constants."""

    gamma: float
    tau: float
    delay: int
    """The actor and the targets follow once in so many updates."""
    done: int
    """Updates that went before."""


@njit(cache=True, error_model="numpy", fastmath=FAST)
def bootstrap(
    batch: Batch, draw: Draw, k: int, critics: Critics, cost: Any, gamma: float, work: Work
) -> None:
    """Fill ``work.target`` with r + gamma (1 - done) (min Q(z) - cost), z from ``work.z``."""
    forward(critics.first, work.z, work.c1, work.c2, work.target)
    forward(critics.second, work.z, work.c1, work.c2, work.q)
    for i in range(work.z.shape[0]):
        row, env = draw.rows[k, i], draw.envs[k, i]
        final = batch.dones[row, env] * (_ONE - batch.timeouts[row, env])
        value = min(work.target[i, 0], work.q[i, 0]) - cost[i]
        work.target[i, 0] = batch.rewards[row, env] + (_ONE - final) * np.float32(gamma) * value


@njit(cache=True, error_model="numpy", fastmath=FAST)
def place(batch: Batch, draw: Draw, k: int, work: Work) -> None:
    """Observations of update ``k`` into ``work.x``, they and their actions into ``work.z``."""
    n = work.x.shape[1]
    gather(batch.observations, draw, k, work.x)
    work.z[:, :n] = work.x
    for i in range(work.x.shape[0]):
        work.z[i, n] = batch.actions[draw.rows[k, i], draw.envs[k, i], 0] * draw.sides[k, i]


@njit(cache=True, error_model="numpy", fastmath=FAST)
def critic_gradient(net: Net, grad: Net, share: float, work: Work) -> tuple[float, float]:
    """Gradient of share mean (Q(z) - target)^2 into ``grad``; returns that loss and the mean Q."""
    forward(net, work.z, work.c1, work.c2, work.q)
    count = work.z.shape[0]
    loss, mean = 0.0, 0.0
    for i in range(count):
        gap = work.q[i, 0] - work.target[i, 0]
        work.dy[i, 0] = np.float32(2.0 * share / count) * gap
        loss += share * gap * gap / count
        mean += work.q[i, 0] / count
    back_hidden(net, work.dy, work.c1, work.c2, work.d1, work.d2)
    weight_gradients(work.z, work.c1, work.c2, work.dy, work.d1, work.d2, grad)
    return loss, mean


@njit(cache=True, error_model="numpy", fastmath=FAST)
def _look_ahead(batch: Batch, draw: Draw, k: int, actor: Net, noise: Any, work: Work) -> None:
    """Next observations and the target policy's actions for them into ``work.z``."""
    n = work.x.shape[1]
    gather(batch.next_observations, draw, k, work.x)
    forward(actor, work.x, work.a1, work.a2, work.y)
    work.z[:, :n] = work.x
    for i in range(work.x.shape[0]):
        action = math.tanh(work.y[i, 0]) + noise[k, i]
        work.z[i, n] = min(max(action, -1.0), 1.0)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def update(
    batch: Batch, draw: Draw, noise: Any, rates: Any, learner: Learner, rules: Rules, work: Work
) -> tuple[float, float, float]:
    """Several updates from the transitions of ``draw``, with learning ``rates`` (updates,).

    ``noise`` (updates, B) is what the targets' actions get. Returns the mean actor loss (NaN if
    the actor did not learn), critic loss and value of the first critic.
    """
    actor, critics, grad = learner.actor, learner.critics, learner.gradient
    actor_loss, critic_loss, value, turns = 0.0, 0.0, 0.0, 0
    steps, free = rates.shape[0], np.zeros(noise.shape[1], np.float32)
    for k in range(steps):
        _look_ahead(batch, draw, k, learner.actor_target, noise, work)
        bootstrap(batch, draw, k, learner.critics_target, free, rules.gamma, work)
        place(batch, draw, k, work)
        first, mean = critic_gradient(critics.first, grad.first, 1.0, work)
        second, _ = critic_gradient(critics.second, grad.second, 1.0, work)
        adam(critics.flat, grad.flat, learner.critic_moments, rates[k])
        critic_loss += (first + second) / steps
        value += mean / steps
        if (rules.done + k + 1) % rules.delay == 0:
            moments = learner.actor_moments
            actor_loss += improve_actor(actor, critics.first, moments, rates[k], work)
            turns += 1
            follow(learner.critics_target.flat, critics.flat, rules.tau)
            follow(learner.actor_target.flat, actor.flat, rules.tau)
    return actor_loss / turns if turns else math.nan, critic_loss, value
