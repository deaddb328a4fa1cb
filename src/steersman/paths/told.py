"""What is told of recorded positions: outliers, gaps, angles in another unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from steersman.tables import Sheet
from steersman.types import FloatArray

# An outlier is so many usual distances, and so far [m], beside the middle of its neighbours.
_BESIDE, _LEAST = 4.0, 0.5
# A gap between the ends of a loop that is told, in usual distances.
_WIDE = 5.0


def outlier(place: FloatArray) -> tuple[int, float] | None:
    """The point that stands farthest from the middle of its two neighbours, and how far [m].

    None if no point is far from a place that its neighbours are near.

    Args:
        place: positions in their order, shape (n, 2) [m].
    """
    if len(place) < 4:  # noqa: PLR2004 - of three points any may be the bad one
        return None
    beside = np.linalg.norm(place[1:-1] - 0.5 * (place[:-2] + place[2:]), axis=1)
    usual = float(np.median(np.linalg.norm(np.diff(place, axis=0), axis=1)))
    apart = np.linalg.norm(place[2:] - place[:-2], axis=1)
    far = (beside > max(_BESIDE * usual, _LEAST)) & (beside > 2.0 * apart)
    if not far.any():
        return None
    row = int(np.argmax(np.where(far, beside, 0.0)))
    return row + 1, float(beside[row])


def closing(place: FloatArray) -> float:
    """The distance from the last point to the first [m]; 0 where it is about the usual one."""
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    gap = float(np.linalg.norm(place[-1] - place[0]))
    return gap if gap > _WIDE * float(np.median(steps)) else 0.0


def left_out(place: FloatArray, sheet: Sheet, rows: NDArray[np.int64]) -> str:
    """What is told of rows without a position, and of the road between their neighbours.

    Args:
        place: positions that are there, shape (n, 2) [m].
        sheet: the table.
        rows: of the table that have them, (n,).
    """
    told = f"{len(sheet.rows) - len(rows)} rows without a position are left out"
    after = np.flatnonzero(np.diff(rows) > 1)
    gaps = np.linalg.norm(np.diff(place, axis=0), axis=1)[after]
    if not gaps.size:
        return told
    line = sheet.lines[int(rows[after[int(np.argmax(gaps))]])]
    gap = f"{float(gaps.max()):.3g} m behind {sheet.counted} {line}"
    return f"{told}; the longest gap, {gap}, is bridged"


def other_unit(latitude: FloatArray, longitude: FloatArray) -> str:
    """The end of a message about angles that are too large for degrees: what they may be in."""
    largest = max(float(np.max(np.abs(latitude))), float(np.max(np.abs(longitude))) / 2.0)
    for factor, unit in (("60", "minutes"), ("1e7", "units of 1e-7 degrees")):
        if largest <= 90.0 * float(factor):
            cure = f"latitude=TITLE/{factor},longitude=TITLE/{factor}"
            return f"; if they are in {unit}, set columns to {cure}"
    return ""
