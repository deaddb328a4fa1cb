"""Two controllers over the same scenarios: differences and ratios, scenario by scenario.

What scenarios have in common (road, speed, disturbance, seed) cancels in a pair. Scenarios on one
path are alike, so the bootstrap draws whole paths.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from steersman.bench.results import BenchRow, IntervalEstimate
from steersman.bench.statistics import Clusters, Interval, Statistic
from steersman.bench.suite import CLEAN
from steersman.stored import StoredResult
from steersman.types import FloatArray

# With fewer paths an interval says little about other roads.
FEW_PATHS = 5
_SEVERAL = 2


class Draws(Protocol):
    """Intervals from a bootstrap: :class:`Clusters` or :class:`Blocks`."""

    def interval(self, statistic: Statistic) -> Interval:
        """The statistic and its interval."""
        ...


class Quantity(NamedTuple):
    """What is compared: a mean, or a root of a mean of squares, of a quantity."""

    label: str
    unit: str
    """Unit that is shown."""
    scale: float
    """Factor from the quantity's unit to the one that is shown."""
    value: Callable[[Any], Any]
    """The quantity of a row or of an episode's steps; None where it is undefined."""
    squared: bool = False
    """Whether it is the root of the mean square."""
    group: Callable[[Any], bool] = lambda _: True
    """Which rows it is over."""

    @property
    def finest(self) -> float:
        """What is smaller is rounding, and equal: 0.01 mm of errors, else 1e-6 as shown."""
        return (1e-2 if self.unit == "mm" else 1e-6) / self.scale


class Contrast(StoredResult):
    """A figure of two samples of the same items; None where it is undefined."""

    base: float | None
    own: float | None
    difference: IntervalEstimate
    """own - base"""
    ratio: IntervalEstimate
    """own / base"""


class PairedContrast(Contrast):
    """A figure over pairs of rows."""

    pairs: int
    """Pairs in which the figure is defined for both."""
    paths: int
    """Paths that they are on."""


class PathPairs(StoredResult):
    """RMS errors of two controllers on one path [m]."""

    pairs: int
    base: float
    own: float


class PairedComparison(StoredResult):
    """A controller's rows against those of another, the base."""

    name: str
    scenarios: int
    """Pairs of rows."""
    paths: int
    better: int
    """Scenarios in which the RMS error is less than the base's."""
    figures: dict[str, PairedContrast]
    """By name of ``FIGURES``."""
    by_path: dict[str, PathPairs]


def _measured(metric: str) -> Callable[[BenchRow], Any]:
    return lambda row: row.metrics.get(metric)


def _is_clean(row: BenchRow) -> bool:
    return row.disturbance == CLEAN


def _error(row: BenchRow) -> float:
    return row.charged_rms_m


FIGURES: dict[str, Quantity] = {
    "rms_m": Quantity("RMS error", "mm", 1e3, _error, True),
    "rms_clean_m": Quantity("same, clean", "mm", 1e3, _error, True, _is_clean),
    "rms_disturbed_m": Quantity(
        "same, disturbed", "mm", 1e3, _error, True, lambda row: not _is_clean(row)
    ),
    "p95_m": Quantity("95 % of |d|", "mm", 1e3, lambda row: row.charged_p95_m),
    "ended_early": Quantity("ended early", "%", 100.0, lambda row: float(not row.completed)),
    "steer_change_rms": Quantity(
        "steering change", "1/1000", 1e3, _measured("steer_change_rms"), True
    ),
    "steer_reversals_per_min": Quantity(
        "reversals", "1/min", 1.0, _measured("steer_reversals_per_min")
    ),
    "weighted_acceleration_m_s2": Quantity(
        "ISO 2631 accel.", "m/s²", 1.0, _measured("weighted_acceleration_m_s2")
    ),
    "control_time_us_p50": Quantity("computing time", "us", 1.0, _measured("control_time_us_p50")),
}


def joined(base: Sequence[BenchRow], own: Sequence[BenchRow]) -> list[tuple[BenchRow, BenchRow]]:
    """The pairs of rows of the scenarios that both drove, in the order of ``base``."""
    mine = {row.scenario: row for row in own}
    return [(row, mine[row.scenario]) for row in base if row.scenario in mine]


def against(base: Sequence[BenchRow], own: Sequence[BenchRow], name: str = "") -> PairedComparison:
    """A controller's rows against the base's; ``name`` is the controller's in the result."""
    pairs = joined(base, own)
    figures = {}
    for key, figure in FIGURES.items():
        kept = [pair for pair in pairs if _defined(figure, pair)]
        if not kept:
            continue
        values = [np.array([figure.value(pair[i]) for pair in kept], float) for i in (0, 1)]
        paths = [one.path for one, _ in kept]
        draws = Clusters(paths) if len(set(paths)) >= _SEVERAL else None
        found = dict(contrast(draws, figure, *values))
        figures[key] = PairedContrast(pairs=len(kept), paths=len(set(paths)), **found)
    return PairedComparison(
        name=name,
        scenarios=len(pairs),
        paths=len({one.path for one, _ in pairs}),
        better=sum(
            max(_error(other), FIGURES["rms_m"].finest) < _error(one) for one, other in pairs
        ),
        figures=figures,
        by_path=_by_path(pairs),
    )


def _defined(figure: Quantity, pair: tuple[BenchRow, BenchRow]) -> bool:
    return all(figure.group(row) and figure.value(row) is not None for row in pair)


def contrast(draws: Draws | None, figure: Quantity, base: FloatArray, own: FloatArray) -> Contrast:
    """Two samples of the same items: their figures, difference and ratio.

    Below what is rounding two figures are equal; there is no ratio to such a base.

    Args:
        draws: gives the intervals; None: there is too little for any.
        figure: whose values they are.
        base: values, shape (items,).
        own: the other's values of the same items.
    """
    one, other = (np.square(v) if figure.squared else v for v in (base, own))

    def root(mean: Any) -> FloatArray:
        return np.asarray(np.sqrt(mean) if figure.squared else mean, dtype=np.float64)

    def fine(mean: Any) -> FloatArray:
        return np.maximum(root(mean), figure.finest)

    def ratio(mean: Any) -> FloatArray:
        below, above = fine(mean(one)), fine(mean(other))
        undefined = np.where(above > below, math.inf, math.nan)
        found = np.where(root(mean(other)) == 0.0, 0.0, above / below)
        return np.where(below <= figure.finest, undefined, found)

    def difference(mean: Any) -> FloatArray:
        return fine(mean(other)) - fine(mean(one))

    return Contrast(
        base=_finite(float(root(np.mean(one)))),
        own=_finite(float(root(np.mean(other)))),
        difference=_interval(draws, difference, float(difference(np.mean))),
        ratio=_interval(draws, ratio, float(ratio(np.mean))),
    )


def _interval(draws: Draws | None, statistic: Statistic, value: float) -> IntervalEstimate:
    if draws is None or not math.isfinite(value):
        return IntervalEstimate(value=_finite(value))
    with np.errstate(invalid="ignore"):  # quantiles of draws that are infinite
        found = draws.interval(statistic)
    return IntervalEstimate.of(found._replace(value=value))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _by_path(pairs: Sequence[tuple[BenchRow, BenchRow]]) -> dict[str, PathPairs]:
    out = {}
    for path in dict.fromkeys(one.path for one, _ in pairs):
        mine = [pair for pair in pairs if pair[0].path == path]
        rms = [math.sqrt(float(np.mean([_error(p[i]) ** 2 for p in mine]))) for i in (0, 1)]
        out[path] = PathPairs(pairs=len(mine), base=rms[0], own=rms[1])
    return out
