"""Two controllers over the same scenarios: differences and ratios, scenario by scenario.

What scenarios have in common (road, speed, disturbance, seed) cancels in a pair. Scenarios on one
path are alike, so the bootstrap draws whole paths.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from steersman.bench.drive import Row
from steersman.bench.statistics import Clusters, Interval, Statistic
from steersman.bench.suite import CLEAN
from steersman.types import FloatArray

# With fewer paths an interval says little about other roads.
FEW_PATHS = 5
_SEVERAL = 2


class Draws(Protocol):
    """Intervals from a bootstrap: :class:`Clusters` or :class:`Blocks`."""

    def interval(self, statistic: Statistic) -> Interval:
        """The statistic and its interval."""
        ...


class Figure(NamedTuple):
    """What is compared: a mean, or a root of a mean of squares, of a quantity."""

    label: str
    unit: str
    """As it is shown."""
    scale: float
    """From the quantity's unit to the one that is shown."""
    value: Callable[[Any], Any]
    """The quantity of a row or of an episode's steps; None where it is undefined."""
    squared: bool = False
    """Whether it is the root of the mean square."""
    group: Callable[[Any], bool] = lambda _: True
    """Which rows it is over."""


def _of(column: str) -> Callable[[Row], Any]:
    return lambda row: row[column]


def _is_clean(row: Row) -> bool:
    return bool(row["disturbance"] == CLEAN)


_ERROR = _of("charged_rms_m")
FIGURES: dict[str, Figure] = {
    "rms_m": Figure("RMS error", "mm", 1e3, _ERROR, True),
    "rms_clean_m": Figure("same, clean", "mm", 1e3, _ERROR, True, _is_clean),
    "rms_disturbed_m": Figure(
        "same, disturbed", "mm", 1e3, _ERROR, True, lambda row: not _is_clean(row)
    ),
    "p95_m": Figure("95 % of |d|", "mm", 1e3, _of("charged_p95_m")),
    "ended_early": Figure("ended early", "%", 100.0, lambda row: float(not row["completed"])),
    "steer_change_rms": Figure("steering change", "1/1000", 1e3, _of("steer_change_rms"), True),
    "steer_reversals_per_min": Figure("reversals", "1/min", 1.0, _of("steer_reversals_per_min")),
    "weighted_acceleration_m_s2": Figure(
        "ISO 2631 accel.", "m/s²", 1.0, _of("weighted_acceleration_m_s2")
    ),
    "control_time_us_p50": Figure("computing time", "us", 1.0, _of("control_time_us_p50")),
}


def joined(base: Sequence[Row], own: Sequence[Row]) -> list[tuple[Row, Row]]:
    """The pairs of rows of the scenarios that both drove, in the order of ``base``."""
    mine = {row["scenario"]: row for row in own}
    return [(row, mine[row["scenario"]]) for row in base if row["scenario"] in mine]


def against(base: Sequence[Row], own: Sequence[Row]) -> dict[str, Any]:
    """A controller's rows against another's.

    Returns:
        ``scenarios`` (pairs) and ``paths`` they are on; ``better``: in how many of them the RMS
        error is less than the base's; ``figures`` by name of ``FIGURES``, of :func:`contrast`,
        each with its own ``pairs`` and ``paths``; ``by_path``: RMS errors [m] on each path.
    """
    pairs = joined(base, own)
    figures = {}
    for name, figure in FIGURES.items():
        kept = [pair for pair in pairs if _defined(figure, pair)]
        if not kept:
            continue
        values = [np.array([figure.value(pair[i]) for pair in kept], float) for i in (0, 1)]
        paths = [one["path"] for one, _ in kept]
        several = len(set(paths)) >= _SEVERAL
        figures[name] = {
            "pairs": len(kept),
            "paths": len(set(paths)),
            **contrast(Clusters(paths) if several else None, figure.squared, *values),
        }
    return {
        "scenarios": len(pairs),
        "paths": len({one["path"] for one, _ in pairs}),
        "better": sum(_ERROR(other) < _ERROR(one) for one, other in pairs),
        "figures": figures,
        "by_path": _by_path(pairs),
    }


def _defined(figure: Figure, pair: tuple[Row, Row]) -> bool:
    return all(figure.group(row) and figure.value(row) is not None for row in pair)


def contrast(
    draws: Draws | None, squared: bool, base: FloatArray, own: FloatArray
) -> dict[str, Any]:
    """Two samples of the same items: their figures, difference and ratio.

    Args:
        draws: gives the intervals; None: there is too little for any.
        squared: whether the figure is the root of the mean square, or the mean.
        base: values, shape (items,).
        own: the other's values of the same items.

    Returns:
        ``base`` and ``own``, the figures; ``difference`` (own - base) and ``ratio`` (own / base),
        each with ``value``, ``low`` and ``high``, None where undefined.
    """
    one, other = (np.square(v) if squared else v for v in (base, own))

    def root(mean: Any) -> FloatArray:
        return np.asarray(np.sqrt(mean) if squared else mean, dtype=np.float64)

    def ratio(mean: Any) -> FloatArray:
        with np.errstate(divide="ignore", invalid="ignore"):
            return root(mean(other)) / root(mean(one))

    figures = [float(root(np.mean(v))) for v in (one, other)]

    return {
        "base": finite(figures[0]),
        "own": finite(figures[1]),
        "difference": _interval(
            draws, lambda mean: root(mean(other)) - root(mean(one)), figures[1] - figures[0]
        ),
        "ratio": _interval(draws, ratio, figures[1] / figures[0] if figures[0] else math.nan),
    }


def _interval(draws: Draws | None, statistic: Statistic, value: float) -> dict[str, float | None]:
    if draws is None or not math.isfinite(value):
        return {"value": finite(value), "low": None, "high": None}
    with np.errstate(invalid="ignore"):  # quantiles of draws that are infinite
        found = draws.interval(statistic)
    return {"value": finite(value), "low": finite(found.low), "high": finite(found.high)}


def finite(value: float) -> float | None:
    """The value for JSON."""
    return value if math.isfinite(value) else None


def _by_path(pairs: Sequence[tuple[Row, Row]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for path in dict.fromkeys(one["path"] for one, _ in pairs):
        mine = [pair for pair in pairs if pair[0]["path"] == path]
        rms = [math.sqrt(float(np.mean([_ERROR(p[i]) ** 2 for p in mine]))) for i in (0, 1)]
        out[path] = {"pairs": len(mine), "base": rms[0], "own": rms[1]}
    return out
