"""The page of a benchmark: ranking, profiles, where each controller is good and where it fails."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman.bench.pairs import FEW_PATHS
from steersman.bench.replay import ShownCase
from steersman.bench.results import (
    BenchResult,
    ControllerSummary,
    IntervalEstimate,
    PooledErrors,
    Summary,
    SweepStep,
)
from steersman.report.article import write_article
from steersman.report.cases import places, replays, worst
from steersman.report.tables import text

TITLE = "Steering controllers compared"
_GROUPS = {"all": "all scenarios", "clean": "clean", "disturbed": "disturbed"}
_SWEEPS = {
    "delay": "steering delay [s]",
    "waypoint_noise": "waypoint errors up to [m]",
    "friction": "tyre friction",
}
_PERCENT, _MM = 100.0, 1000.0
# Nothing is compared where there is only one.
_SEVERAL = 2


def write_benchmark(results: BenchResult, cases: Sequence[ShownCase], out: FilePath) -> FilePath:
    """Write the page, self-contained, and its figures as files into ``plots/`` beside it.

    Args:
        results: the content of ``results.json``.
        cases: of :func:`steersman.bench.replay.worst_cases` and ``median_cases``.
        out: file of the page.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
        DataError: the files cannot be written.
    """
    source = f"Suite {results.suite}, seeds {results.seeds}, commit "
    return write_article(
        sections(results.summary, cases),
        out,
        TITLE,
        f"{source}{', '.join(results.made_by)}.",
        replay=replays(results.summary, cases),
    )


def sections(summary: Summary, cases: Sequence[ShownCase]) -> list[dict[str, Any]]:
    """The page as plain data, as :mod:`steersman.report.article` takes it."""
    several = len(summary.controllers) >= _SEVERAL
    return [
        _ranking(summary),
        *([_profiles(summary)] if several else []),
        _disturbances(summary),
        _map(summary, "path", "Paths"),
        _ride(summary),
        *worst(summary, cases),
    ]


def _ranking(summary: Summary) -> dict[str, Any]:
    found, best = summary.controllers, summary.best_classical
    figures = [
        _intervals(
            f"RMS lateral error, {words}",
            "mm",
            found,
            {name: one.errors(group).rms_m.scaled(_MM) for name, one in found.items()},
        )
        | {"file": f"rms_{group}"}
        for group, words in _GROUPS.items()
    ]
    if best is not None:
        title = f"RMS error over that of {best}"
        ratios = {name: one.ratio["all"].rms for name, one in found.items() if one.ratio}
        figures.append(_intervals(title, "ratio", found, ratios) | {"file": "ratio"})
    rows = [_row(name, figures_of) for name, figures_of in found.items()]
    columns = {
        "name": "controller",
        **{group: f"RMS, {words} [mm]" for group, words in _GROUPS.items()},
        "p95": "95 % of |d| [mm]",
        "failed": "failed",
        "steer": "RMS steering change per step",
        "reversals": "reversals per minute",
        **({"ratio": f"RMS over {best}'s", "typical": "typical ratio"} if best else {}),
        "step": "step time p50 / p99 [us]",
    }
    return {
        "title": "Ranking",
        "text": [
            f"{summary.scenarios} scenarios on {summary.paths} paths, the same for every "
            "controller. Errors are pooled: the root of the mean square over all scenarios, each "
            "of the same weight. A run that ends early is charged the corridor's half width for "
            "all that it did not drive.",
            "In brackets: 95 % intervals of a bootstrap in which whole paths are drawn, the same "
            "for every controller."
            " A diamond marks a controller with a learned policy."
            + (
                " The typical ratio is the geometric mean over the scenarios, which hard ones do "
                "not dominate."
                if best
                else ""
            ),
        ],
        "warnings": _few_paths(found),
        "tables": [{"title": "Controllers, best first", "columns": columns, "rows": rows}],
        "figures": figures,
    }


def _few_paths(found: Mapping[str, ControllerSummary]) -> list[str]:
    """Which of the ranking's intervals rest on so few paths that they say little about others."""
    counts: dict[int, list[str]] = {}
    for group, words in _GROUPS.items():
        known = [n for one in found.values() if (n := one.errors(group).paths) is not None]
        if known and min(known) < FEW_PATHS:
            counts.setdefault(min(known), []).append(words)
    return [_few_words(count, words) for count, words in counts.items()]


def _few_words(count: int, what: Sequence[str]) -> str:
    where = f"{', '.join(what)}:"
    if count <= 1:
        return f"{where} all on one path, so there are no intervals over paths."
    return (
        f"{where} the intervals rest on only {count} paths, below {FEW_PATHS}: they are rough, "
        "and say little about other roads."
    )


def _row(name: str, found: ControllerSummary) -> dict[str, Any]:
    ratio = None if found.ratio is None else found.ratio["all"]
    times = (found.control_time_us_p50, found.control_time_us_p99)
    return {
        "name": name + (" (learned)" if found.learned else ""),
        **{group: _interval(found.errors(group).rms_m.scaled(_MM)) for group in _GROUPS},
        "p95": _scaled(found.all.p95_m),
        "failed": f"{found.failures} of {found.runs}",
        "steer": found.steer_change_rms,
        "reversals": found.steer_reversals_per_min,
        "ratio": _interval(None if ratio is None else ratio.rms),
        "typical": _interval(None if ratio is None else ratio.typical),
        "step": " / ".join(text(time, 3) for time in times),
    }


def _profiles(summary: Summary) -> dict[str, Any]:
    found = summary.profiles
    lines = [
        {"name": name, "look": k, "x": found.factors, "y": found.shares[name]}
        for name, k in places(summary).items()
    ]
    return {
        "title": "Performance profiles",
        "text": [
            "The share of scenarios that a controller drives with at most so many times the error "
            "of the best in that scenario. At 1: how often it is the best itself; to the right: "
            "how many scenarios it completes at all within that factor."
        ],
        "figures": [
            {
                "file": "profiles", "title": "Performance profiles", "log_x": True,
                "x": "factor of the best RMS error", "y": "share of scenarios", "lines": lines,
            }
        ],
    }  # fmt: skip


def _disturbances(summary: Summary) -> dict[str, Any]:
    section = _map(summary, "disturbance", "Disturbances")
    for name, axis in _SWEEPS.items():
        steps = summary.sweeps.get(name, [])
        if len(steps) >= _SEVERAL:
            section["figures"].append(_sweep(summary, name, axis, steps))
    section["text"].append(
        "On slippery roads speeds are lower too: they need at most 60 % of the grip."
    )
    return section


def _sweep(summary: Summary, name: str, axis: str, steps: Sequence[SweepStep]) -> dict[str, Any]:
    table = summary.by["disturbance"]
    lines = []
    for controller, place in places(summary).items():
        found = [table[step.disturbance][controller].rms_m.scaled(_MM) for step in steps]
        lines.append(
            {
                "name": controller, "look": place, "x": [step.value for step in steps],
                "y": [one.value for one in found], "low": [one.low for one in found],
                "high": [one.high for one in found],
            }
        )  # fmt: skip
    title = f"Error against {axis.partition(' [')[0]}"
    return {"file": f"sweep_{name}", "title": title, "x": axis, "y": "RMS error [mm]",
            "log": True, "lines": lines}  # fmt: skip


def _map(summary: Summary, factor: str, title: str) -> dict[str, Any]:
    table = summary.by[factor]
    names = list(summary.controllers)
    cells = [[_scaled(column[name].rms_m.value) for column in table.values()]
             for name in names]  # fmt: skip
    marks = [
        [_mark(column[name], cell) for column, cell in zip(table.values(), row, strict=True)]
        for name, row in zip(names, cells, strict=True)
    ]
    known = [cell for row in cells for cell in row if cell]
    low, high = (min(known), max(known)) if known else (1.0, 10.0)
    figure = {
        "file": f"map_{factor}", "title": f"RMS error [mm] by {factor}",
        "rows": names, "columns": list(table), "cells": cells, "marks": marks,
        "low": low, "high": max(high, 1.01 * low),
    }  # fmt: skip
    words = "RMS error in mm, over all scenarios of a column; a star: not all runs were completed."
    return {"title": title, "text": [words], "figures": [figure]}


def _mark(found: PooledErrors, cell: float | None) -> str:
    return text(cell, 3) + ("*" if found.failures else "")


def _ride(summary: Summary) -> dict[str, Any]:
    columns = {
        "name": "controller",
        "iso": "ISO 11270 kept [%]",
        "r79": "UN R79 kept [%]",
        "of": "of runs",
        "weighted": "ISO 2631 acceleration [m/s²]",
        "saturated": "steps clipped [%]",
        "fallbacks": "fallbacks",
        "whole": "computing time of a step, everything [us]",
        "late50": "steps over 50 ms",
        "late10": "steps over 10 ms",
        "steps": "steps",
    }
    rows = [
        {
            "name": name,
            "iso": _scaled(found.iso_11270_share, _PERCENT),
            "r79": _scaled(found.r79_share, _PERCENT),
            "of": found.gentle_runs,
            "weighted": found.weighted_acceleration_m_s2,
            "saturated": _scaled(found.saturated_share, _PERCENT),
            "fallbacks": found.fallbacks,
            "whole": text(found.computing_us_per_step, 3),
            "late50": found.deadline_misses_50ms,
            "late10": found.deadline_misses_10ms,
            "steps": found.control_steps,
        }
        for name, found in summary.controllers.items()
    ]
    return {
        "title": "Comfort and effort",
        "text": [
            "ISO 11270 and UN R79 allow 3 m/s² and 5 m/s³ of lateral acceleration and jerk. Their "
            "shares are over the runs whose path needs no more than 3 m/s²: elsewhere no "
            "controller could keep to it. Computing times hold whatever else the machine did; "
            "everything is plant, sensing, controller, record and metrics, in processor time."
        ],
        "tables": [{"title": "Ride and computing", "columns": columns, "rows": rows}],
    }


def _intervals(
    title: str,
    axis: str,
    found: Mapping[str, ControllerSummary],
    values: Mapping[str, IntervalEstimate],
) -> dict[str, Any]:
    points = [
        {"name": name, "group": k, "diamond": one.learned, **values[name].model_dump()}
        for k, (name, one) in enumerate(found.items())
    ]
    return {"title": title, "x": axis, "points": points}


def _interval(found: IntervalEstimate | None) -> str:
    if found is None or found.value is None:
        return text(None)
    value, low, high = (text(number, 3) for number in (found.value, found.low, found.high))
    return f"{value} [{low}, {high}]"


def _scaled(value: float | None, scale: float = _MM) -> float | None:
    return None if value is None else scale * value
