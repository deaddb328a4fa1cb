"""What a tuning chose, and what it could have: error against steering activity of every trial."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.config import dump
from steersman.files import write_text
from steersman.naming import called
from steersman.report.article import LinePlot, PlotLine, Section, Table, write_article
from steersman.report.tables import scaled, text
from steersman.report.view import ResultView, article_view
from steersman.studies.trials import TRADED, TuneResult, TuningTrial, TuningTrials
from steersman.table_file import flat

_MM, _PER_MILLE, _MINUTE = 1e3, 1e3, 60.0
# Trials worse than the chosen one by more than this factor are left out of the drawing.
_FAR = 10.0


def write_tuning(result: TuneResult, trade: TuningTrials, folder: FilePath) -> bool:
    """Write ``pareto.svg`` and, if the extra ``report`` is there, ``report.html``.

    Args:
        result: what was chosen.
        trade: the trials.
        folder: where to write.

    Returns:
        Whether the page was written.

    Raises:
        DataError: the files cannot be written.
    """
    if find_spec("jinja2") is None:
        write_text(folder / "pareto.svg", pareto_figure(trade).svg())
        return False
    page = folder / "report.html"
    write_article(_sections(result, trade), page, f"Tuning of {trade.controller}", plots=".")
    return True


def shown_tuning(result: TuneResult) -> ResultView:
    """What a tuning shows of itself: its page; without its trials, the line alone."""
    trade = result.history
    sections = [Section(result.line())] if trade is None else _sections(result, trade)
    return article_view(sections, f"Tuning of {called(result.controller)}")


def _sections(result: TuneResult, trade: TuningTrials) -> list[Section]:
    return [
        Section(
            "What was chosen",
            [chosen_words(trade), *([_EXPLAINED] if trade.gains else [])],
            tables=[_gains(result, trade)],
        ),
        Section(
            "Error against steering activity",
            [_explained(trade)],
            tables=[_table(trade)],
            figures=[pareto_figure(trade)],
        ),
        Section("The search", figures=[_history(trade)]),
    ]


def _gains(result: TuneResult, trade: TuningTrials) -> Table:
    """Each gain before and after, where it was searched, and how much hangs on it."""
    before, after = flat(result.start), flat(dump(result.controller) or {})
    searched = {gain.name: gain for gain in trade.gains}
    rows = []
    for name in trade.chosen().parameters:
        row: dict[str, Any] = {
            "gain": name,
            "before": before.get(name),
            "tuned": after.get(name),
        }
        if (gain := searched.get(name)) is not None:
            end = f"pressed to its {gain.pressed} end" if gain.pressed else "within"
            row |= {"searched from": gain.low, "to": gain.high, "of the range": end}
            row["importance [%]"] = scaled(gain.importance, 100.0)
        rows.append(row)
    decimals = {"importance [%]": 0}
    return Table("Gains", rows, decimals=decimals)


_EXPLAINED = (
    "Importance: how much of what tells the best tenth of the trials from all of them lies in this"
    " gain (PED-ANOVA). A value pressed to an end of its range may be better beyond it: the range"
    " is widened every 20 trials as far as the field allows."
)


def _history(trade: TuningTrials) -> LinePlot:
    numbers, costs = zip(*((row.number, _MM * row.cost_m) for row in trade.trials), strict=True)
    lines = [
        PlotLine("trials", numbers, costs, dots=2.5),
        PlotLine("least so far", numbers, np.minimum.accumulate(costs)),
    ]
    return LinePlot("history", "Cost of each trial", "trial", "cost [mm]", lines, log=True)


def pareto_figure(trade: TuningTrials) -> LinePlot:
    """The trials; those that are much worse than the chosen one are left out."""
    rows = [row for row in trade.trials if row.rms_error_m is not None]
    kept = _near(rows)
    return LinePlot(
        "pareto",
        f"Trials of {trade.controller}",
        "steering activity: RMS change of the command in a step [1/1000]",
        "RMS lateral error [mm]",
        [
            _dots("trials", 2.5, [row for row in kept if not row.on_front]),
            _dots("Pareto front", 4.0, [row for row in kept if row.on_front]),
            _dots("chosen", 6.0, [row for row in kept if row.chosen]),
        ],
        log=True,
        log_x=True,
    )


def _near(rows: Sequence[TuningTrial]) -> list[TuningTrial]:
    chosen = next((row for row in rows if row.chosen), None)
    if chosen is None:
        return list(rows)
    return [
        row
        for row in rows
        if row.on_front or all(_near_chosen(row, chosen, name) for name in TRADED)
    ]


def _near_chosen(row: TuningTrial, chosen: TuningTrial, name: str) -> bool:
    most = getattr(chosen, name)
    return not most or bool(getattr(row, name) <= _FAR * most)


def _dots(name: str, size: float, rows: Sequence[TuningTrial]) -> PlotLine:
    changes = [_PER_MILLE * (row.steer_change_rms or 0.0) for row in rows]
    return PlotLine(name, changes, [_MM * (row.rms_error_m or 0.0) for row in rows], dots=size)


def chosen_words(trade: TuningTrials) -> str:
    """What was chosen, with its error and steering activity, as a sentence."""
    row = trade.chosen()
    words = f"Trial {row.number} of {trade.controller} was chosen, cost {_mm(row.cost_m)}"
    if row.rms_error_m is None:
        return f"{words}; it is from before errors and steering activity were kept."
    front = "on" if row.on_front else "off"
    parts = (
        f"{_mm(row.tracking_m)} tracking, {_mm(row.smoothness_m)} smoothness,"
        f" {_mm(row.failure_m)} failures"
    )
    return (
        f"{words} ({parts}), {front} the Pareto front: RMS error {_mm(row.rms_error_m)},"
        f" steering {text(_PER_MILLE * (row.steer_change_rms or 0.0), 3)}/1000 a step,"
        f" failures {row.failures}."
    )


def spent_words(trade: TuningTrials) -> str:
    """The tuning's cost in simulated time, as a sentence."""
    seconds, trials, known = trade.simulated_seconds, len(trade.trials), trade.measured
    words = f"{seconds:.0f} s ({seconds / _MINUTE:.4g} min) were simulated in {known} trials"
    left_out = trials - known
    return f"{words}; {left_out} older ones were not counted." if left_out else f"{words}."


def _explained(trade: TuningTrials) -> str:
    return (
        f"{spent_words(trade)} The front has the trials to which none is better in one of RMS error"
        " and steering activity and as good in the other, among those with the fewest failed runs."
        " Errors are pooled over the runs, what was not driven counts as the corridor's half width."
        " The chosen trial has the least cost; trials ten times worse than it are not drawn."
    )


def _table(trade: TuningTrials) -> Table:
    shown = [row for row in trade.trials if row.on_front or row.chosen]
    rows = [
        {
            "trial": row.number,
            "": "chosen" if row.chosen else "",
            "cost [mm]": scaled(row.cost_m, _MM),
            "RMS error [mm]": scaled(row.rms_error_m, _MM),
            "steering [1/1000]": scaled(row.steer_change_rms, _PER_MILLE),
            "failures": row.failures,
        }
        for row in sorted(shown, key=lambda row: row.cost_m)
    ]
    return Table("The front and the chosen trial", rows)


def _mm(value: float | None) -> str:
    return f"{text(_MM * (value or 0.0), 3)} mm"
