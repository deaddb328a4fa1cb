"""The points of a path, from a CSV file or elsewhere; what cannot be driven is refused."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.errors import DataError
from steersman.tables import Sheet, read_sheet
from steersman.types import FloatArray

_CURE = "give a CSV file whose header names the columns x,y or x_m,y_m"
# Columns of speed and their units [m/s]: of TUM's race lines, F1TENTH's waypoints, Autoware's
# trajectories and others.
SPEEDS = {
    **dict.fromkeys(
        ("vx_mps", "v_mps", "vx", "v_x", "v", "speed", "speed_mps", "speed_m_s", "velocity"), 1.0
    ),
    **dict.fromkeys(("velocity_mps", "longitudinal_velocity_mps"), 1.0),
    **dict.fromkeys(("speed_km_h", "speed_kmh", "v_kmh"), 1.0 / 3.6),
}
_MOST_BYTES = 50_000_000
_FARTHEST = 1e8
_DUPLICATE = 1e-6
# So much closer than the median, two points would make the spline bulge.
_ALMOST = 1e-3
_LEAST_POINTS = 3
# A vertex that turns by more goes back where it came from.
_BACK = math.radians(135.0)
# Closing a lap whose end runs past its start makes two opposite turns of more than this.
_KINK = math.radians(60.0)
_NEAR_JOINT = 10


class Points(NamedTuple):
    """Points of a path and where they stand in their file."""

    file: FilePath
    x: FloatArray
    y: FloatArray
    lines: list[int]
    closed: bool
    place: str = "line"
    """What ``lines`` count."""
    speed: FloatArray | None = None
    """Speed at each point [m/s]; None: it is not known, or was not read."""

    def fault(self, row: int, text: str) -> DataError:
        """The error to raise about the point ``row``."""
        return DataError(f"{self.file}, {self.place} {self.lines[row % len(self.lines)]}: {text}")


def read_points(file: FilePath, closed: bool | None = None, *, speeds: bool = False) -> Points:
    """The points of a file; a closed path's last point is dropped if it repeats the first.

    Without ``closed`` the path is closed if its end comes near its start: within twice the
    median spacing, and a tenth of the length.

    With ``speeds`` a column of speeds is read, too, if there is one.

    Raises:
        DataError: the file or the course of its points cannot be used; one line says where and
            what to do.
    """
    sheet = read_sheet(file, _CURE, lambda titles: None not in _titles(titles), _MOST_BYTES)
    titles = _titles(sheet.titles)
    lacking = [name for name, title in zip("xy", titles, strict=True) if title is None]
    if lacking:
        found = ", ".join(sheet.titles)[:60]
        raise sheet.fault(
            sheet.title_line, f"no column {' and '.join(lacking)} in {found!r}; {_CURE}"
        )
    x, y = (sheet.numbers(title) for title in titles if title is not None)
    points = Points(file, x, y, sheet.lines, closed is not False)
    if speeds:
        points = points._replace(speed=_speeds(sheet))
    far = np.flatnonzero(np.maximum(np.abs(x), np.abs(y)) > _FARTHEST)
    if far.size:
        row = int(far[0])
        raise points.fault(row, f"({x[row]:g}, {y[row]:g}) is too far; positions are in metres")
    return checked(points, closed)


def _titles(titles: list[str]) -> list[str | None]:
    """The titles of the columns x and y; None where there is none."""
    known = {title.lower(): title for title in reversed(titles)}
    return [known.get(name, known.get(f"{name}_m")) for name in "xy"]


def _speeds(sheet: Sheet) -> FloatArray | None:
    """The column of speeds [m/s], if there is one."""
    known = {title.lower(): title for title in reversed(sheet.titles)}
    name = next((name for name in SPEEDS if name in known), None)
    if name is None:
        return None
    speed = sheet.numbers(known[name]) * SPEEDS[name]
    back = np.flatnonzero(speed < 0.0)
    if back.size:
        raise sheet.fault(sheet.lines[int(back[0])], f"{known[name]} must not be negative")
    return speed


def checked(points: Points, closed: bool | None) -> Points:
    """Points that can be driven, without a last one that repeats the first of a closed path.

    Raises:
        DataError: there are too few, or their course cannot be used.
    """
    file, x, y, lines = points[:4]
    if len(x) < _LEAST_POINTS:
        raise DataError(f"{file}: holds {len(x)} points, a path needs at least {_LEAST_POINTS}")
    points = points._replace(closed=_ends_meet(points) if closed is None else closed)
    if points.closed and math.dist((x[0], y[0]), (x[-1], y[-1])) < _DUPLICATE:
        speed = None if points.speed is None else points.speed[:-1]
        points = points._replace(x=points.x[:-1], y=points.y[:-1], lines=lines[:-1], speed=speed)
        if len(lines) - 1 < _LEAST_POINTS:
            raise DataError(
                f"{file}: a closed path needs at least {_LEAST_POINTS} different points"
            )
    _check_course(points)
    return points


def _ends_meet(points: Points) -> bool:
    x, y = points.x, points.y
    steps = np.hypot(np.diff(x), np.diff(y))
    near = min(2.0 * float(np.median(steps)), 0.1 * float(np.sum(steps)))
    if math.hypot(x[-1] - x[0], y[-1] - y[0]) <= near:
        return True
    # The end of a lap that was recorded too long passes the start in the same direction.
    half = len(x) // 2
    gap = np.hypot(x[half:] - x[0], y[half:] - y[0])
    row = half + int(np.argmin(gap))
    if gap[row - half] <= near and row + 1 < len(x):
        ahead = (x[1] - x[0]) * (x[row + 1] - x[row]) + (y[1] - y[0]) * (y[row + 1] - y[row])
        if ahead > 0.5 * steps[0] * steps[row]:
            raise points.fault(
                row + 1,
                f"the path runs on past its start ({points.place} {points.lines[0]});"
                f" cut the file off here, or set loop to false",
            )
    return False


def _check_course(points: Points) -> None:
    dx, dy = _chords(points)
    size = np.hypot(dx, dy)
    same = np.flatnonzero(size < max(_DUPLICATE, _ALMOST * float(np.median(size))))
    if same.size:
        row = int(same[0])
        raise points.fault(
            row + 1,
            f"repeats (almost) the point of {points.place} {points.lines[row]}; remove one of them",
        )
    # Turning at the end of each chord; a closed path's last is the turn at its first point.
    ahead, before = slice(1, None), slice(None, -1)
    if points.closed:
        dx, dy = np.append(dx, dx[0]), np.append(dy, dy[0])
    cross = dx[before] * dy[ahead] - dy[before] * dx[ahead]
    turn = np.arctan2(cross, dx[before] * dx[ahead] + dy[before] * dy[ahead])
    if points.closed:
        _check_joint(points, float(turn[-2]), float(turn[-1]))
    back = np.flatnonzero(np.abs(turn) > _BACK)
    if back.size:
        raise points.fault(
            int(back[0]) + 1,
            "the path turns back on itself; put the points into driving order",
        )


def _chords(points: Points) -> tuple[FloatArray, FloatArray]:
    x, y = points.x, points.y
    if points.closed:
        x, y = np.append(x, x[0]), np.append(y, y[0])
    return np.diff(x), np.diff(y)


def _check_joint(points: Points, turn_last: float, turn_first: float) -> None:
    """The chord that closes the path must lead on, and the ends must not cross."""
    turns_back = max(abs(turn_last), abs(turn_first)) > _BACK
    kink = turn_last * turn_first < 0.0 and min(abs(turn_last), abs(turn_first)) > _KINK
    if turns_back or kink or _ends_cross(points):
        raise points.fault(
            -1,
            f"the end overlaps or crosses the start ({points.place} {points.lines[0]});"
            f" cut the surplus points off, or set loop to false",
        )


def _ends_cross(points: Points) -> bool:
    """Whether chords near the end, the closing one included, cross chords near the start."""
    count = len(points.x)
    some = min(_NEAR_JOINT, count // 4)
    place = np.column_stack((points.x, points.y))
    for i in range(count - some, count):
        for j in range(some):
            # Neighbours share a point and do not cross.
            if (j - i) % count > 1 and _cross(
                place[i], place[(i + 1) % count], place[j], place[j + 1]
            ):
                return True
    return False


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    """Whether the lines a-b and c-d cross between their ends."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0
