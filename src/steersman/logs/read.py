"""The motion of a car in any ROS 2 recording, as columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.errors import DataError
from steersman.logs import schemas
from steersman.logs.bag import Message, Recording, opened
from steersman.types import FloatArray

# Every column of a log and its unit. The first eight are always there.
COLUMNS: dict[str, str] = {
    "time": "s",
    "x": "m",
    "y": "m",
    "yaw": "rad",
    "v_x": "m/s",
    "v_y": "m/s",
    "speed": "m/s",
    "yaw_rate": "rad/s",
    "angle_command": "rad",
    "angle": "rad",
    "steer_command": "-",
    "steer": "-",
    "throttle": "-",
    "brake": "-",
}
_FARTHEST = 1e8
_UNIT = 0.01
_NS = 1e-9


@dataclass(frozen=True)
class MotionLog:
    """A recorded drive; a row for each Odometry message, in the order of time.

    Attributes:
        columns: float64 arrays of one length by the names of ``COLUMNS``. Always there: ``time``
            since the first row [s], position ``x``, ``y`` [m] and ``yaw`` [rad] (unwrapped) in the
            map's frame, ``v_x``, ``v_y`` [m/s] in the vehicle's, ``speed``, the magnitude of the
            velocity [m/s], and ``yaw_rate`` [rad/s]. If the recording has them:
            ``angle_command``, the wheel angle that was commanded (single-track, left positive)
            [rad]; ``angle``, the measured one [rad]; ``steer_command``, ``steer``, the commanded
            and the actual normalised steering in [-1, 1]; ``throttle``, ``brake`` in [0, 1].
            Commands are held from message to message, as actuators do; measured angles are
            interpolated. NaN before the first command.
        topics: the topic that each group came from: ``odometry``, ``command``, ``angle``,
            ``diagnostics``.
        start: Unix time of the first row [ns].

    The point is the one that the Odometry describes: the centre of mass in our own recordings,
    usually the rear axle in others' (``ahead`` of :func:`read` moves it).
    """

    columns: Mapping[str, FloatArray]
    topics: Mapping[str, str]
    start: int

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self.columns["time"])


class _Series(NamedTuple):
    """Messages of a topic: when each was stamped [ns] and what it says, (n, k)."""

    stamps: NDArray[np.int64]
    values: FloatArray


def read(
    file: FilePath,
    *,
    odometry: str | None = None,
    command: str | None = None,
    angle: str | None = None,
    ahead: float = 0.0,
) -> MotionLog:
    """The columns of a recording: an MCAP or SQLite file, or the folder of a ROS 2 bag.

    Args:
        file: the recording.
        odometry: topic of nav_msgs/msg/Odometry; None: the only one.
        command: topic of autoware_control_msgs/msg/Lateral or .../Control; None: the only one, if
            there is one.
        angle: topic of autoware_vehicle_msgs/msg/SteeringReport; None: likewise. Our own
            diagnostics go first.
        ahead: the rows describe the point this far ahead of the Odometry's [m]: ``l_r`` of the
            vehicle, to go from the rear axle to the centre of mass.

    Raises:
        DataError: the file cannot be read, has no such topic, or holds what no car does.
        ModuleNotFoundError: the extra ``logs`` is not installed.
    """
    with opened(file) as recording:
        topics = _topics(recording, odometry, command, angle)
        return _log(recording, topics, ahead)


def motion(recording: Recording, topic: str, ahead: float = 0.0) -> MotionLog:
    """The columns of a topic of Odometry or poses alone, of an open recording.

    Raises:
        DataError: it holds what no car does.
    """
    return _log(recording, {"odometry": topic}, ahead)


def _log(recording: Recording, topics: Mapping[str, str], ahead: float) -> MotionLog:
    tables = {
        group: recording.messages(topic, _taker(_EXTRACT[group])) for group, topic in topics.items()
    }
    if not tables["odometry"]:
        raise DataError(f"{recording.file}: topic {topics['odometry']} holds no message")
    filled = {group: table for group, table in tables.items() if table}
    stamped = all(row.stamp > 0 for table in filled.values() for row in table)
    series = {group: _series(table, stamped) for group, table in filled.items()}
    driven = series["odometry"]
    _check(recording.file, topics["odometry"], driven)
    columns = _moved(_motion(driven), ahead)
    _add_steering(columns, series)
    return MotionLog(columns, {group: topics[group] for group in filled}, int(driven.stamps[0]))


def _topics(
    recording: Recording, odometry: str | None, command: str | None, angle: str | None
) -> dict[str, str]:
    """The topic of each group of columns that the recording has."""
    commands = (schemas.LATERAL_TYPE, schemas.CONTROL_TYPE)
    found = {
        "odometry": recording.find((schemas.ODOMETRY_TYPE,), odometry),
        "command": recording.find(commands, command, optional=True),
        "diagnostics": recording.find((schemas.DIAGNOSTICS_TYPE,), None, optional=True),
    }
    if found["diagnostics"] is None or angle is not None:
        found["angle"] = recording.find((schemas.STEERING_REPORT_TYPE,), angle, optional=True)
    return {group: topic for group, topic in found.items() if topic is not None}


class _Row(NamedTuple):
    """What is kept of a message."""

    logged: int
    """[ns]"""
    stamp: int
    """[ns]; zero: it has none."""
    values: tuple[float, ...]


def _taker(extract: Callable[[Any], tuple[float, ...]]) -> Callable[[Message], _Row]:
    def take(message: Message) -> _Row:
        content = message.content
        stamp = content.header.stamp if hasattr(content, "header") else content.stamp
        ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
        return _Row(message.logged, ns, extract(content))

    return take


def _series(table: list[_Row], stamped: bool) -> _Series:
    """In the order of time, the first message of each stamp."""
    times = np.array([row.stamp if stamped else row.logged for row in table], dtype=np.int64)
    stamps, first = np.unique(times, return_index=True)
    return _Series(stamps, np.array([row.values for row in table], dtype=np.float64)[first])


def _of_odometry(m: Any) -> tuple[float, ...]:
    """Of Odometry; of a message with a pose alone, at rest."""
    pose = getattr(m.pose, "pose", m.pose)
    p, q = pose.position, pose.orientation
    v = m.twist.twist if hasattr(m, "twist") else None
    rates = (0.0, 0.0, 0.0) if v is None else (v.linear.x, v.linear.y, v.angular.z)
    return p.x, p.y, q.x, q.y, q.z, q.w, *rates


def _of_command(m: Any) -> tuple[float, ...]:
    return (getattr(m, "lateral", m).steering_tire_angle,)


def _of_angle(m: Any) -> tuple[float, ...]:
    return (m.steering_tire_angle,)


_DIAGNOSTICS = ("wheel_angle", "steer_command", "steer", "throttle", "brake")


def _of_diagnostics(m: Any) -> tuple[float, ...]:
    return tuple(getattr(m, name, np.nan) for name in _DIAGNOSTICS)


_EXTRACT: dict[str, Callable[[Any], tuple[float, ...]]] = {
    "odometry": _of_odometry,
    "command": _of_command,
    "angle": _of_angle,
    "diagnostics": _of_diagnostics,
}


def _check(file: FilePath, topic: str, driven: _Series) -> None:
    """Refuse positions and directions that no car has."""
    bad = ~np.all(np.isfinite(driven.values), axis=1)
    bad |= np.any(np.abs(driven.values) > _FARTHEST, axis=1)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise DataError(f"{file}: {topic}: message {row + 1} holds numbers that no car has")
    size = np.sqrt(np.sum(driven.values[:, 2:6] ** 2, axis=1))
    if np.max(np.abs(size - 1.0)) > _UNIT:
        row = int(np.argmax(np.abs(size - 1.0)))
        raise DataError(
            f"{file}: {topic}: message {row + 1} has the orientation {driven.values[row, 2:6]}, "
            "which is no unit quaternion"
        )


def _motion(driven: _Series) -> dict[str, FloatArray]:
    x, y, qx, qy, qz, qw, v_x, v_y, yaw_rate = driven.values.T.copy()
    yaw = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return {
        "time": (driven.stamps - driven.stamps[0]) * _NS,
        "x": x,
        "y": y,
        "yaw": np.unwrap(yaw),
        "v_x": v_x,
        "v_y": v_y,
        "speed": np.hypot(v_x, v_y),
        "yaw_rate": yaw_rate,
    }


def _moved(columns: dict[str, FloatArray], ahead: float) -> dict[str, FloatArray]:
    """The motion of the point ``ahead`` [m] of the one that was recorded."""
    if ahead != 0.0:
        columns["x"] = columns["x"] + ahead * np.cos(columns["yaw"])
        columns["y"] = columns["y"] + ahead * np.sin(columns["yaw"])
        columns["v_y"] = columns["v_y"] + ahead * columns["yaw_rate"]
        columns["speed"] = np.hypot(columns["v_x"], columns["v_y"])
    return columns


def _add_steering(columns: dict[str, FloatArray], series: Mapping[str, _Series]) -> None:
    """Add what else was recorded, at the rows' times."""
    at = series["odometry"].stamps
    if "command" in series:
        columns["angle_command"] = _held(series["command"], at)[:, 0]
    if "diagnostics" in series:
        held = _held(series["diagnostics"], at)
        names = ("angle", *_DIAGNOSTICS[1:])
        columns.update({name: held[:, i].copy() for i, name in enumerate(names)})
    if "angle" in series:
        measured = series["angle"]
        columns["angle"] = np.interp(
            (at - at[0]) * _NS, (measured.stamps - at[0]) * _NS, measured.values[:, 0]
        )


def _held(series: _Series, at: NDArray[np.int64]) -> FloatArray:
    """The last values at each of the times; NaN before the first."""
    last = np.searchsorted(series.stamps, at, side="right") - 1
    out = series.values[np.maximum(last, 0)].copy()
    out[last < 0] = np.nan
    return out
