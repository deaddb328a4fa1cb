"""From rows to a table: errors with intervals, failures, effort, ratios to the best classical."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from steersman.bench.drive import Row
from steersman.bench.entrants import Entrant
from steersman.bench.statistics import Clusters, Interval
from steersman.bench.suite import CLEAN
from steersman.types import FloatArray

# Rows of a group, by whether their disturbance belongs to it.
GROUPS: dict[str, Callable[[str], bool]] = {
    "all": lambda _: True,
    "clean": lambda name: name == CLEAN,
    "disturbed": lambda name: name != CLEAN,
}
# Errors below this are taken for it in ratios of single runs [m].
_FINEST = 1e-5


def summarise_rows(rows: Sequence[Row], entrants: Sequence[Entrant]) -> dict[str, Any]:
    """Figures of every controller, in the order of their error over all scenarios.

    Intervals are those of a bootstrap over paths: scenarios on one path are alike, so a path is
    drawn as a whole, the same for every controller.

    Returns:
        ``controllers``: by name, the figures; ``best_classical``: the name that the ratios refer
        to, None without one; ``paths``: how many paths the intervals rest on.
    """
    table = {e.name: [row for row in rows if row["controller"] == e.name] for e in entrants}
    figures = {name: _figures(own) for name, own in table.items()}
    order = sorted(figures, key=lambda name: figures[name]["all"]["rms_m"]["value"])
    learned = {e.name: e.learned for e in entrants}
    best = next((name for name in order if not learned[name]), None)
    for name in order if best is not None else ():
        figures[name]["ratio"] = _ratios(table[name], table[str(best)])
    return {
        "controllers": {name: {"learned": learned[name], **figures[name]} for name in order},
        "best_classical": best,
        "paths": len({row["path"] for row in rows}),
        "scenarios": len({row["scenario"] for row in rows}),
    }


def _figures(rows: Sequence[Row]) -> dict[str, Any]:
    failed = [row for row in rows if not row["completed"]]
    return {
        **{name: _errors(_in_group(rows, name)) for name in GROUPS},
        "runs": len(rows),
        "failures": len(failed),
        "ends": {end: sum(r["end"] == end for r in failed) for end in {r["end"] for r in failed}},
        "steer_change_rms": _root_mean_square(_column(rows, "steer_change_rms")),
        "steer_reversals_per_min": _mean(_column(rows, "steer_reversals_per_min")),
        "control_time_us_p50": _median(_column(rows, "control_time_us_p50")),
        "control_time_us_p99": _median(_column(rows, "control_time_us_p99")),
        "fallbacks": sum(row["fallbacks"] for row in rows),
    }


def _errors(rows: Sequence[Row]) -> dict[str, Any]:
    squares = _column(rows, "charged_rms_m") ** 2
    clusters = Clusters([row["path"] for row in rows])
    return {
        "runs": len(rows),
        "failures": sum(not row["completed"] for row in rows),
        "rms_m": _plain(clusters.interval(lambda mean: np.sqrt(mean(squares)))),
        "mean_m": _mean(_column(rows, "charged_mean_m")),
        "p95_m": _mean(_column(rows, "charged_p95_m")),
    }


def _ratios(rows: Sequence[Row], base: Sequence[Row]) -> dict[str, Any]:
    """Ratios of the RMS error to another controller's, over the scenarios that both drove."""
    out: dict[str, Any] = {}
    for name in GROUPS:
        mine = {row["scenario"]: row for row in _in_group(rows, name)}
        pairs = [(mine[r["scenario"]], r) for r in _in_group(base, name) if r["scenario"] in mine]
        own, other = (_column([pair[i] for pair in pairs], "charged_rms_m") for i in (0, 1))
        clusters = Clusters([row["path"] for row, _ in pairs])
        logs = np.log(np.maximum(own, _FINEST) / np.maximum(other, _FINEST))
        out[name] = {
            "rms": _plain(clusters.interval(_root_ratio(own**2, other**2))),
            "typical": _plain(clusters.interval(_exp_mean(logs))),
        }
    return out


def _root_ratio(own: FloatArray, other: FloatArray) -> Callable[[Any], FloatArray]:
    return lambda mean: np.sqrt(mean(own) / np.maximum(mean(other), _FINEST**2))


def _exp_mean(logs: FloatArray) -> Callable[[Any], FloatArray]:
    return lambda mean: np.exp(mean(logs))


def _in_group(rows: Sequence[Row], name: str) -> list[Row]:
    return [row for row in rows if GROUPS[name](row["disturbance"])]


def _column(rows: Sequence[Mapping[str, Any]], name: str) -> FloatArray:
    """A column's defined values."""
    return np.array([row[name] for row in rows if row[name] is not None], dtype=np.float64)


def _plain(interval: Interval) -> dict[str, float | None]:
    return {k: v if math.isfinite(v) else None for k, v in interval._asdict().items()}


def _mean(values: FloatArray) -> float | None:
    return float(np.mean(values)) if values.size else None


def _median(values: FloatArray) -> float | None:
    return float(np.median(values)) if values.size else None


def _root_mean_square(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else None
