"""Where a drive fails when two quantities are disturbed at once: cells of a map, as asked for."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, Field

from steersman.errors import ConfigError, suggestion
from steersman.live.drives import LONGEST
from steersman.live.form import Choices
from steersman.report.tables import text
from steersman.rollout import RunConfig
from steersman.studies.hunt import MOST_GRIP
from steersman.studies.perturbation import AXES, Ranges
from steersman.studies.tried import drive

_MM = 1e3
MOST_CELLS = 16
"""In one request, so that the page fills while it is seen."""

Share = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]


class MapRequest(BaseModel):
    """Points that are to be driven."""

    choices: Choices
    """The undisturbed drive."""
    x: str
    """The first quantity, one of :data:`steersman.studies.perturbation.AXES`."""
    y: str
    points: list[tuple[Share, Share]] = Field(max_length=MOST_CELLS)
    """Coordinates of both, in shares of their ranges."""


def axes() -> dict[str, dict[str, Any]]:
    """The quantities: unit, and the least coordinate (the largest is 1)."""
    return {name: {"unit": axis.unit, "low": min(0.0, *axis.sides)} for name, axis in AXES.items()}


def map_cells(base: RunConfig, given: MapRequest) -> dict[str, Any]:
    """Whether each point fails, its largest error, and its values in words.

    Raises:
        ConfigError: a quantity is unknown or given twice, or the chosen speed cannot be scaled.
        DataError: a file is missing or malformed.
    """
    for where, name in (("x", given.x), ("y", given.y)):
        if name not in AXES:
            raise ConfigError(f"{name!r} is no quantity{suggestion(name, AXES)}", (where,))
    if given.x == given.y:
        raise ConfigError(f"{given.y} is x already; choose another quantity", ("y",))
    run, ranges = given.choices.config(base), Ranges()
    if (run.duration or 0.0) > LONGEST:
        raise ConfigError(f"must be at most {LONGEST:g} [s]", ("duration",))
    cells = []
    for u, v in given.points:
        point = {given.x: u, given.y: v}
        tried = drive("map", point, ranges.disturbed(run, point), math.inf)
        values = ranges.values(point, run)
        units = {name: "" if AXES[name].unit == "-" else f" {AXES[name].unit}" for name in values}
        words = ", ".join(
            f"{name.replace('_', ' ')} {text(value, 3)}{units[name]}"
            for name, value in values.items()
        )
        if (share := tried.grip_share or 0.0) > MOST_GRIP:
            words += f"; asks an axle for {100 * share:.0f} % of its grip"
        cells.append(
            {
                "failed": tried.failed,
                "end": tried.end.replace("_", " "),
                "max_error_mm": _MM * tried.max_error_m,
                "words": words,
            }
        )
    return {"cells": cells, "ends": {"x": _ends(run, given.x), "y": _ends(run, given.y)}}


def _ends(run: RunConfig, name: str) -> list[str]:
    """The values at the low end, in the middle and at the high end of an axis, with its name."""
    low, ranges = min(0.0, *AXES[name].sides), Ranges()
    values = [ranges.values({name: u}, run)[name] for u in (low, 0.5 * (low + 1.0), 1.0)]
    unit = "" if AXES[name].unit == "-" else f" {AXES[name].unit}"
    first, middle, last = (f"{text(value, 3)}{unit}" for value in values)
    return [f"{name.replace('_', ' ')} {first}", middle, last]
