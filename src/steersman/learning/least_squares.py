"""Least squares: a policy's network fitted to samples by mini-batches and Adam, compiled.

The same forward and backward functions as DDPG's updates (``learning.networks``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from steersman.learning.networks import Draw, Moments, Net, Work, descend, fast, forward, gather

_ONE = np.float32(1.0)
# Updates between two looks at the clock and at the keyboard.
_CHUNK = 100


class Dataset(NamedTuple):
    """What a network is fitted to, wherever it comes from."""

    features: Any
    """(n, k) float32, the network's input: scaled and clipped."""
    actions: Any
    """(n, m) float32 in [-1, 1], the output that it is fitted to."""

    @classmethod
    def empty(cls, features: int, actions: int) -> Dataset:
        """No samples yet."""
        return cls(np.zeros((0, features), np.float32), np.zeros((0, actions), np.float32))

    def joined(self, other: Dataset) -> Dataset:
        """These samples, then the other's."""
        return Dataset(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))


@fast
def update(
    data: Dataset,
    draw: Draw,
    rates: Any,
    net: Net,
    moments: Moments,
    bound: float,
    work: Work,
) -> float:
    """One update of ``net`` for each of ``rates`` (updates,); returns the mean loss.

    Loss: mean over samples of the sum of e^2 with e = tanh(network) - action; beyond ``bound`` of
    2 bound |e| - bound^2.
    """
    count, total = work.x.shape[0], 0.0
    limit = np.float32(bound)
    features = data.features.reshape(data.features.shape[0], 1, data.features.shape[1])
    for k in range(rates.shape[0]):
        gather(features, draw, k, work.x)
        forward(net, work)
        for i in range(count):
            for j in range(draw.turned.shape[0]):
                y = np.float32(math.tanh(work.y[i, j]))
                wanted = data.actions[draw.rows[k, i], j]
                gap = y - (wanted * draw.turned[j] if draw.sides[k, i] < 0.0 else wanted)
                held = min(max(gap, -limit), limit)
                total += held * (np.float32(2.0) * gap - held) / count
                work.dy[i, j] = np.float32(2.0 / count) * held * (_ONE - y * y)
        descend(net, moments, rates[k], work)
    return float(total / rates.shape[0])


class LeastSquares(NamedTuple):
    """A network being fitted."""

    net: Net
    moments: Moments
    work: Work
    """Scratch; its size is that of a batch."""
    mirror: Any
    """(features,) factor on each feature that mirrors it, float32; half of each batch is mirrored.
    None: no mirror images."""
    turned: Any
    """(actions,) factor on each action that mirrors it, float32."""
    bound: float = math.inf
    """Errors of the action beyond this count linearly."""

    def to(
        self,
        data: Dataset,
        until: int,
        rate: Callable[[int], float],
        rng: np.random.Generator,
        tick: Callable[[float], None] = lambda _: None,
    ) -> float:
        """Update until there were ``until`` updates in all; returns the mean loss.

        Args:
            data: batches are drawn evenly from all of its samples.
            until: updates, those before this call included.
            rate: learning rate of an update by its number.
            rng: draws the batches.
            tick: called with the share done.
        """
        done, total = int(self.moments.count[0]), 0.0
        first = done
        while done < until:
            shape = min(_CHUNK, until - done), len(self.work.x)
            rows = rng.integers(len(data.actions), size=shape)
            sides, mirror = np.ones(shape, np.float32), self.mirror
            if mirror is None:
                mirror = np.ones(data.features.shape[1], np.float32)
            else:
                sides[rng.integers(2, size=shape) == 0] = -1.0
            rates = np.array([rate(done + k) for k in range(shape[0])])
            draw = Draw(rows, np.zeros_like(rows), sides, mirror, self.turned)
            mean = update(data, draw, rates, self.net, self.moments, self.bound, self.work)
            done, total = done + shape[0], total + shape[0] * mean
            tick((done - first) / (until - first))
        return total / max(until - first, 1)
