"""Least squares: a policy's network fitted to samples by mini-batches and Adam, compiled.

The same forward and backward functions as DDPG's updates (``learning.networks``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from steersman.learning import networks
from steersman.learning.imitation.config import FitConfig
from steersman.learning.imitation.sources import Dataset
from steersman.learning.networks import (
    FAST,
    Moments,
    Net,
    adam,
    back_hidden,
    forward,
    weight_gradients,
)
from steersman.learning.snapshot import Tree, fill

_ONE = np.float32(1.0)
# Updates between two looks at the clock and at the keyboard.
_CHUNK = 100


class SampleDraw(NamedTuple):
    """Which samples several updates learn from."""

    rows: Any
    """(updates, B) int64."""
    sides: Any
    """(updates, B) float32; 1: as it was; -1: its mirror image, left for right."""
    mirror: Any
    """(features,) float32 factor on each feature that mirrors it."""


class FitScratch(NamedTuple):
    """Scratch for a batch of B."""

    x: Any
    h1: Any
    h2: Any
    y: Any
    d1: Any
    d2: Any
    dy: Any
    grad: Net


@njit(cache=True, error_model="numpy", fastmath=FAST)
def descend(
    data: Dataset,
    draw: SampleDraw,
    rates: Any,
    net: Net,
    moments: Moments,
    bound: float,
    work: FitScratch,
) -> float:
    """One update of ``net`` for each of ``rates`` (updates,); returns the mean loss.

    Loss: mean e^2 with e = tanh(network) - action; beyond ``bound`` 2 bound |e| - bound^2.
    """
    count, total = work.x.shape[0], 0.0
    limit = np.float32(bound)
    for k in range(rates.shape[0]):
        for i in range(count):
            row, mirrored = draw.rows[k, i], draw.sides[k, i] < 0.0
            for j in range(work.x.shape[1]):
                value = data.features[row, j]
                work.x[i, j] = value * draw.mirror[j] if mirrored else value
        forward(net, work.x, work.h1, work.h2, work.y)
        for i in range(count):
            y = np.float32(math.tanh(work.y[i, 0]))
            gap = y - data.actions[draw.rows[k, i]] * draw.sides[k, i]
            held = min(max(gap, -limit), limit)
            total += held * (np.float32(2.0) * gap - held) / count
            work.dy[i, 0] = np.float32(2.0 / count) * held * (_ONE - y * y)
        back_hidden(net, work.dy, work.h1, work.h2, work.d1, work.d2)
        weight_gradients(work.x, work.h1, work.h2, work.dy, work.d1, work.d2, work.grad)
        adam(net.flat, work.grad.flat, moments, rates[k])
    return float(total / rates.shape[0])


class Regression:
    """A network being fitted.

    Its weights begin as torch's linear layers do: uniform, bounded by one over the root of the
    inputs.
    """

    def __init__(self, config: FitConfig, mirror: Any, seed: np.random.SeedSequence) -> None:
        """``mirror`` (features,): the factor on each feature that mirrors it."""
        self.config = config
        self._mirror = mirror.astype(np.float32)
        sizes = (len(mirror), *config.hidden, 1)
        self.net = _zeros(sizes)
        rng = np.random.default_rng(seed)
        for weights, bias in ((0, 1), (2, 3), (4, 5)):
            bound = self.net[weights].shape[1] ** -0.5
            for part in (self.net[weights], self.net[bias]):
                part[...] = rng.uniform(-bound, bound, part.shape)
        self.moments = networks.make_moments(self.net.flat.size)
        batch = config.batch
        h1, h2 = (np.zeros((batch, n), np.float32) for n in config.hidden)
        self._work = FitScratch(
            x=np.zeros((batch, len(mirror)), np.float32),
            h1=h1,
            h2=h2,
            y=np.zeros((batch, 1), np.float32),
            d1=np.zeros_like(h1),
            d2=np.zeros_like(h2),
            dy=np.zeros((batch, 1), np.float32),
            grad=_zeros(sizes),
        )

    @property
    def updates(self) -> int:
        """Updates so far."""
        return int(self.moments.count[0])

    def rate(self) -> float:
        """Learning rate of the next update."""
        return self._rate(self.updates)

    def _rate(self, update: int) -> float:
        return self.config.learning_rate.value(update, self.config.updates)

    def act(self, features: Any) -> Any:
        """The network's actions (n,) for features (n, k)."""
        return networks.act(self.net, features)

    def fit(
        self,
        data: Dataset,
        until: int,
        seed: np.random.SeedSequence,
        tick: Callable[[float], None],
    ) -> float:
        """Update until there were ``until`` updates in all; returns the mean loss.

        Batches are drawn evenly from all samples. ``tick`` is called with the share done.
        """
        rng, config = np.random.default_rng(seed), self.config
        first, total = self.updates, 0.0
        bound = math.inf if config.huber is None else config.huber
        while self.updates < until:
            count = min(_CHUNK, until - self.updates)
            shape = (count, config.batch)
            rows = rng.integers(len(data.actions), size=shape)
            sides = np.ones(shape, np.float32)
            if config.mirror:
                sides[rng.integers(2, size=shape) == 0] = -1.0
            rates = np.array([self._rate(self.updates + k) for k in range(count)])
            draw = SampleDraw(rows, sides, self._mirror)
            total += count * descend(data, draw, rates, self.net, self.moments, bound, self._work)
            tick((self.updates - first) / (until - first))
        return total / max(until - first, 1)

    def weights(self) -> dict[str, Any]:
        """Weights and Adam's moments, flat."""
        first, second, count = self.moments
        return {"net": self.net.flat, "first": first, "second": second, "count": count}

    def restore(self, saved: Tree) -> None:
        """Go on with these weights."""
        fill(self.weights(), saved)


def _zeros(sizes: tuple[int, int, int, int]) -> Net:
    count = sum((a + 1) * b for a, b in pairwise(sizes))
    return networks.view_net(np.zeros(count, np.float32), sizes)
