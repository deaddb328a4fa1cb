"""Statistics over few seeds: interquartile means, quartiles, bootstrap intervals, times to reach.

Sources: R. Agarwal et al., "Deep reinforcement learning at the edge of the statistical
precipice", *NeurIPS* 2021 (interquartile mean, stratified bootstrap); P. Royston and M. Parmar,
"Restricted mean survival time", *BMC Medical Research Methodology* 13, 2013.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from steersman.types import FloatArray

REPETITIONS = 2000
LEVEL = 0.95


class Interval(NamedTuple):
    """An estimate and the ends of its interval."""

    value: float
    low: float
    high: float


def iqm(values: ArrayLike) -> float:
    """Interquartile mean: the mean without the lowest and the highest quarter (rounded down).

    >>> iqm([1.0, 2.0, 3.0, 4.0, 100.0])
    3.0
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    cut = ordered.size // 4
    return float(ordered[cut : ordered.size - cut].mean()) if ordered.size else math.nan


def quartiles(values: ArrayLike) -> tuple[float, float, float]:
    """25th, 50th and 75th percentile; infinite values count as larger than all others.

    >>> quartiles([1.0, 2.0, 3.0, 4.0, 5.0])
    (2.0, 3.0, 4.0)
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    if not ordered.size:
        return (math.nan,) * 3
    low, middle, high = (_at(ordered, q) for q in (0.25, 0.5, 0.75))
    return low, middle, high


def _at(ordered: FloatArray, q: float) -> float:
    """Linear between order statistics, without inf - inf."""
    place = q * (ordered.size - 1)
    i = math.floor(place)
    share = place - i
    if share == 0.0:
        return float(ordered[i])
    return float(ordered[i] * (1.0 - share) + ordered[i + 1] * share)


def bootstrap(
    statistic: Callable[..., float],
    *groups: ArrayLike,
    repetitions: int = REPETITIONS,
    level: float = LEVEL,
    seed: int = 0,
) -> Interval:
    """Percentile interval of ``statistic(*groups)``, every group resampled within itself.

    With five seeds in a group the interval is rough: it cannot reach beyond what was seen.
    """
    arrays = [np.asarray(g, dtype=np.float64) for g in groups]
    if any(not a.size for a in arrays):
        return Interval(math.nan, math.nan, math.nan)
    rng = np.random.default_rng(seed)
    draws = np.array(
        [statistic(*(a[rng.integers(a.size, size=a.size)] for a in arrays))
         for _ in range(repetitions)]
    )  # fmt: skip
    draws = draws[np.isfinite(draws)]
    if not draws.size:
        return Interval(statistic(*arrays), math.nan, math.nan)
    low, high = np.quantile(draws, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    return Interval(float(statistic(*arrays)), float(low), float(high))


# From a function that gives the mean of any values in each draw to the statistic of each draw.
Statistic: TypeAlias = Callable[[Callable[[ArrayLike], FloatArray]], Any]


def of_draws(found: ArrayLike, level: float = LEVEL) -> Interval:
    """The interval of a statistic whose first value is the sample's, and the others the draws'."""
    value, *draws = np.asarray(found, dtype=np.float64)
    low, high = np.quantile(draws, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    return Interval(float(value), float(low), float(high))


class Clusters:
    """Percentile intervals for statistics of means over items that come in clusters.

    Items of one cluster are alike (scenarios on one road), so clusters are drawn as a whole, with
    replacement. Two statistics over the same items are drawn alike, so that differences and
    ratios are paired. Source: A. Davison and D. Hinkley, *Bootstrap Methods and their
    Application*, 1997, sec. 3.8.
    """

    def __init__(
        self,
        names: Sequence[str],
        *,
        repetitions: int = REPETITIONS,
        level: float = LEVEL,
        seed: int = 0,
    ) -> None:
        """``names`` holds the cluster of every item."""
        self._level = level
        _, self._cluster = np.unique(np.asarray(names, dtype=str), return_inverse=True)
        count = int(self._cluster.max()) + 1 if self._cluster.size else 0
        self._sizes = np.bincount(self._cluster, minlength=count).astype(np.float64)
        # Row 0 is the sample itself; then how often each cluster was drawn.
        self._drawn = np.ones((1, count))
        if count:
            rng = np.random.default_rng(seed)
            draws = rng.multinomial(count, np.full(count, 1.0 / count), size=repetitions)
            self._drawn = np.vstack([self._drawn, draws])

    def interval(self, statistic: Statistic) -> Interval:
        """The statistic and its interval.

        Args:
            statistic: given a function that maps values (one for each item) to their means
                (one for each draw), the statistic of each draw.
        """
        if not self._cluster.size:
            return Interval(math.nan, math.nan, math.nan)
        return of_draws(statistic(self._means), self._level)

    def _means(self, values: ArrayLike) -> FloatArray:
        sums = np.bincount(
            self._cluster, weights=np.asarray(values, dtype=np.float64), minlength=self._sizes.size
        )
        means: FloatArray = (self._drawn @ sums) / (self._drawn @ self._sizes)
        return means


def first_reach(at: Sequence[float], errors: Sequence[float], threshold: float) -> float:
    """The first of the places ``at`` whose error is at most ``threshold``; infinite if none is.

    >>> first_reach([10, 20, 30], [3.0, 1.0, 2.0], 1.5)
    20.0
    """
    pairs = zip(at, errors, strict=True)
    return next((float(x) for x, error in pairs if error <= threshold), math.inf)


def restricted_mean(times: ArrayLike, horizon: float) -> float:
    """Mean of min(time, horizon): what a run that never arrives (infinite) is charged.

    >>> restricted_mean([10.0, float("inf")], 50.0)
    30.0
    """
    return float(np.minimum(np.asarray(times, dtype=np.float64), horizon).mean())


def saving(alone: ArrayLike, helped: ArrayLike, horizon: float) -> float:
    """Share of the restricted mean time that help saves; negative if it costs.

    >>> saving([40.0, 60.0], [10.0, 40.0], 100.0)
    0.5
    """
    base = restricted_mean(alone, horizon)
    return 1.0 - restricted_mean(helped, horizon) / base if base > 0.0 else math.nan
