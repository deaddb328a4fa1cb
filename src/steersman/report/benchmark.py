"""The page of a benchmark: ranking, profiles, where each controller is good and where it fails."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

from steersman.bench.replay import ShownCase
from steersman.bench.results import (
    BenchResult,
    PooledErrors,
    Summary,
    SweepStep,
)
from steersman.report.article import LinePlot, PlotLine, Section, Table, write_article
from steersman.report.cases import places, replays, worst
from steersman.report.charts import HeatMap
from steersman.report.performance import performance_profiles
from steersman.report.ranking import measured, ranking
from steersman.report.tables import scaled, text
from steersman.report.view import ResultView, article_view

TITLE = "Steering controllers compared"
_SWEEPS = {
    "delay": "steering delay, added [s]",
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


def shown_bench(results: BenchResult) -> ResultView:
    """What a benchmark shows of itself: the page without drives."""
    return article_view(sections(results.summary, ()), TITLE)


def sections(
    summary: Summary, cases: Sequence[ShownCase], shown: str | None = None
) -> list[Section]:
    """The sections of the page.

    Args:
        summary: the figures.
        cases: drives to show.
        shown: which seed of each method the rows are, where they are of one alone.
    """
    several = len(summary.controllers) >= _SEVERAL
    return [
        ranking(summary, shown),
        *([performance_profiles(summary)] if several else []),
        *([_map(summary, "grip", "Grip")] if len(summary.by.get("grip", {})) > 1 else []),
        _disturbances(summary),
        _map(summary, "path", "Paths"),
        _ride(summary),
        *worst(summary, cases),
    ]


def _disturbances(summary: Summary) -> Section:
    section = _map(summary, "disturbance", "Disturbances")
    sweeps = [
        _sweep(summary, name, axis, steps)
        for name, axis in _SWEEPS.items()
        if len(steps := summary.sweeps.get(name, [])) >= _SEVERAL
    ]
    slippery = (
        "On slippery roads speeds are lower too: of the friction they need 60 % in bends and 30 %"
        " behind them, unless the name says otherwise."
    )
    return section._replace(text=[*section.text, slippery], figures=[*section.figures, *sweeps])


def _sweep(summary: Summary, name: str, axis: str, steps: Sequence[SweepStep]) -> LinePlot:
    table, values, lines = summary.by["disturbance"], [step.value for step in steps], []
    for controller, place in places(summary).items():
        found = [table[step.disturbance][controller].rms_m.scaled(_MM) for step in steps]
        y, low, high = ([getattr(one, k) for one in found] for k in ("value", "low", "high"))
        lines.append(PlotLine(controller, values, y, low, high, look=place))
    title = f"Error against {axis.partition(' [')[0]}"
    return LinePlot(f"sweep_{name}", title, axis, "RMS error [mm]", lines, log=True)


def _map(summary: Summary, factor: str, title: str) -> Section:
    table, names = summary.by[factor], list(summary.controllers)
    cells = [[scaled(column[name].rms_m.value, _MM) for column in table.values()]
             for name in names]  # fmt: skip
    marks = [
        [_mark(column[name], cell) for column, cell in zip(table.values(), row, strict=True)]
        for name, row in zip(names, cells, strict=True)
    ]
    known = [cell for row in cells for cell in row if cell]
    low, high = (min(known), max(known)) if known else (1.0, 10.0)
    heading, high = f"RMS error [mm] by {factor}", max(high, 1.01 * low)
    figure = HeatMap(f"map_{factor}", heading, names, list(table), cells, marks, low, high)
    words = "RMS error in mm, over all scenarios of a column; a star: not all runs were completed."
    return Section(title, [words], figures=[figure])


def _mark(found: PooledErrors, cell: float | None) -> str:
    return text(cell, 3) + ("*" if found.failures else "")


def _ride(summary: Summary) -> Section:
    rows = [
        {
            "controller": name,
            "ISO 11270 kept [%]": scaled(found.iso_11270_share, _PERCENT),
            "UN R79 kept [%]": scaled(found.r79_share, _PERCENT),
            "of runs": found.gentle_runs,
            **measured(found, "weighted_acceleration_m_s2", "ISO 2631 acceleration [m/s²]"),
            "steps clipped [%]": scaled(found.saturated_share, _PERCENT),
            "fallbacks": found.fallbacks,
            "computing time of a step, everything [us]": text(found.computing_us_per_step, 3),
            "steps over 50 ms": found.deadline_misses_50ms,
            "steps over 10 ms": found.deadline_misses_10ms,
            "steps": found.control_steps,
        }
        for name, found in summary.controllers.items()
    ]
    words = (
        "ISO 11270 and UN R79 allow 3 m/s² and 5 m/s³ of lateral acceleration and jerk. Their "
        "shares are over the runs whose path needs no more than 3 m/s²: elsewhere no "
        "controller could keep to it. Computing times hold whatever else the machine did; "
        "everything is plant, sensing, controller, record and metrics, in processor time."
    )
    return Section("Comfort and effort", [words], tables=[Table("Ride and computing", rows)])
