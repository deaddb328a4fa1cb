"""From rows to the result: errors with intervals, failures, effort, ratios to the best classical.

Intervals are those of a bootstrap over paths: scenarios on one path are alike, so a path is drawn
as a whole, the same for every controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from steersman.bench.apart import apart, rank, values_of
from steersman.bench.disturbance import Disturbance
from steersman.bench.entrants import Entrant
from steersman.bench.maps import Map
from steersman.bench.oracle import OracleCost, known
from steersman.bench.regret import clusters_of, regret
from steersman.bench.results import (
    BenchResult,
    BenchRow,
    ControllerSummary,
    DistributedFigure,
    ErrorRatio,
    IntervalEstimate,
    PooledErrors,
    Profiles,
    Summary,
    SweepStep,
)
from steersman.bench.suite import CLEAN, Suite
from steersman.metrics.comfort import MOST_ACCELERATION
from steersman.metrics.following import GAP_AND_JERK
from steersman.provenance import provenance
from steersman.types import FloatArray

# Rows of a group, by whether their disturbance belongs to it; none is beyond grip.
GROUPS: dict[str, Callable[[str], bool]] = {
    "all": lambda _: True,
    "clean": lambda name: name == CLEAN,
    "disturbed": lambda name: name != CLEAN,
}
# Metrics beside the errors that are given with intervals.
_ALWAYS = ("steer_change_rms", "weighted_acceleration_m_s2", "control_time_us_p50")
# What errors are shown against.
SWEPT = ("delay", "waypoint_noise", "friction")
# Factors of the best controller's error at which profiles are given.
FACTORS_OF_BEST = tuple(round(2.0 ** (k / 4.0), 4) for k in range(29))
# Errors below this are taken for it in ratios of single runs [m].
_FINEST = 1e-5


class Named(Protocol):
    """A controller that has rows, such as an entrant."""

    @property
    def name(self) -> str:
        """The controller's name in its rows."""

    @property
    def learned(self) -> bool:
        """Whether a policy is part of it."""


def results(
    name: str,
    suite: Suite,
    seeds: Sequence[int],
    rows: Sequence[BenchRow],
    entrants: Sequence[Entrant],
    maps: Sequence[Map] = (),
) -> BenchResult:
    """The content of ``results.json``: what was driven, what made it, and the summary."""
    return BenchResult(
        suite=name,
        seeds=list(seeds),
        maps={found.name: found.record() for found in maps},
        maps_left_out=[found.name for found in maps if not found.courses],
        **provenance(),
        made_by=sorted({str(row.commit) for row in rows}),
        controllers={e.label: e.shown for e in entrants},
        summary=summarise_rows(rows, entrants, known(suite.scenarios(seeds))),
        plant=", ".join(sorted({row.plant or suite.plant.kind for row in rows})),
        left_out=suite.left_out(seeds),
    )


def summarise_rows(
    rows: Sequence[BenchRow],
    entrants: Sequence[Named],
    oracle: Mapping[str, OracleCost] | None = None,
) -> Summary:
    """Figures of every controller: the fewer drives lost the earlier, then by typical error.

    Scenarios beyond grip are summed up for themselves, and under their disturbances and paths;
    where there are no others, they are all there is to sum up.
    """
    driven = {e.name: [row for row in rows if row.controller == e.name] for e in entrants}
    out = apart(rows)
    beyond = {name: [row for row in own if row.scenario in out] for name, own in driven.items()}
    table = {name: [row for row in own if row.scenario not in out] for name, own in driven.items()}
    learned = {e.name: e.learned for e in entrants}
    figures = {name: _figures(own) for name, own in table.items()}
    order = sorted(table, key=lambda name: rank(figures[name]["all"]))
    best = next((name for name in order if not learned[name]), None)
    gentle = _gentle(rows)
    return Summary(
        controllers={
            name: ControllerSummary(
                learned=learned[name],
                **figures[name],
                **_standards([row for row in table[name] if row.scenario in gentle]),
                beyond=_errors(beyond[name]) if beyond[name] else None,
                regret=regret(table[name], oracle or {}),
                ratio=None if best is None else _ratios(table[name], table[best]),
            )
            for name in order
        },
        best_classical=best,
        profiles=profiles(table),
        by={factor: _by(driven, factor) for factor in ("disturbance", "path", "speed", "grip")},
        sweeps={name: _sweep(rows, name) for name in SWEPT},
        paths=len({row.path for row in rows}),
        scenarios=len({row.scenario for row in rows}),
    )


def _figures(rows: Sequence[BenchRow]) -> dict[str, Any]:
    failed = [row.end for row in rows if not row.completed]
    steps = sum(round(row.number("duration_s") / row.dt_s) for row in rows)
    counted = ("interventions", "fallbacks", "deadline_misses_50ms", "deadline_misses_10ms")
    meant = ("steer_reversals_per_min", "saturated_share", "weighted_acceleration_m_s2")
    timed = ("control_time_us_p50", "control_time_us_p99")
    measured = _ALWAYS + GAP_AND_JERK * bool(_measured(rows, GAP_AND_JERK[0]).size)
    return {
        **{name: _errors(_in_group(rows, name)) for name in GROUPS},
        "figures": {k: _distributed(rows, k) for k in measured if _measured(rows, k).size},
        "replicates": max(len({row.replicate for row in rows}), 1),
        "runs": len(rows),
        "error": next((row.error for row in rows if row.error is not None), None),
        "failures": len(failed),
        "ends": {end: failed.count(end) for end in set(failed)},
        "steer_change_rms": _root_mean_square(_measured(rows, "steer_change_rms")),
        **{name: _mean(_measured(rows, name)) for name in meant},
        **{name: _median(_measured(rows, name)) for name in timed},
        **{name: round(sum(row.number(name) for row in rows)) for name in counted},
        "intervened_s": sum(row.number("intervened_s") for row in rows),
        "control_steps": steps,
        "computing_us_per_step": 1e6 * sum(r.computing_time_s for r in rows) / max(steps, 1),
    }


def _gentle(rows: Sequence[BenchRow]) -> set[str]:
    """Scenarios whose path needs no more acceleration than the standards of comfort allow.

    That is the largest value over all controllers: a drive that ends early sees less of the path.
    """
    asked: dict[str, float] = {}
    for row in rows:
        asked[row.scenario] = max(
            asked.get(row.scenario, 0.0), row.number("path_acceleration_m_s2")
        )
    return {name for name, most in asked.items() if most <= MOST_ACCELERATION}


def _standards(rows: Sequence[BenchRow]) -> dict[str, Any]:
    """Shares of these runs that kept to the limits."""
    return {
        "gentle_runs": len(rows),
        "iso_11270_share": _mean(_measured(rows, "iso_11270")),
        "r79_share": _mean(_measured(rows, "r79")),
    }


def profiles(table: Mapping[str, Sequence[BenchRow]]) -> Profiles:
    """Performance profiles: the share of scenarios within a factor of the best controller's error.

    Source: E. Dolan and J. More, "Benchmarking optimization software with performance profiles",
    *Mathematical Programming* 91, 2002. The measure is the RMS error; a run that failed is within
    no factor.
    """
    best: dict[str, float] = {}
    for row in (row for rows in table.values() for row in rows if row.completed):
        best[row.scenario] = min(best.get(row.scenario, math.inf), _fine(row))
    shares = {}
    for name, rows in table.items():
        ratios = np.array([_fine(r) / best[r.scenario] if r.completed else math.inf for r in rows])
        shares[name] = [float(np.mean(ratios <= f * (1.0 + 1e-12))) for f in FACTORS_OF_BEST]
    return Profiles(factors=list(FACTORS_OF_BEST), shares=shares)


def _fine(row: BenchRow) -> float:
    return max(row.charged_rms_m, _FINEST)


def _by(table: Mapping[str, Sequence[BenchRow]], factor: str) -> dict[str, dict[str, PooledErrors]]:
    """Errors of each controller for each value of a factor."""
    values = values_of((row for rows in table.values() for row in rows), factor)

    def of(rows: Sequence[BenchRow], value: str) -> PooledErrors:
        return _errors([row for row in rows if getattr(row, factor) == value])

    return {value: {name: of(rows, value) for name, rows in table.items()} for value in values}


def _sweep(rows: Sequence[BenchRow], name: str) -> list[SweepStep]:
    """Disturbances that differ from a clean run in one figure alone, by its size."""
    neutral = Disturbance().figures()
    found = {}
    for row in rows:
        alone = all(v == neutral.get(k) for k, v in row.applied.items() if k != name)
        value = row.applied.get(name)
        if alone and isinstance(value, (int, float)):
            found[row.disturbance] = float(value)
    order = sorted(found, key=lambda word: found[word])
    return [SweepStep(disturbance=word, value=found[word]) for word in order]


def _errors(rows: Sequence[BenchRow]) -> PooledErrors:
    errors, clusters = _column(row.charged_rms_m for row in rows), clusters_of(rows)
    squares, logs = errors**2, np.log(np.maximum(errors, _FINEST))
    lost = _column(float(not row.completed) for row in rows)
    return PooledErrors(
        runs=len(rows),
        failures=sum(not row.completed for row in rows),
        interventions=round(sum(row.number("interventions") for row in rows)),
        paths=len({row.path for row in rows}),
        rms_m=IntervalEstimate.of(clusters.interval(lambda mean: np.sqrt(mean(squares)))),
        typical_m=IntervalEstimate.of(clusters.interval(_exp_mean(logs))),
        lost_share=IntervalEstimate.of(clusters.interval(lambda mean: mean(lost))),
        mean_m=_mean(_column(row.charged_mean_m for row in rows)),
        p95_m=_mean(_column(row.charged_p95_m for row in rows)),
    )


def _distributed(rows: Sequence[BenchRow], metric: str) -> DistributedFigure:
    known = [row for row in rows if row.metrics.get(metric) is not None]
    values, clusters = _column(row.number(metric) for row in known), clusters_of(known)
    root, median = clusters.interval(lambda m: np.sqrt(m(values**2))), clusters.median(values)
    return DistributedFigure(rms=IntervalEstimate.of(root), median=IntervalEstimate.of(median))


def _ratios(rows: Sequence[BenchRow], base: Sequence[BenchRow]) -> dict[str, ErrorRatio]:
    """Ratios of the RMS error to another controller's, over the scenarios that both drove.

    Of several of the base's name the mean square and the mean logarithm of a scenario count.
    """
    known: dict[str, list[float]] = {}
    for row in base:
        known.setdefault(row.scenario, []).append(row.charged_rms_m)
    out = {}
    for name in GROUPS:
        mine = [row for row in _in_group(rows, name) if row.scenario in known]
        own = _column(row.charged_rms_m for row in mine)
        others = [np.array(known[row.scenario]) for row in mine]
        other = np.sqrt(_column(float(np.mean(each**2)) for each in others))
        typical = _column(float(np.mean(np.log(np.maximum(e, _FINEST)))) for e in others)
        clusters = clusters_of(mine)
        logs = np.log(np.maximum(own, _FINEST)) - typical
        out[name] = ErrorRatio(
            rms=IntervalEstimate.of(clusters.interval(_root_ratio(own**2, other**2))),
            typical=IntervalEstimate.of(clusters.interval(_exp_mean(logs))),
        )
    return out


def _root_ratio(own: FloatArray, other: FloatArray) -> Callable[[Any], FloatArray]:
    return lambda mean: np.sqrt(mean(own) / np.maximum(mean(other), _FINEST**2))


def _exp_mean(logs: FloatArray) -> Callable[[Any], FloatArray]:
    return lambda mean: np.exp(mean(logs))


def _in_group(rows: Sequence[BenchRow], name: str) -> list[BenchRow]:
    return [row for row in rows if GROUPS[name](row.disturbance)]


def _measured(rows: Sequence[BenchRow], metric: str) -> FloatArray:
    """A metric's defined values."""
    return _column(v for row in rows if (v := row.metrics.get(metric)) is not None)


def _column(values: Iterable[float]) -> FloatArray:
    return np.array(list(values), dtype=np.float64)


def _mean(values: FloatArray) -> float | None:
    return float(np.mean(values)) if values.size else None


def _median(values: FloatArray) -> float | None:
    return float(np.median(values)) if values.size else None


def _root_mean_square(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else None
