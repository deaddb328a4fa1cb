"""Results of an identification: the vehicle file, and plain data."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

from steersman.provenance import provenance
from steersman.studies.identify.identification import Figure, Identified
from steersman.studies.identify.unknowns import SENSOR
from steersman.studies.vehicle_file import write_vehicle


def write(found: Identified, file: FilePath) -> None:
    """Write the vehicle as a file that every command takes, each fitted figure with its interval.

    Raises:
        DataError: it cannot be written.
    """
    head = [
        f"Identified from {found.log.name}, {found.seconds:.0f} s of it fitted, beginning with "
        f"{found.before.title}; commit {provenance()['commit']}.",
        "Behind a figure: its 95 % interval, or why it was kept. Without a comment it was not "
        "searched.",
    ]
    head += [
        f"  {e.signal}: RMS error of 1 s predictions of what was held out {e.after:.3g} {e.unit} "
        f"(before: {e.before:.3g})"
        for e in found.errors
    ]
    write_vehicle(found.vehicle, file, head, _marks(found.figures))


def _marks(figures: list[Figure]) -> dict[str, str]:
    """Comment of each field; of fields with several values all in one."""
    out: dict[str, list[str]] = {}
    for figure in figures:
        field, _, at = figure.name.partition("[")
        if field not in {*SENSOR, "lag"}:
            out.setdefault(field, []).append((f"[{at} " if at else "") + described(figure))
    return {field: "; ".join(words) for field, words in out.items()}


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
        "left_out": [left._asdict() for left in found.left_out],
        "held_out": [e._asdict() for e in found.errors],
    }
