"""Lines in the plane out of a recording: the driven line, or a planned path."""

from __future__ import annotations

import itertools
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.errors import DataError
from steersman.logs import schemas
from steersman.logs.bag import Message, Recording, opened
from steersman.logs.read import motion
from steersman.types import FloatArray

_NS = 1e-9
_FARTHEST = 1e8
_PLANNED = (schemas.PATH_TYPE, schemas.TRAJECTORY_TYPE)
# Types of lines: where no topic is named, the first of which there is one.
_TYPES = ((schemas.ODOMETRY_TYPE,), _PLANNED, schemas.POSE_TYPES)


class Line(NamedTuple):
    """Points of a line in the order of driving."""

    topic: str
    driven: bool
    """Whether it is a driven line; else it is one message's path."""
    x: FloatArray
    """[m]"""
    y: FloatArray
    """[m]"""
    numbers: NDArray[np.int64]
    """Which row of the Odometry, or which pose of the Path, counted from 1."""


def read_line(
    file: FilePath,
    topic: str | None = None,
    window: tuple[float, float] | None = None,
    ahead: float = 0.0,
) -> Line:
    """A driven line, or the longest message of a Path topic.

    Args:
        file: the recording.
        topic: of Odometry, Path, PoseStamped, PoseWithCovarianceStamped or Autoware's Trajectory;
            None: the only Odometry, if there is none the only Path or Trajectory, else the only
            topic of poses.
        window: part of the recording, from and to [s] since the topic's first message.
        ahead: the line of the point this far ahead of the one that was driven [m].

    Raises:
        DataError: the recording cannot be read, or has no such line.
    """
    with opened(file) as recording:
        given = (recording.find(kinds, optional=True) for kinds in _TYPES if topic is None)
        found = next((name for name in given if name is not None), topic)
        name = recording.find(itertools.chain(*_TYPES), found)
        assert name is not None  # nothing optional was asked for
        if recording.topics[name] in _PLANNED:
            return _planned(recording, name, window)
        return _driven(recording, name, window, ahead)


def _driven(
    recording: Recording, topic: str, window: tuple[float, float] | None, ahead: float
) -> Line:
    log = motion(recording, topic, ahead)
    rows = np.arange(len(log))
    if window is not None:
        rows = rows[(log["time"] >= window[0]) & (log["time"] <= window[1])]
        if not rows.size:
            raise _outside(recording, topic, window, float(log["time"][-1]))
    return Line(topic, True, log["x"][rows], log["y"][rows], rows + 1)


def _planned(recording: Recording, topic: str, window: tuple[float, float] | None) -> Line:
    longest = _Longest(window)
    recording.some(topic, longest)
    path = longest.path
    if path is None:
        assert window is not None  # without a window every message counts
        raise _outside(recording, topic, window, longest.time)
    if path.header.frame_id == schemas.BASE_LINK:
        raise DataError(
            f"{recording.file}: {topic}: its points are in the frame base_link, of the vehicle; "
            "a path to follow has to lie in map"
        )
    return _line(recording, topic, path)


class _Longest:
    """Keeps the longest path within a window alone; all of them would fill memory."""

    def __init__(self, window: tuple[float, float] | None) -> None:
        self._window, self._first = window, -1
        self.time = 0.0
        """Of the last message [s], since the first."""
        self.path: Any = None

    def __call__(self, message: Message) -> None:
        if self._first < 0:
            self._first = message.logged
        self.time = (message.logged - self._first) * _NS
        inside = self._window is None or self._window[0] <= self.time <= self._window[1]
        longer = self.path is None or len(_poses(message.content)) > len(_poses(self.path))
        if inside and longer:
            self.path = message.content


def _poses(path: Any) -> Any:
    """What a Path calls poses and a Trajectory points."""
    return path.poses if hasattr(path, "poses") else path.points


def _line(recording: Recording, topic: str, path: Any) -> Line:
    places = [pose.pose.position for pose in _poses(path)]
    points = np.array([(p.x, p.y) for p in places], dtype=np.float64).reshape(-1, 2)
    bad = np.flatnonzero(~np.all(np.abs(points) <= _FARTHEST, axis=1))
    if bad.size:
        raise DataError(
            f"{recording.file}: {topic}: pose {bad[0] + 1} lies at {points[bad[0]]}; positions are "
            "finite and in metres"
        )
    x, y = points.T
    return Line(topic, False, x.copy(), y.copy(), np.arange(len(points)) + 1)


def _outside(
    recording: Recording, topic: str, window: tuple[float, float], last: float
) -> DataError:
    return DataError(
        f"{recording.file}: {topic}: no message from {window[0]:g} to {window[1]:g} s; the last is "
        f"at {last:.3f} s"
    )
