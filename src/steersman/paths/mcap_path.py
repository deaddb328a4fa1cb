"""Paths from recordings of ROS 2: a line that was driven, or a path that was planned."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import ClassVar

from pydantic import field_validator

from steersman.config import param, register, required
from steersman.errors import DataError
from steersman.kernels.path import PathTable
from steersman.logs.lines import Line, read_line
from steersman.paths.base import PathComponent
from steersman.paths.csv_path import table_through
from steersman.paths.points import Points, checked
from steersman.paths.recorded import first_lap, thinned

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
            # The repeated first point, which tells a lap, need not be a spacing behind the others.
            closed = True
        numbers = line.numbers[rows].tolist()
        place = "message" if line.driven else "pose"
        return checked(Points(self.file, x, y, numbers, bool(closed), place), closed)


def _repeats(line: Line) -> bool:
    """Whether a path ends exactly where it begins."""
    if line.x.size <= 1:
        return False
    return math.hypot(line.x[-1] - line.x[0], line.y[-1] - line.y[0]) < _SAME
