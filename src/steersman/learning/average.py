"""The mean of a policy's weights over a part of its training.

Weights that keep moving around a good place are, on average, nearer to it than any of them: Polyak
and Juditsky, Acceleration of stochastic approximation by averaging, SIAM J. Control and
Optimization 30, 1992; for networks Izmailov et al., Averaging weights leads to wider optima and
better generalization, UAI 2018. Here it takes away the small weaving that single policies of one
training differ in.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from steersman.learning.snapshot import Tree, fill


class WeightAverage:
    """Running mean of one flat array of weights."""

    def __init__(self, size: int) -> None:
        """The mean of nothing yet."""
        self._mean = np.zeros(size)
        self._count = np.zeros(1, np.int64)

    def add(self, weights: Any) -> None:
        """Take the present ``weights`` (size,) into the mean."""
        self._count[0] += 1
        self._mean += (weights - self._mean) / self._count[0]

    @contextmanager
    def within(self, weights: Any) -> Iterator[None]:
        """The mean in the place of ``weights`` for a while; without a mean, they stay."""
        if not self._count[0]:
            yield
            return
        own = weights.copy()
        weights[:] = self._mean
        try:
            yield
        finally:
            weights[:] = own

    def arrays(self) -> dict[str, Any]:
        """All that changes."""
        return {"mean": self._mean, "count": self._count}

    def restore(self, saved: Tree) -> None:
        """Go on from what ``arrays`` gave."""
        fill(self.arrays(), saved)
