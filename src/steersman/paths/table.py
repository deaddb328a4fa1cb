"""A path as a table of points."""

from __future__ import annotations

import math

import numpy as np

from steersman.protocols import Path

_SPACING = 1.0
_COLUMNS = "s_m,x_m,y_m,heading_rad,curvature_1_m,height_m,bank_rad"


def csv_table(path: Path) -> str:
    """A line for each metre at most, the end of open paths included; ``path=csv`` reads x and y.

    Headings are unwrapped. Height and banking (left side up positive) are 0 on flat roads.
    """
    count, surface = max(math.ceil(path.length / _SPACING), 8), path.surface()
    rows = []
    for s in np.linspace(0.0, path.length, count + 1)[: count if path.closed else None].tolist():
        height, bank = (0.0, 0.0) if surface is None else surface.at(s)
        rows.append((s, *path.at(s), height, bank))
    table = np.array(rows)
    table[:, 3] = np.unwrap(table[:, 3])
    lines = (",".join(f"{value:.9g}" for value in row) for row in table.tolist())
    return "\n".join([_COLUMNS, *lines, ""])
