"""From rows to a table: errors with intervals, failures, effort, ratios to the best classical."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from steersman.bench.disturbance import Disturbance
from steersman.bench.drive import Row
from steersman.bench.statistics import Clusters, Interval
from steersman.bench.suite import CLEAN
from steersman.metrics.comfort import MOST_ACCELERATION
from steersman.types import FloatArray

# Rows of a group, by whether their disturbance belongs to it.
GROUPS: dict[str, Callable[[str], bool]] = {
    "all": lambda _: True,
    "clean": lambda name: name == CLEAN,
    "disturbed": lambda name: name != CLEAN,
}
# What errors are shown against.
SWEPT = ("delay", "waypoint_noise", "friction")
# Factors of the best controller's error at which profiles are given.
FACTORS_OF_BEST = tuple(round(2.0 ** (k / 4.0), 4) for k in range(29))
# Errors below this are taken for it in ratios of single runs [m].
_FINEST = 1e-5


class Named(Protocol):
    """Whoever has rows: an entrant."""

    @property
    def name(self) -> str:
        """What its rows call it."""

    @property
    def learned(self) -> bool:
        """Whether a policy is part of it."""


def summarise_rows(rows: Sequence[Row], entrants: Sequence[Named]) -> dict[str, Any]:
    """Figures of every controller, in the order of their error over all scenarios.

    Intervals are those of a bootstrap over paths: scenarios on one path are alike, so a path is
    drawn as a whole, the same for every controller.

    Returns:
        ``controllers``: by name, the figures; ``best_classical``: the name that the ratios refer
        to, None without one; ``profiles``: of :func:`profiles`; ``by``: errors by disturbance,
        path and speed; ``sweeps``: which disturbances differ in delay, noise or friction alone;
        ``paths``: how many paths the intervals rest on.
    """
    table = {e.name: [row for row in rows if row["controller"] == e.name] for e in entrants}
    gentle = _gentle(rows)
    figures = {
        name: {**_figures(own), **_standards([row for row in own if row["scenario"] in gentle])}
        for name, own in table.items()
    }
    order = sorted(figures, key=lambda name: figures[name]["all"]["rms_m"]["value"])
    learned = {e.name: e.learned for e in entrants}
    best = next((name for name in order if not learned[name]), None)
    for name in order if best is not None else ():
        figures[name]["ratio"] = _ratios(table[name], table[str(best)])
    return {
        "controllers": {name: {"learned": learned[name], **figures[name]} for name in order},
        "best_classical": best,
        "profiles": profiles(table),
        "by": {factor: _by(table, factor) for factor in ("disturbance", "path", "speed")},
        "sweeps": {name: _sweep(rows, name) for name in SWEPT},
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
        "interventions": sum(row["interventions"] for row in rows),
        "intervened_s": sum(row["intervened_s"] for row in rows),
        "fallbacks": sum(row["fallbacks"] for row in rows),
        "saturated_share": _mean(_column(rows, "saturated_share")),
        "weighted_acceleration_m_s2": _mean(_column(rows, "weighted_acceleration_m_s2")),
        "deadline_misses_50ms": sum(row["deadline_misses_50ms"] for row in rows),
        "deadline_misses_10ms": sum(row["deadline_misses_10ms"] for row in rows),
        "control_steps": (steps := sum(round(row["duration_s"] / row["dt_s"]) for row in rows)),
        "computing_us_per_step": 1e6 * sum(r["computing_time_s"] for r in rows) / max(steps, 1),
    }


def _gentle(rows: Sequence[Row]) -> set[str]:
    """Scenarios whose road asks for no more than the standards of comfort allow.

    What a road asks for is the most that any controller saw of it: who leaves early sees less.
    """
    asked: dict[str, float] = {}
    for row in rows:
        name, value = row["scenario"], row["path_acceleration_m_s2"]
        asked[name] = max(asked.get(name, 0.0), 0.0 if value is None else value)
    return {name for name, most in asked.items() if most <= MOST_ACCELERATION}


def _standards(rows: Sequence[Row]) -> dict[str, Any]:
    """Shares of these runs that kept to the limits."""
    return {
        "gentle_runs": len(rows),
        "iso_11270_share": _mean(_column(rows, "iso_11270")),
        "r79_share": _mean(_column(rows, "r79")),
    }


def profiles(table: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
    """Performance profiles: the share of scenarios within a factor of the best controller's error.

    Source: E. Dolan and J. More, "Benchmarking optimization software with performance profiles",
    *Mathematical Programming* 91, 2002. The measure is the RMS error; a run that failed is within
    no factor.

    Returns:
        ``factors``, and under ``shares`` a list of shares for each controller.
    """
    best: dict[str, float] = {}
    for row in (row for rows in table.values() for row in rows if row["completed"]):
        name = row["scenario"]
        best[name] = min(best.get(name, math.inf), max(row["charged_rms_m"], _FINEST))
    shares = {}
    for name, rows in table.items():
        ratios = np.array(
            [
                max(r["charged_rms_m"], _FINEST) / best[r["scenario"]]
                if r["completed"]
                else math.inf
                for r in rows
            ]
        )
        shares[name] = [float(np.mean(ratios <= f * (1.0 + 1e-12))) for f in FACTORS_OF_BEST]
    return {"factors": list(FACTORS_OF_BEST), "shares": shares}


def _by(table: Mapping[str, Sequence[Row]], factor: str) -> dict[str, Any]:
    """Errors of each controller for each value of a factor, values in the order of the suite."""
    values = dict.fromkeys(row[factor] for rows in table.values() for row in rows)
    return {
        value: {
            name: _errors([row for row in rows if row[factor] == value])
            for name, rows in table.items()
        }
        for value in values
    }


def _sweep(rows: Sequence[Row], name: str) -> list[dict[str, Any]]:
    """Disturbances that differ from a clean run in one figure alone, by its size."""
    neutral = {f"disturbance_{k}": v for k, v in Disturbance().figures().items()}
    own = f"disturbance_{name}"
    found = {}
    for row in rows:
        alone = all(row[k] == v for k, v in neutral.items() if k != own)
        if alone and row[own] is not None:
            found[row["disturbance"]] = float(row[own])
    order = sorted(found, key=lambda word: found[word])
    return [{"disturbance": word, "value": found[word]} for word in order]


def _errors(rows: Sequence[Row]) -> dict[str, Any]:
    squares = _column(rows, "charged_rms_m") ** 2
    clusters = Clusters([row["path"] for row in rows])
    return {
        "runs": len(rows),
        "failures": sum(not row["completed"] for row in rows),
        "interventions": sum(row["interventions"] for row in rows),
        "paths": len({row["path"] for row in rows}),
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
