"""The page of an identification: figures with intervals, errors held out, signals, residuals."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.report.article import LinePlot, PlotLine, Section, Table, write_article
from steersman.studies.identify import lateral, longitudinal
from steersman.studies.identify.identification import FITTED, GIVEN, SEEN, Figure, Identified
from steersman.studies.identify.prediction import UNITS
from steersman.studies.identify.result import described
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

TITLE = "Identification"
# Points of a line, and the recording's first seconds, which are drawn.
_MOST_POINTS = 1500
_SHOWN = 60.0


def write_identification(found: Identified, out: FilePath) -> None:
    """Write the page, and its figures as files into a folder named after it.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
        DataError: the files cannot be written.
    """
    sections = [_figures(found), _held_out(found), _signals(found)]
    write_article(sections, out, TITLE, plots=f"{out.stem}_plots")


def _figures(found: Identified) -> Section:
    tables: dict[str, list[dict[str, Any]]] = {"Determined by the recording": [], "Kept": []}
    for figure in found.figures:
        told = figure.status in {FITTED, GIVEN, SEEN}
        tables["Determined by the recording" if told else "Kept"].append(_row(figure))
    text = [
        f"{found.log.name}: {found.seconds:.0f} s were fitted. The starting vehicle is "
        f"{found.before.title}.",
        *(f"Left out: {left.seconds:.1f} s {left.reason}." for left in found.left_out),
        "Intervals hold the uncertainty of the figures that are kept, and are widened where "
        "residuals are correlated.",
    ]
    return Section("Figures", text, tables=[Table(title, rows) for title, rows in tables.items()])


def _row(figure: Figure) -> dict[str, Any]:
    return {
        "figure": figure.name,
        "unit": figure.unit,
        "before": f"{figure.before:.5g}",
        "now": f"{figure.value:.5g}",
        "95 % interval, or why it is kept": described(figure),
    }


def _held_out(found: Identified) -> Section:
    rows = [
        {
            "signal": e.signal,
            "unit": e.unit,
            "before": f"{e.before:.4g}",
            "now": f"{e.after:.4g}",
            "white noise": f"{e.noise:.2g}",
        }
        for e in found.errors
    ]
    text = (
        "RMS error of 1 s predictions from the recorded state, on what was not fitted; before: "
        "with the starting vehicle. The sensor's noise is part of both; its white part is the last "
        "column."
    )
    return Section("Held out", [text], tables=[Table("Errors held out", rows)])


def _signals(found: Identified) -> Section:
    log, sides = found.log, (found.before, found.vehicle)
    seen = lateral.measured(log, found.stretches, np.full(len(log.time), True))
    before, after = (lateral.simulated(v, log, found.stretches, found.sensors) for v in sides)
    figures = []
    for k, name in enumerate(lateral.channels(log)):
        figures += _pair(found, name, seen[:, k], before[:, k], after[:, k])
    if log.get("throttle") is not None:
        speeds = [longitudinal.speeds(vehicle, log, found.stretches) for vehicle in sides]
        figures += _pair(found, "v_x", log.signals["v_x"], *speeds)
        figures.append(_map(found.before, found.vehicle))
    figures.append(_autocorrelation(found, seen - after))
    text = (
        f"The first {_SHOWN:.0f} s, and what is left of the whole recording. The speed is let go "
        f"from the recorded one every {longitudinal.SEGMENT:.0f} s."
    )
    return Section("Signals", [text], figures=figures)


def _pair(
    found: Identified, name: str, seen: FloatArray, before: FloatArray, after: FloatArray
) -> list[LinePlot]:
    """Measured and simulated, and what is left."""
    time, used = found.log.time, found.use
    some = np.flatnonzero(time <= _SHOWN)
    some = some[:: max(len(some) // _MOST_POINTS, 1)]
    thin = slice(None, None, max(len(time) // _MOST_POINTS, 1))
    lines = [
        PlotLine("measured", time[some], seen[some], dots=1.0),
        PlotLine(f"before ({found.before.title})", time[some], before[some]),
        PlotLine("identified", time[some], after[some]),
    ]
    left = [
        PlotLine(words, time[rows][thin], (after - seen)[rows][thin], dots=1.0)
        for words, rows in (("fitted", used), ("held out", ~used))
    ]
    axes = ("time [s]", f"{name} [{UNITS[name]}]")
    return [
        LinePlot(name, name, *axes, lines),
        LinePlot(f"{name}_left", f"{name}: simulated minus measured", *axes, left),
    ]


def _map(before: Vehicle, after: Vehicle) -> LinePlot:
    lines = [
        PlotLine(f"throttle {level:g}", after.map_speed, row)
        for level, row in zip(after.map_throttle, after.map_acceleration, strict=True)
    ]
    lines += [
        PlotLine(f"{level:g}, before", before.map_speed, row, dots=2.5)
        for level, row in zip(before.map_throttle, before.map_acceleration, strict=True)
    ]
    title, axes = "Net acceleration on a straight", ("speed [m/s]", "acceleration [m/s^2]")
    return LinePlot("throttle_map", title, *axes, lines)


def _autocorrelation(found: Identified, left: FloatArray) -> LinePlot:
    """Of each lateral signal's residuals: white noise is 1 at zero and nothing elsewhere."""
    step, lags = float(np.median(np.diff(found.log.time))), np.arange(41)
    lines = []
    for name, signal in zip(lateral.channels(found.log), left.T, strict=True):
        column = np.nan_to_num(signal - np.nanmedian(signal))
        whole = float(column @ column) or 1.0
        values = [float(column[k:] @ column[: len(column) - k]) / whole for k in lags]
        lines.append(PlotLine(name, (lags * step).tolist(), values))
    title = "Autocorrelation of what is left"
    return LinePlot("autocorrelation", title, "lag [s]", "correlation [-]", lines)
