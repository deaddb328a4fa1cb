"""The network of an imitation: its first weights, and its fit over the rounds."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from steersman.learning import networks
from steersman.learning.imitation.config import FitConfig
from steersman.learning.least_squares import Dataset, LeastSquares
from steersman.learning.snapshot import Tree, fill


class Regression:
    """A network being fitted.

    Its weights begin as torch's linear layers do: uniform, bounded by one over the root of the
    inputs.
    """

    def __init__(
        self, config: FitConfig, mirror: Any, turned: Any, seed: np.random.SeedSequence
    ) -> None:
        """``mirror`` (features,) and ``turned`` (actions,): the factors that mirror each."""
        self.config = config
        sizes = (len(mirror), *config.hidden, len(turned))
        size = sum((a + 1) * b for a, b in pairwise(sizes))
        self.net = networks.view_net(np.zeros(size, np.float32), sizes)
        rng = np.random.default_rng(seed)
        for weights, bias in ((0, 1), (2, 3), (4, 5)):
            bound = self.net[weights].shape[1] ** -0.5
            for part in (self.net[weights], self.net[bias]):
                part[...] = rng.uniform(-bound, bound, part.shape)
        self.moments = networks.make_moments(size)
        self._fit = LeastSquares(
            self.net,
            self.moments,
            networks.make_work(self.net, config.batch),
            mirror.astype(np.float32) if config.mirror else None,
            turned.astype(np.float32),
            math.inf if config.huber is None else config.huber,
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
        """The network's actions (n, m) for features (n, k)."""
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
        return self._fit.to(data, until, self._rate, np.random.default_rng(seed), tick)

    def weights(self) -> dict[str, Any]:
        """Weights and Adam's moments, flat."""
        first, second, count = self.moments
        return {"net": self.net.flat, "first": first, "second": second, "count": count}

    def restore(self, saved: Tree) -> None:
        """Go on with these weights."""
        fill(self.weights(), saved)
