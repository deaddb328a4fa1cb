"""Least squares: a policy's network fitted to samples by mini-batches and Adam, compiled.

The same forward and backward functions as DDPG's updates (``learning.networks``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from steersman.learning import networks
from steersman.learning.imitation.config import FitConfig
from steersman.learning.imitation.driving import Dataset
from steersman.learning.networks import Draw, Moments, Net, Work, descend, fast, forward, gather
from steersman.learning.snapshot import Tree, fill

_ONE = np.float32(1.0)
# Updates between two looks at the clock and at the keyboard.
_CHUNK = 100


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

    Loss: mean e^2 with e = tanh(network) - action; beyond ``bound`` 2 bound |e| - bound^2.
    """
    count, total = work.x.shape[0], 0.0
    limit = np.float32(bound)
    features = data.features.reshape(data.features.shape[0], 1, data.features.shape[1])
    for k in range(rates.shape[0]):
        gather(features, draw, k, work.x)
        forward(net, work)
        for i in range(count):
            y = np.float32(math.tanh(work.y[i, 0]))
            gap = y - data.actions[draw.rows[k, i]] * draw.sides[k, i]
            held = min(max(gap, -limit), limit)
            total += held * (np.float32(2.0) * gap - held) / count
            work.dy[i, 0] = np.float32(2.0 / count) * held * (_ONE - y * y)
        descend(net, moments, rates[k], work)
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
        size = sum((a + 1) * b for a, b in pairwise(sizes))
        self.net = networks.view_net(np.zeros(size, np.float32), sizes)
        rng = np.random.default_rng(seed)
        for weights, bias in ((0, 1), (2, 3), (4, 5)):
            bound = self.net[weights].shape[1] ** -0.5
            for part in (self.net[weights], self.net[bias]):
                part[...] = rng.uniform(-bound, bound, part.shape)
        self.moments = networks.make_moments(self.net.flat.size)
        self._work = networks.make_work(self.net, config.batch)

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
            draw = Draw(rows, np.zeros_like(rows), sides, self._mirror)
            total += count * update(data, draw, rates, self.net, self.moments, bound, self._work)
            tick((self.updates - first) / (until - first))
        return total / max(until - first, 1)

    def weights(self) -> dict[str, Any]:
        """Weights and Adam's moments, flat."""
        first, second, count = self.moments
        return {"net": self.net.flat, "first": first, "second": second, "count": count}

    def restore(self, saved: Tree) -> None:
        """Go on with these weights."""
        fill(self.weights(), saved)
