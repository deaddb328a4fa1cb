"""Statistics over few seeds: interquartile means, quartiles, bootstrap intervals, times to reach.

Sources: R. Agarwal et al., "Deep reinforcement learning at the edge of the statistical
precipice", *NeurIPS* 2021 (interquartile mean, stratified bootstrap); P. Royston and M. Parmar,
"Restricted mean survival time", *BMC Medical Research Methodology* 13, 2013. For a series whose
neighbours are alike, such as errors along a path: D. Politis and J. Romano, "A circular
block-resampling procedure for stationary data", in *Exploring the Limits of Bootstrap*, 1992;
D. Politis and H. White, "Automatic block-length selection for the dependent bootstrap",
*Econometric Reviews* 23, 2004, with the correction of A. Patton, D. Politis and H. White,
*Econometric Reviews* 28, 2009.
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
# Politis and White, footnote c: lags that have to be insignificant in a row, and how insignificant.
_LEAST_LAGS, _SIGNIFICANT = 5, 2.0
_HALF = 0.5
# A series whose spread is below this share of its size is constant but for rounding.
_FLAT = 1e-12


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
        # BenchRow 0 is the sample itself; then how often each cluster was drawn.
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


def block_length(values: ArrayLike) -> float:
    """The length of blocks for the mean of a series, in items; 1 if neighbours are independent.

    Politis and White 2004, sec. 3, for the circular bootstrap.
    """
    series = np.asarray(values, dtype=np.float64)
    n = series.size
    centred = series - series.mean() if n else series
    longest = math.ceil(min(3.0 * math.sqrt(n), n / 3.0))
    if longest <= 1 or np.abs(centred).max() <= _FLAT * np.abs(series).max():
        return 1.0
    lags = max(_LEAST_LAGS, math.ceil(math.sqrt(math.log10(n))))
    most = min(math.ceil(math.sqrt(n)) + lags, n - 1)
    covariance = np.array([centred[: n - k] @ centred[k:] for k in range(most + 1)]) / n
    width = min(2 * _last_significant(covariance, n, lags), most)
    k = np.arange(-width, width + 1)
    share = np.abs(k) / max(width, 1)
    window = np.where(share <= _HALF, 1.0, 2.0 * (1.0 - share))  # flat-topped
    weighted = window * covariance[np.abs(k)]
    bias, spread = float(weighted @ np.abs(k)), float(weighted.sum())
    if spread <= 0.0:
        return float(longest)
    best = (2.0 * bias**2 / (4.0 / 3.0 * spread**2)) ** (1.0 / 3.0) * n ** (1.0 / 3.0)
    return float(min(max(best, 1.0), longest))


def _last_significant(covariance: FloatArray, n: int, lags: int) -> int:
    """The lag after which ``lags`` correlations in a row are as small as chance makes them."""
    limit = _SIGNIFICANT * math.sqrt(math.log10(n) / n)
    small = np.abs(covariance[1:] / covariance[0]) < limit
    for k in range(small.size - lags + 1):
        if small[k : k + lags].all():
            return max(k, 1)
    return int(small.size)


class Blocks:
    """Percentile intervals for statistics of means over the items of a series.

    Blocks of neighbours are drawn with replacement, the series closed to a ring. Two statistics
    over the same items are drawn alike, so that differences and ratios are paired.
    """

    def __init__(
        self,
        count: int,
        length: int,
        *,
        repetitions: int = REPETITIONS,
        level: float = LEVEL,
        seed: int = 0,
    ) -> None:
        """``count`` items in blocks of ``length`` of them."""
        self._count, self._length, self._level = count, min(max(length, 1), max(count, 1)), level
        drawn = math.ceil(count / self._length)
        rng = np.random.default_rng(seed)
        self._starts = rng.integers(max(count, 1), size=(repetitions, drawn))

    def interval(self, statistic: Statistic) -> Interval:
        """The statistic and its interval; ``statistic`` as of :class:`Clusters`."""
        if not self._count:
            return Interval(math.nan, math.nan, math.nan)
        return of_draws(statistic(self._means), self._level)

    def _means(self, values: ArrayLike) -> FloatArray:
        series = np.asarray(values, dtype=np.float64)
        ring = np.concatenate([[0.0], np.cumsum(np.concatenate([series, series[: self._length]]))])
        sums = ring[self._length : self._length + self._count] - ring[: self._count]
        drawn = sums[self._starts].sum(axis=1) / (self._starts.shape[1] * self._length)
        means: FloatArray = np.concatenate([[series.mean()], drawn])
        return means
