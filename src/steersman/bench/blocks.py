"""Bootstrap over blocks of a series whose neighbours are alike, such as errors along a path.

Sources: D. Politis and J. Romano, "A circular block-resampling procedure for stationary data", in
*Exploring the Limits of Bootstrap*, 1992; D. Politis and H. White, "Automatic block-length
selection for the dependent bootstrap", *Econometric Reviews* 23, 2004, with the correction of
A. Patton, D. Politis and H. White, *Econometric Reviews* 28, 2009.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from steersman.bench.statistics import LEVEL, REPETITIONS, Interval, Statistic, of_draws
from steersman.types import FloatArray

# Politis and White, footnote c: lags that have to be insignificant in a row, and how insignificant.
_LEAST_LAGS, _SIGNIFICANT = 5, 2.0
_HALF = 0.5
# A series whose spread is below this share of its size is constant but for rounding.
_FLAT = 1e-12


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
