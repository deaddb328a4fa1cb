"""What an identification writes: the vehicle file, plain data, the sections of a page."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.provenance import provenance
from steersman.studies.identify import lateral, longitudinal
from steersman.studies.identify.identification import FITTED, GIVEN, UNITS, Figure, Identified
from steersman.studies.vehicle_file import write_vehicle
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

TITLE = "Identification"
# Rows of a figure, and of the residuals' histogram of lags.
_MOST_POINTS = 1500
_SHOWN = 60.0


def write(found: Identified, file: FilePath) -> None:
    """Write the vehicle as a file that every command takes, each fitted figure with its interval.

    Raises:
        DataError: it cannot be written.
    """
    head = [
        f"Identified from {found.log.name}, {found.seconds:.0f} s of it fitted, beginning with "
        f"{found.before.title}; commit {provenance()['commit']}.",
        "Behind a figure: its 95 % interval, or why it was kept. What bears no mark was not looked "
        "for.",
    ]
    head += [
        f"  {e.signal}: RMS error on what was held out {e.after:.3g} {e.unit} "
        f"(before: {e.before:.3g})"
        for e in found.errors
    ]
    write_vehicle(found.vehicle, file, head, _marks(found.figures))


def _marks(figures: list[Figure]) -> dict[str, str]:
    """Comment of each field; of fields with several values all in one."""
    out: dict[str, list[str]] = {}
    for figure in figures:
        field, _, at = figure.name.partition("[")
        if field != "offset":
            out.setdefault(field, []).append((f"[{at} " if at else "") + described(figure))
    return {field: "; ".join(told) for field, told in out.items()}


def described(figure: Figure) -> str:
    """Interval and status in a few words."""
    if figure.low is None or figure.high is None:
        return f"{figure.status}" + (f": {figure.note}" if figure.note else "")
    note = f", {figure.note}" if figure.note else ""
    return f"{figure.low:.4g} to {figure.high:.4g}{note}"


def plain(found: Identified) -> dict[str, Any]:
    """All that was found, as JSON takes it."""
    return {
        "log": found.log.name,
        "seconds_fitted": found.seconds,
        "start": found.before.kind,
        "figures": [f._asdict() for f in found.figures],
        "held_out": [e._asdict() for e in found.errors],
    }


# ---------------------------------------------------------------------------------- page


def sections(found: Identified) -> list[dict[str, Any]]:
    """What the page shows: figures with intervals, errors held out, signals and what is left."""
    return [_figures(found), _held_out(found), *_signals(found)]


def _figures(found: Identified) -> dict[str, Any]:
    told = [f for f in found.figures if f.status in {FITTED, GIVEN}]
    kept = [f for f in found.figures if f.status not in {FITTED, GIVEN}]
    columns = {"name": "figure", "unit": "unit", "before": "before", "value": "now"}
    interval = {"interval": "95 % interval, or why it is kept"}
    tables = [
        {"title": title, "columns": columns | interval, "rows": [_row(f) for f in some]}
        for title, some in (("Told by the recording", told), ("Kept", kept))
        if some
    ]
    text = [
        f"{found.log.name}: {found.seconds:.0f} s were fitted. The starting vehicle is "
        f"{found.before.kind}.",
        "Intervals hold the uncertainty of the figures that are kept, and are widened where "
        "residuals are correlated.",
    ]
    return {"title": "Figures", "text": text, "tables": tables}


def _row(figure: Figure) -> dict[str, Any]:
    row = {"name": figure.name, "unit": figure.unit, "interval": described(figure)}
    return row | {"before": f"{figure.before:.5g}", "value": f"{figure.value:.5g}"}


def _held_out(found: Identified) -> dict[str, Any]:
    columns = {"signal": "signal", "unit": "unit", "before": "before", "after": "now"}
    rows = [
        {"signal": e.signal, "unit": e.unit, "before": f"{e.before:.4g}", "after": f"{e.after:.4g}"}
        for e in found.errors
    ]
    text = [
        "RMS of simulated minus measured on the blocks that were not fitted; before: with the "
        "starting vehicle. Sensor noise is part of both."
    ]
    table = {"title": "Errors held out", "columns": columns, "rows": rows}
    return {"title": "Held out", "text": text, "tables": [table] if rows else []}


def _signals(found: Identified) -> list[dict[str, Any]]:
    log, everything = found.log, np.full(len(found.log.time), True)
    seen = lateral.measured(log, found.stretches, everything)
    sides = [
        lateral.simulated(vehicle, log, found.stretches, found.offsets)
        for vehicle in (found.before, found.vehicle)
    ]
    figures = []
    for k, name in enumerate(lateral.channels(log)):
        figures += _pair(found, name, seen[:, k], sides[0][:, k], sides[1][:, k])
    if log.get("throttle") is not None:
        ahead = [
            longitudinal.speeds(v, log, found.stretches) for v in (found.before, found.vehicle)
        ]
        figures += _pair(found, "v_x", log.signals["v_x"], *ahead)
        figures.append(_map(found.before, found.vehicle))
    figures.append(_autocorrelation(found, seen - sides[1]))
    text = [
        f"The first {_SHOWN:.0f} s, and what is left of the whole recording. The speed is let go "
        f"from the recorded one every {longitudinal.SEGMENT:.0f} s."
    ]
    return [{"title": "Signals", "text": text, "figures": figures}]


def _pair(
    found: Identified, name: str, seen: FloatArray, before: FloatArray, after: FloatArray
) -> list[dict[str, Any]]:
    """Measured and simulated, and what is left."""
    time, unit = found.log.time, UNITS[name]
    some = np.flatnonzero(time <= _SHOWN)
    some = some[:: max(len(some) // _MOST_POINTS, 1)]
    thin = slice(None, None, max(len(time) // _MOST_POINTS, 1))
    lines: list[dict[str, Any]] = [
        {"name": "measured", "x": time[some], "y": seen[some], "dots": 1.0},
        {"name": f"before ({found.before.kind})", "x": time[some], "y": before[some]},
        {"name": "identified", "x": time[some], "y": after[some]},
    ]
    left: list[dict[str, Any]] = [
        {"name": "fitted", "x": time[found.use][thin], "y": (after - seen)[found.use][thin]},
        {"name": "held out", "x": time[~found.use][thin], "y": (after - seen)[~found.use][thin]},
    ]
    axes = {"x": "time [s]", "y": f"{name} [{unit}]"}
    return [
        {"file": name, "title": f"{name}", **axes, "lines": _numbers(lines)},
        {
            "file": f"{name}_left",
            "title": f"{name}: simulated minus measured",
            **axes,
            "lines": _numbers([{**line, "dots": 1.0} for line in left]),
        },
    ]


def _numbers(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [line | {k: np.asarray(line[k], float).tolist() for k in ("x", "y")} for line in lines]


def _map(before: Vehicle, after: Vehicle) -> dict[str, Any]:
    lines: list[dict[str, Any]] = []
    for level, row in zip(after.map_throttle, after.map_acceleration, strict=True):
        lines.append({"name": f"throttle {level:g}", "x": after.map_speed, "y": row})
    for level, row in zip(before.map_throttle, before.map_acceleration, strict=True):
        lines.append({"name": f"{level:g}, before", "x": before.map_speed, "y": row, "dots": 2.5})
    return {
        "file": "throttle_map",
        "title": "Net acceleration on a straight",
        "x": "speed [m/s]",
        "y": "acceleration [m/s^2]",
        "lines": lines,
    }


def _autocorrelation(found: Identified, left: FloatArray) -> dict[str, Any]:
    """Of each lateral signal's residuals: white noise is 1 at zero and nothing elsewhere."""
    step, lags = float(np.median(np.diff(found.log.time))), np.arange(41)
    lines = []
    for name, signal in zip(lateral.channels(found.log), left.T, strict=True):
        column = np.nan_to_num(signal - np.nanmedian(signal))
        whole = float(column @ column) or 1.0
        values = [float(column[k:] @ column[: len(column) - k]) / whole for k in lags]
        lines.append({"name": name, "x": (lags * step).tolist(), "y": values})
    return {
        "file": "autocorrelation",
        "title": "Autocorrelation of what is left",
        "x": "lag [s]",
        "y": "correlation [-]",
        "lines": lines,
    }
