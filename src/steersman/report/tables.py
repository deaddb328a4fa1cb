"""Numbers as text: the tables of the page, still to be escaped by the template."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from steersman.bench.results import IntervalEstimate
from steersman.metrics.base import metrics
from steersman.naming import recorded_name, shown_name
from steersman.report.runs import ReportRun, Table
from steersman.table_file import flat

NOTHING = "\u2013"
"""What stands for an undefined value: a dash."""
# Numbers below are written out, without an exponent.
LARGE = 1e7


class Column(NamedTuple):
    """A column of the summary: metric (``steady.`` for the last half), header, unit, scale."""

    metric: str
    header: str
    unit: str = ""
    scale: float = 1.0


class Cell(NamedTuple):
    """One cell; numbers are set to the right, ``bad`` ones are marked."""

    text: str
    number: bool = False
    bad: bool = False


# Metrics of which every value but 0 is marked.
_BAD = frozenset({"fallbacks", "interventions"})
SUMMARY = (
    Column("mean_abs_lateral_error_m", "mean |d|", "mm", 1e3),
    Column("steady.mean_abs_lateral_error_m", "same, last half", "mm", 1e3),
    Column("p95_abs_lateral_error_m", "95 % |d|", "mm", 1e3),
    Column("max_abs_lateral_error_m", "max |d|", "mm", 1e3),
    Column("mean_abs_heading_error_deg", "mean |heading err.|", "°"),
    Column("mean_abs_course_error_deg", "mean |course err.|", "°"),
    Column("steer_std", "SD of steer.", "-"),
    Column("steer_rate_rms_per_s", "RMS steer. rate", "1/s"),
    Column("lateral_jerk_rms_m_s3", "RMS lat. jerk", "m/s³"),
    Column("max_lateral_acceleration_m_s2", "max |a_y|", "m/s²"),
    Column("mean_speed_m_s", "mean speed", "m/s"),
    Column("saturated", "clip-ped", "steps"),
    Column("fallbacks", "fall-backs", "steps"),
    Column("interventions", "inter-ventions", "times"),
    Column("control_time_us_p50", "step time p50", "µs"),
    Column("control_time_us_p99", "step time p99", "µs"),
)


def text(value: Any, digits: int = 4) -> str:
    """A value for reading: so many significant digits, a dash for what is undefined."""
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if not math.isfinite(value):
            return NOTHING
        return f"{value:.0f}" if 10.0**digits <= abs(value) < LARGE else f"{value:.{digits}g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(text(item, digits) for item in value)
    return str(value)


def scaled(value: float | None, factor: float) -> float | None:
    """A value in another unit; None stays None."""
    return None if value is None else factor * value


def interval_text(found: IntervalEstimate | None, scale: float = 1.0, gap: str = " ") -> str:
    """An estimate with its interval in brackets, if there is one; ``gap`` is before it."""
    if found is None or found.value is None:
        return NOTHING
    value, low, high = (
        text(scaled(number, scale), 3) for number in (found.value, found.low, found.high)
    )
    return value if found.low is None or found.high is None else f"{value}{gap}[{low}, {high}]"


def difference_text(found: IntervalEstimate, scale: float, gap: str) -> str:
    """A difference with its interval; two figures may be equal."""
    return "equal" if found.value == 0.0 else interval_text(found, scale, gap)


def cell(value: Any, decimals: int | None = None) -> Cell:
    """A cell of a table made elsewhere; floats with so many decimals, or four digits."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if isinstance(value, float) and math.isfinite(value) and decimals is not None:
        return Cell(f"{value:.{decimals}f}", number=True)
    return Cell(text(value), number=number or value is None)


def summary_columns(runs: Sequence[ReportRun]) -> list[Column]:
    """The columns of these runs' summary: interventions only where there was one."""
    any_ = any(run.metrics.get("interventions") for run in runs)
    return [column for column in SUMMARY if any_ or column.header != _IF_ANY]


def summary_row(run: ReportRun, columns: Sequence[Column] = SUMMARY) -> list[Cell]:
    """Controller, car, how the run ended, and the summary's metrics."""
    values = flat(run.metrics)
    done = values.get("completed")
    end = str(values.get("end", NOTHING)).replace("_", " ")
    where = _elsewhere(run)
    car = _kind(run, "vehicle") + (f" ({where})" if where else "")
    return [
        Cell(_kind(run, "controller")),
        Cell(car),
        Cell(end, bad=done is False),
        *(_summary_cell(values, c) for c in columns),
    ]


class Tile(NamedTuple):
    """A figure in large letters: what, how much, and the unit."""

    title: str
    text: str
    unit: str = ""
    bad: bool = False


# Of these a page of one drive shows tiles.
_TILES = ("mean |d|", "95 % |d|", "max |d|", "mean speed", "max |a_y|", "clip-ped", "fall-backs")
_IF_ANY = "inter-ventions"


def tiles(run: ReportRun) -> list[Tile]:
    """Controller, car, how the drive ended, and its main figures."""
    values = flat(run.metrics)
    done = values.get("completed")
    end = str(values.get("end", NOTHING)).replace("_", " ")
    words = [
        Tile(part, shown_name(run.config, part) or NOTHING) for part in ("controller", "vehicle")
    ]
    where = _elsewhere(run)
    if where:
        words.append(Tile("driven on", where))
    out = [*words, Tile("ended by", end, bad=done is False)]
    for column in SUMMARY:
        shown = column.header in _TILES or (column.header == _IF_ANY and values.get(column.metric))
        if shown:
            found = _summary_cell(values, column)
            title = column.header.replace("-", "")
            out.append(Tile(title, found.text, column.unit, found.bad))
    return out


def _kind(run: ReportRun, part: str) -> str:
    """What a part of the run's configuration is called; a dash where none is known."""
    return recorded_name(run.config, part) or NOTHING


def _elsewhere(run: ReportRun) -> str:
    """The plant, if it is not the embedded simulator: a stand-in's numbers are not CARLA's."""
    found = _kind(run, "plant")
    return "" if found in {NOTHING, "simulator", "embedded simulator"} else found


def _summary_cell(values: Mapping[str, Any], column: Column) -> Cell:
    value = values.get(column.metric)
    if isinstance(value, float):
        value *= column.scale
    return Cell(text(value, 3), number=True, bad=column.metric in _BAD and bool(value))


def all_metrics(runs: Sequence[ReportRun]) -> list[dict[str, Any]]:
    """Every metric of every run: a row for each metric, in the order of first appearance."""
    values = [flat(run.metrics) for run in runs]
    names = dict.fromkeys(name for run in values for name in run)
    return [
        {
            "name": name,
            "meaning": _meaning(name),
            "cells": [Cell(text(run.get(name)), number=True) for run in values],
        }
        for name in names
    ]


def _meaning(name: str) -> str:
    metric = metrics().get(name.removeprefix("steady."))
    if metric is None:
        return ""
    return metric.meaning + (", last half of the run" if name.startswith("steady.") else "")


class Grid(NamedTuple):
    """A table made elsewhere, as text."""

    title: str
    headers: list[Cell]
    rows: list[list[Cell]]
    about: str = ""


def grid(table: Table) -> Grid:
    """The cells of a table made elsewhere; a column with a number is set to the right.

    Columns in which no row has anything are left out.
    """
    decimals = table.decimals or {}
    shown = [
        key for key in table.headers if any(row.get(key) not in {None, ""} for row in table.rows)
    ]
    rows = [[cell(row.get(key), decimals.get(key)) for key in shown] for row in table.rows]
    headers = [
        Cell(
            table.headers[key],
            number=any(row[k].number and row[k].text != NOTHING for row in rows),
        )
        for k, key in enumerate(shown)
    ]
    rows = [[c._replace(number=h.number) for c, h in zip(r, headers, strict=True)] for r in rows]
    return Grid(table.title, headers, rows, table.about)
