"""Paths from recordings of ROS 2: a line that was driven, or a path that was planned."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import ClassVar

from steersman.config import param, register, required
from steersman.logs.lines import read_line
from steersman.paths.point_path import RecordedPath
from steersman.paths.points import Points

_SAME = 1e-6


@register("path", "mcap")
class McapPath(RecordedPath):
    """A line out of a recording of ROS 2: an MCAP or SQLite file, or the folder of a bag.

    The topic holds Odometry or poses, whose positions are what was driven, or a Path or Autoware's
    Trajectory, whose longest message counts. A cubic spline goes through the points, as for csv.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mcap", ".db3")

    file: FilePath = required("-", "recording: *.mcap, *.db3, or a folder with metadata.yaml")
    topic: str | None = param(
        None,
        "-",
        "what to follow; null: the only Odometry, else the only Path, else the poses",
    )
    spacing: float = param(
        0.5, "m", "points closer to the last one than this are left out", ge=0.1, le=50.0
    )
    ahead: float = param(
        0.0,
        "m",
        "the path of a point this far ahead of the Odometry's: l_r, if that is the rear axle's",
        ge=-20.0,
        le=20.0,
    )

    def recorded(self, *, speeds: bool = False) -> Points:
        """The positions of the topic."""
        line = read_line(self.file, self.topic, self.window, self.ahead)
        # A driven line is a lap where it passes its start; one that ends near it may just stop
        # there. The repeated first point of a Path is the sign of a lap.
        ends = math.dist((line.x[0], line.y[0]), (line.x[-1], line.y[-1])) if line.x.size else 0.0
        closed = False if line.driven else (ends < _SAME or None)
        counted = "message" if line.driven else "pose"
        points = Points(self.file, line.x, line.y, line.numbers.tolist(), closed, counted)
        hint = f" (topic {line.topic}; spacing thins out, window takes a part)"
        return points._replace(hint=hint)
