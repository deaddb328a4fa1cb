"""What a benchmark leaves in its folder: ``results.json`` and ``suite.yaml`` beside its rows."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman.bench.drive import Row
from steersman.bench.entrants import Entrant
from steersman.bench.maps import Map
from steersman.bench.suite import Suite
from steersman.bench.summary import summarise_rows
from steersman.config import to_yaml
from steersman.files import write_text
from steersman.provenance import provenance

FORMAT = 1


def results(
    name: str,
    seeds: Sequence[int],
    rows: Sequence[Row],
    entrants: Sequence[Entrant],
    maps: Sequence[Map] = (),
) -> dict[str, Any]:
    """The result as plain data: where it came from, who drove, and the summary."""
    return {
        "format": FORMAT,
        "suite": name,
        "seeds": list(seeds),
        **(_of(maps) if maps else {}),
        **provenance(),
        "made_by": sorted({str(row["commit"]) for row in rows}),
        "controllers": {e.name: e.shown for e in entrants},
        "summary": summarise_rows(rows, entrants),
    }


def _of(maps: Sequence[Map]) -> dict[str, Any]:
    """What was made of each map, and which of them gave nothing to drive on."""
    return {
        "maps": {found.name: found.plain() for found in maps},
        "maps_left_out": [found.name for found in maps if not found.courses],
    }


def write(out: FilePath, found: dict[str, Any], suite: Suite) -> None:
    """Write ``results.json`` and ``suite.yaml``.

    Raises:
        DataError: they cannot be written.
    """
    write_text(out / "results.json", json.dumps(found, indent=1, allow_nan=False) + "\n")
    write_text(out / "suite.yaml", to_yaml(suite))
