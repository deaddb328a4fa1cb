"""Paths from recordings of ROS 2: a line that was driven, or a path that was planned."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from steersman.config import param, register, required
from steersman.errors import DataError
from steersman.kernels.path import PathTable
from steersman.logs.lines import Line, read_line
from steersman.paths.base import PathComponent
from steersman.paths.csv_path import table_through
from steersman.paths.points import Points, checked
from steersman.types import FloatArray

_SAME = 1e-6


@register("path", "mcap")
class McapPath(PathComponent):
    """A line out of a recording of ROS 2: an MCAP or SQLite file, or the folder of a bag.

    The topic holds Odometry, whose positions are what was driven, or a Path, whose longest message
    counts. A cubic spline goes through the points, as for csv.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mcap", ".db3")

    file: FilePath = required("-", "recording: *.mcap, *.db3, or a folder with metadata.yaml")
    topic: str | None = param(
        None, "-", "of nav_msgs Odometry or Path; null: the only Odometry, else the only Path"
    )
    window: tuple[float, float] | None = param(
        None, "s", "part of the recording, [from, to] since the topic's first message"
    )
    spacing: float = param(
        0.5, "m", "points closer to the last one than this are left out", ge=0.1, le=50.0
    )
    loop: bool | None = param(
        None,
        "-",
        "whether it is a lap; null: if a driven line passes its start again, where it is then cut, "
        "or if a Path's end is near its start",
    )
    smoothing: float = param(
        0.0, "m", "RMS distance that the curve may keep from the points", ge=0.0, le=100.0
    )
    ahead: float = param(
        0.0,
        "m",
        "the path of a point this far ahead of the Odometry's: l_r, if that is the rear axle's",
        ge=-20.0,
        le=20.0,
    )

    @field_validator("window")
    @classmethod
    def _ordered(cls, window: tuple[float, float] | None) -> tuple[float, float] | None:
        if window is not None and not window[0] < window[1]:
            raise ValueError(f"{list(window)} is not allowed; from must be before to [s]")
        return window

    def build_table(self) -> PathTable:
        """Short clothoids through positions and tangents of the spline.

        Raises:
            DataError: the recording cannot be used; one line says where and what to do.
        """
        line = read_line(self.file, self.topic, self.window, self.ahead)
        try:
            return table_through(self._points(line), self.smoothing)
        except DataError as error:
            raise DataError(
                f"{error} (topic {line.topic}; spacing thins out, window takes a part)"
            ) from None

    def _points(self, line: Line) -> Points:
        rows = thinned(line.x, line.y, self.spacing)
        x, y, closed = line.x[rows], line.y[rows], self.loop
        if line.driven and closed is not False:
            lap = first_lap(x, y)
            closed = closed or lap is not None
            if lap is not None:
                x, y, rows = lap.x, lap.y, rows[lap.rows]
        elif not line.driven and closed is not False and _repeats(line):
            # The repeated first point, the sign of a lap, need not be a spacing behind the others.
            closed = True
        numbers = line.numbers[rows].tolist()
        place = "message" if line.driven else "pose"
        return checked(Points(self.file, x, y, numbers, bool(closed), place), closed)


def _repeats(line: Line) -> bool:
    """Whether a path ends exactly where it begins."""
    if line.x.size <= 1:
        return False
    return math.hypot(line.x[-1] - line.x[0], line.y[-1] - line.y[0]) < _SAME


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
