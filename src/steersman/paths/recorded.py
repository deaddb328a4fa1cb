"""A line as a car drove it, made fit to be followed: thinned out, and closed where it is a lap."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.types import FloatArray

# A lap is over where the line passes its start this near [m], in about the same direction [rad].
_NEAR = 3.0
_ALIGNED = math.cos(math.radians(45.0))
# Before that it must have been so far away [m].
_AWAY = 4.0 * _NEAR
_ROUNDING = 1.0 - 1e-9
_HALF = 0.5


class Lap(NamedTuple):
    """A lap cut out of a line; its end is where it passed its start."""

    x: FloatArray
    y: FloatArray
    rows: NDArray[np.int64]
    """Of the line that it was cut from."""


def thinned(x: FloatArray, y: FloatArray, spacing: float) -> NDArray[np.int64]:
    """Rows of points that are at least ``spacing`` [m] apart, from the first on.

    A car that stands leaves one point, however its position jitters.
    """
    points = list(zip(x.tolist(), y.tolist(), strict=True))
    rows = [0] if points else []
    for row, point in enumerate(points):
        if math.dist(point, points[rows[-1]]) >= spacing * _ROUNDING:
            rows.append(row)
    return np.array(rows, dtype=np.int64)


def first_lap(x: FloatArray, y: FloatArray) -> Lap | None:
    """The line until it passes its start again; None if it does not.

    The end is the line's closest point to the start. That gap is spread evenly over the lap, so
    that the lap closes without a kink.
    """
    place = np.column_stack((x, y))
    left = np.flatnonzero(np.hypot(*(place - place[:1]).T) > _AWAY)
    if not left.size:
        return None
    chord = np.diff(place, axis=0)
    size = np.hypot(*chord.T)
    along = (chord @ chord[0]) / (size * size[0])
    share = np.einsum("ij,ij->i", place[0] - place[:-1], chord) / size**2
    feet = place[:-1] + np.clip(share, 0.0, 1.0)[:, None] * chord
    gap = np.hypot(*(feet - place[0]).T)
    near = (gap <= _NEAR) & (along >= _ALIGNED)
    near[: left[0]] = False
    if not near.any():
        return None
    begin = int(np.argmax(near))
    stretch = near[begin:]
    until = len(stretch) if stretch.all() else int(np.argmin(stretch))
    last = begin + int(np.argmin(gap[begin : begin + until]))
    if last == len(chord) - 1 and share[last] >= 1.0:
        return None  # it ends before it gets there
    keep = last + 1 if share[last] > _HALF else last  # not almost the same point twice
    return _closed(place[:keep], feet[last], size)


def _closed(place: FloatArray, end: FloatArray, size: FloatArray) -> Lap:
    """The points up to ``end``, shifted so that the end falls onto the start."""
    driven = np.concatenate(([0.0], np.cumsum(size[: len(place) - 1])))
    length = driven[-1] + math.dist(place[-1], end)
    shifted = place + np.outer(driven / length, place[0] - end)
    return Lap(shifted[:, 0].copy(), shifted[:, 1].copy(), np.arange(len(place)))
