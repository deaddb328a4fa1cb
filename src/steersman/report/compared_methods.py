"""What a comparison shows of methods: over their seeds, and how their trainings went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from statistics import median
from typing import Any

from steersman.report.article import LinePlot, PlotLine, Section, Table
from steersman.report.charts import IntervalPlot, ShownEstimate
from steersman.report.curves import band
from steersman.report.runs import read_progress
from steersman.report.tables import text
from steersman.seed_folders import seeds_in
from steersman.studies.compare.replicates import ReplicatedComparison
from steersman.studies.compare.results import (
    ContestantRecord,
    ScenarioCompareResult,
    TrainingRecord,
)

_CURVES = {
    "validation_error_mm": "validation error [mm]",
    "off_track_resets": "off-track resets",
}
_MM = 1e3


def seeds_figure(found: ReplicatedComparison) -> IntervalPlot:
    """Each method's interquartile mean with its interval, and under it the error of each seed."""
    points = []
    for k, one in enumerate(found.methods):
        points.append(
            ShownEstimate(f"{one.name}: IQM", **one.iqm_m.scaled(_MM).model_dump(), look=k)
        )
        if len(one.runs) > 1:
            points += [
                ShownEstimate(f"{run.name}: RMS", _MM * run.rms_m, look=k, diamond=True)
                for run in one.runs
            ]
    title = "Errors over seeds: interquartile mean, and the RMS error of each"
    return IntervalPlot("over_seeds", title, "mm", points)


def trainings(found: ScenarioCompareResult) -> list[Section]:
    """The trainings among the contestants, alone or with several seeds; nothing without any."""
    trained = [one for one in found.contestants if one.training is not None or one.trainings]
    if not trained:
        return []
    several = any(one.trainings for one in trained)
    lines = [_line(one) for one in trained]
    records = {one.name: _records(one) for one in trained}
    figures = [
        _curve(records, column, title)
        for column, title in _CURVES.items()
        if all(_drawable(each, column) for of_one in records.values() for each in of_one)
    ]
    words = "The exported policy of each, and the records of the trainings."
    if several:
        words += " Of several seeds the median, and in brackets the least and the largest value."
    return [Section("Trainings", [words], tables=[Table("Trainings", lines)], figures=figures)]


def _line(one: ContestantRecord) -> dict[str, Any]:
    found = [one.training] if one.training is not None else list((one.trainings or {}).values())
    return {
        "training": one.name,
        "seeds": str(len(found)),
        "steps": _spread(found, "steps", 1.0, 8),
        "simulated [s]": _spread(found, "simulated_seconds", 1.0, 5),
        "validation error [mm]": _spread(found, "validation_mean_error", _MM, 3),
        "failures": _spread(found, "validation_failures", 1.0, 3),
    }


def _spread(found: Sequence[TrainingRecord], name: str, factor: float, digits: int) -> str:
    """The median, and of several that differ their range."""
    known = [factor * v for one in found if (v := getattr(one, name)) is not None]
    if not known:
        return ""
    shown, low, high = (text(v, digits) for v in (median(known), min(known), max(known)))
    return shown if low == high else f"{shown} [{low}, {high}]"


def _records(one: ContestantRecord) -> list[Mapping[str, Any]]:
    """The records of a training, or of each of its seeds."""
    folder = FilePath(one.source)
    places = [folder] if one.training is not None else list(seeds_in(folder).values())
    return [read_progress(place / "progress.csv") for place in places]


def _drawable(record: Mapping[str, Any], column: str) -> bool:
    """Whether a record makes a line of a column."""
    return {"steps", column} <= set(record) and len(record["steps"]) > 1


def _curve(records: Mapping[str, Sequence[Mapping[str, Any]]], column: str, title: str) -> LinePlot:
    lines = [
        PlotLine(
            name if len(of_one) == 1 else f"{name}: median and range of {len(of_one)} seeds",
            **band(of_one, "steps", column),
        )
        for name, of_one in records.items()
    ]
    axes, log = ("environment steps", title), column.endswith("_mm")
    return LinePlot(column, title.partition(" [")[0], *axes, lines, log=log)
