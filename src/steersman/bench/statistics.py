"""Bootstrap intervals of means over items in clusters, and over the items of a series.

Sources: for clusters, A. Davison and D. Hinkley, *Bootstrap Methods and their Application*, 1997,
sec. 3.8. For a series whose neighbours are alike, such as errors along a path: D. Politis and
J. Romano, "A circular block-resampling procedure for stationary data", in *Exploring the Limits of
Bootstrap*, 1992; D. Politis and H. White, "Automatic block-length selection for the dependent
bootstrap", *Econometric Reviews* 23, 2004, with the correction of A. Patton, D. Politis and
H. White, *Econometric Reviews* 28, 2009.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
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


# From a function that gives the mean of any values in each draw to the statistic of each draw.
Statistic: TypeAlias = Callable[[Callable[[ArrayLike], FloatArray]], Any]


class Resampled(ABC):
    """Draws of a sample's items, from which intervals of statistics of means follow.

    Two statistics over the same items are drawn alike, so that differences and ratios are paired.
    """

    def __init__(self, items: int) -> None:
        """Of so many items."""
        self._items = items

    def interval(self, statistic: Statistic) -> Interval:
        """The statistic of the sample and its 95 % percentile interval; NaN without items.

        Args:
            statistic: given a function that maps values (one for each item) to their means
                (the sample's, and one for each draw), the statistic of each.
        """
        if not self._items:
            return Interval(math.nan, math.nan, math.nan)
        value, *draws = np.asarray(statistic(self._means), dtype=np.float64)
        low, high = np.quantile(draws, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
        return Interval(float(value), float(low), float(high))

    @abstractmethod
    def _means(self, values: ArrayLike) -> FloatArray:
        """Means of the values: the sample's, then each draw's."""


class Clusters(Resampled):
    """Items that come in clusters, in which they are alike, such as scenarios on one road.

    Clusters are drawn as a whole, with replacement. Items may be clustered in a second way too,
    such as by the seed of a tuning: then both are drawn, each for itself, and an item counts as
    often as both of its clusters together ("pigeonhole bootstrap", A. Owen, *Annals of Applied
    Statistics* 1, 2007). Where there is one cluster alone, there are no intervals.
    """

    def __init__(
        self,
        names: Sequence[str],
        seconds: Sequence[str] | None = None,
        *,
        repetitions: int = REPETITIONS,
        seed: int = 0,
    ) -> None:
        """``names`` holds the cluster of every item, ``seconds`` that of the second way."""
        super().__init__(len(names))
        rng = np.random.default_rng(seed)
        seconds = [""] * len(names) if seconds is None else seconds
        (self._first, self._drawn), (self._second, self._also) = (
            _draws(each, repetitions, rng) for each in (names, seconds)
        )
        self._shape = self._drawn.shape[1], self._also.shape[1]
        self._sizes = self._sums(np.ones(len(names)))

    def interval(self, statistic: Statistic) -> Interval:
        """The statistic of the sample and its interval, of which the ends may be NaN."""
        found = super().interval(statistic)
        return found if self._several else Interval(found.value, math.nan, math.nan)

    def median(self, values: ArrayLike) -> Interval:
        """The items' median and its 95 % percentile interval; NaN without items."""
        column = np.asarray(values, dtype=np.float64)
        if not column.size:
            return Interval(math.nan, math.nan, math.nan)
        order = np.argsort(column)
        counts = self._drawn[:, self._first[order]] * self._also[:, self._second[order]]
        reached = np.cumsum(counts, axis=1, dtype=np.float32)
        places = np.argmax(reached >= _HALF * reached[:, -1:], axis=1)
        draws = column[order][places[1:]]
        low, high = np.quantile(draws, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
        ends = (float(low), float(high)) if self._several else (math.nan, math.nan)
        return Interval(float(np.median(column)), *ends)

    @property
    def _several(self) -> bool:
        return bool(max(self._shape) > 1)

    def _sums(self, values: FloatArray) -> FloatArray:
        """Sums over the items of each draw."""
        rows, columns = self._shape
        cell = self._first * columns + self._second
        table = np.bincount(cell, weights=values, minlength=rows * columns)
        sums: FloatArray = ((self._drawn @ table.reshape(self._shape)) * self._also).sum(axis=1)
        return sums

    def _means(self, values: ArrayLike) -> FloatArray:
        means: FloatArray = self._sums(np.asarray(values, dtype=np.float64)) / self._sizes
        return means


def _draws(names: Sequence[str], repetitions: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """The cluster of each item; how often each is there in the sample, row 0, and in each draw."""
    known, cluster = np.unique(np.asarray(names, dtype=str), return_inverse=True)
    count = known.size
    drawn = np.ones((repetitions + 1, count))
    if count > 1:
        drawn[1:] = rng.multinomial(count, np.full(count, 1.0 / count), size=repetitions)
    return cluster, drawn


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


class Blocks(Resampled):
    """Items of a series: blocks of neighbours are drawn, the series closed to a ring."""

    def __init__(
        self, count: int, length: int, *, repetitions: int = REPETITIONS, seed: int = 0
    ) -> None:
        """``count`` items in blocks of ``length`` of them."""
        super().__init__(count)
        self._length = min(max(length, 1), max(count, 1))
        drawn = math.ceil(count / self._length)
        rng = np.random.default_rng(seed)
        self._starts = rng.integers(max(count, 1), size=(repetitions, drawn))

    def _means(self, values: ArrayLike) -> FloatArray:
        series = np.asarray(values, dtype=np.float64)
        ring = np.concatenate([[0.0], np.cumsum(np.concatenate([series, series[: self._length]]))])
        sums = ring[self._length : self._length + self._items] - ring[: self._items]
        drawn = sums[self._starts].sum(axis=1) / (self._starts.shape[1] * self._length)
        means: FloatArray = np.concatenate([[series.mean()], drawn])
        return means
