"""From recorded points to those of a curve: thinned, closed, smoothed, checked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.errors import DataError
from steersman.paths import smoothing as spline
from steersman.paths.points import Points, refuse_far
from steersman.paths.told import closing, outlier
from steersman.types import FloatArray

# Points nearer than this share of the usual spacing, or than this [m], are one.
_SAME, _SAME_AT_MOST = 0.02, 0.05
# Before smoothing, those nearer than this share, or this [m], are one: a car that stands jitters.
_JITTER, _JITTER_AT_MOST = 0.5, 0.5
_LEAST_POINTS, _LEAST_CLOSED = 2, 3
# A vertex that turns by more goes back where it came from.
_BACK = math.radians(135.0)
# Closing a lap whose end runs past its start makes two opposite turns of more than this.
_KINK = math.radians(60.0)
_NEAR_JOINT = 10
# A lap is over where the line passes its start this near [m], in about the same direction [rad].
_NEAR, _NEAR_SHARE = 3.0, 0.1
_ALIGNED = math.cos(math.radians(45.0))
# Before that it must have been so many times farther away.
_AWAY = 4.0
_ROUNDING = 1.0 - 1e-9
_HALF = 0.5


class Cleaning(NamedTuple):
    """How recorded points are made a course."""

    loop: bool | None = None
    """Whether the end joins the start; None: where it comes near, or passes it."""
    spacing: float = 0.0
    """Points closer to the last one than this are left out [m]."""
    smoothing: float | None = 0.0
    """RMS distance of the curve from the points [m]; None: chosen from their noise."""


def cleaned(points: Points, by: Cleaning) -> Points:
    """The points that a curve goes through, in the order of driving.

    Repeated points and those within the spacing are left out; a line that passes its start again is
    cut there; then it is closed or left open, smoothed, and checked.

    Args:
        points: as they were recorded.
        by: how.

    Raises:
        DataError: there are too few, or their course cannot be used.
    """
    found, _ = _made(points, by)
    fault = _course_fault(found)
    if fault is None:
        return found
    raise found.fault(fault.row, f"{fault.text}; {', or '.join((*_cures(points, by), fault.cure))}")


def _cures(points: Points, by: Cleaning) -> Iterator[str]:
    """The settings with which the course of these points has no fault."""
    noise = _noise(points, by._replace(smoothing=None))
    if by.smoothing == 0.0 and noise is not None:
        yield f"set smoothing to auto, which takes it for {noise:.2g} m of noise"
    if by.loop is None and _noise(points, by._replace(loop=False)) is not None:
        yield "set loop to false"


def _noise(points: Points, by: Cleaning) -> float | None:
    """What smoothing takes from points [m]; None if their course then has a fault."""
    try:
        found, noise = _made(points, by)
    except DataError:
        return None
    return noise if _course_fault(found) is None else None


def _made(points: Points, by: Cleaning) -> tuple[Points, float]:
    """The points of the curve before they are checked, and their noise, where smoothed [m]."""
    _enough(points)
    refuse_far(points)
    points = _apart(points, by)
    loop = points.closed if by.loop is None else by.loop
    if by.loop is not False:
        points = _joined(points, _SAME_AT_MOST)
        lap = first_lap(points.x, points.y)
        if lap is not None:
            loop, points = True, _cut(points, lap)
    closed = _ends_meet(points) if loop is None else loop
    points = points._replace(closed=closed)
    if closed:
        points = _joined(points)
        if (gap := closing(points.place)) and by.loop:
            ends = f"from {points.counted} {points.lines[-1]} to {points.lines[0]}"
            points = points.noted(f"closed over a gap of {gap:.3g} m, {ends} (loop: true)")
    return _smoothed(points, by) if by.smoothing != 0.0 else (points, 0.0)


def _enough(points: Points) -> None:
    if len(points.x) < _LEAST_POINTS:
        raise points.error(f"holds {len(points.x)} points, a path needs at least {_LEAST_POINTS}")


def _apart(points: Points, by: Cleaning) -> Points:
    """Points that are all some way from the last one; before smoothing, means of near ones."""
    gaps = spline.chords(points.place, closed=False)
    usual = float(np.median(gaps[gaps > 0.0])) if gaps.any() else 0.0
    near = max(by.spacing, min(_SAME * usual, _SAME_AT_MOST), 1e-6)
    rows = thinned(points.x, points.y, near)
    left = len(points.x) - len(rows)
    if left and by.spacing == 0.0:
        first = int(np.argmin(np.append(rows, -1) == np.arange(len(rows) + 1)))
        many = f"{left} points" if left > 1 else "a point"
        where = f"{points.counted} {points.lines[first]}"
        points = points.noted(f"{many} within {near:.2g} m of the last one left out, from {where}")
    points = points.rows(rows)
    _enough(points)
    return points if by.smoothing == 0.0 else _merged(points)


def _merged(points: Points) -> Points:
    """The means of points that noise puts in disorder, or that a standing car left."""
    usual = float(np.median(spline.chords(points.place, closed=False)))
    groups = spline.merged(points.place, min(_JITTER * usual, _JITTER_AT_MOST))
    _, firsts = np.unique(groups, return_index=True)
    if len(firsts) == len(groups):
        return points
    found = points.moved(spline.means(points.place, groups), firsts)
    if points.speed is not None:
        found = found._replace(speed=spline.means(points.speed, groups))
    return found.noted(f"{len(groups)} points merged into {len(firsts)}")


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


class Lap(NamedTuple):
    """A lap cut out of a line; its end is where it passed its start."""

    x: FloatArray
    y: FloatArray
    rows: NDArray[np.int64]
    """Of the line that it was cut from."""


def first_lap(x: FloatArray, y: FloatArray) -> Lap | None:
    """The line until it passes its start again; None if it does not.

    The end is the line's closest point to the start. That gap is spread evenly over the lap, so
    that the lap closes without a kink.
    """
    place = np.column_stack((x, y))
    near = min(_NEAR, _NEAR_SHARE * float(np.max(np.ptp(place, axis=0))))
    left = np.flatnonzero(np.hypot(*(place - place[:1]).T) > _AWAY * near)
    if not left.size:
        return None
    chord = np.diff(place, axis=0)
    size = np.hypot(*chord.T)
    along = (chord @ chord[0]) / (size * size[0])
    share = np.einsum("ij,ij->i", place[0] - place[:-1], chord) / size**2
    feet = place[:-1] + np.clip(share, 0.0, 1.0)[:, None] * chord
    gap = np.hypot(*(feet - place[0]).T)
    passes = (gap <= near) & (along >= _ALIGNED)
    passes[: left[0]] = False
    if not passes.any():
        return None
    begin = int(np.argmax(passes))
    stretch = passes[begin:]
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


def _cut(points: Points, lap: Lap) -> Points:
    """The lap, with a note if it is more than a last point that repeats the first."""
    left = len(points.x) - len(lap.x)
    gap = math.dist((points.x[-1], points.y[-1]), (points.x[0], points.y[0]))
    found = points.moved(np.column_stack((lap.x, lap.y)), lap.rows)
    if left <= 1 and gap < _SAME_AT_MOST:
        return found
    where = f"{points.counted} {points.lines[lap.rows[-1]]}"
    return found.noted(f"it passes its start again after {where} and is cut there (loop: false)")


def _ends_meet(points: Points) -> bool:
    """Whether the end is near the start: by twice the usual spacing, a tenth of the length."""
    steps = spline.chords(points.place, closed=False)
    near = min(2.0 * float(np.median(steps)), 0.1 * float(np.sum(steps)))
    return math.dist((points.x[-1], points.y[-1]), (points.x[0], points.y[0])) <= near


def _joined(points: Points, near: float = math.inf) -> Points:
    """A line without last points that (almost) repeat the first: by half the usual spacing."""
    place = points.place
    near = min(near, _HALF * float(np.median(spline.chords(place, closed=False))))
    count = len(place)
    while count > 1 and math.dist(place[count - 1], place[0]) < near:
        count -= 1
    if count < _LEAST_CLOSED and (points.closed or count < len(place)):
        raise points.error(f"a closed path needs at least {_LEAST_CLOSED} different points")
    return points.rows(np.arange(count))


def _smoothed(points: Points, by: Cleaning) -> tuple[Points, float]:
    """The points moved onto a smoothing spline, and their RMS distance from it [m]."""
    if by.smoothing is None and len(points.x) < spline.LEAST:
        return points.noted(f"{len(points.x)} points show no noise: not smoothed"), 0.0
    try:
        found = spline.smoothed(points.place, bool(points.closed), by.smoothing)
    except DataError as error:
        raise points.error(str(error)) from None
    points = points.moved(found.place, np.arange(len(points.x)))
    return points.noted(f"smoothed: {found.noise:.2g} m of noise (RMS)"), found.noise


class _Fault(NamedTuple):
    """What is wrong with a course."""

    row: int
    text: str
    cure: str


def _course_fault(points: Points) -> _Fault | None:
    """Where a course turns back, or its ends do not join; None for a good one."""
    dx, dy = np.diff(points.place, axis=0, append=points.place[:1]).T
    if not points.closed:
        dx, dy = dx[:-1], dy[:-1]
    # Turning at the end of each chord; a closed path's last is the turn at its first point.
    ahead, before = slice(1, None), slice(None, -1)
    if points.closed:
        dx, dy = np.append(dx, dx[0]), np.append(dy, dy[0])
    cross = dx[before] * dy[ahead] - dy[before] * dx[ahead]
    turn = np.arctan2(cross, dx[before] * dx[ahead] + dy[before] * dy[ahead])
    if points.closed and not _joins(points, float(turn[-2]), float(turn[-1])):
        text = f"the end overlaps or crosses the start ({points.counted} {points.lines[0]})"
        return _Fault(-1, text, "cut the surplus points off")
    back = np.flatnonzero(np.abs(turn) > _BACK)
    if back.size and (alone := outlier(points.place)) is not None:
        return _Fault(alone[0], f"the point is {alone[1]:.2g} m beside its neighbours", "delete it")
    text, cure = "the path turns back on itself", "put the points into driving order"
    return _Fault(int(back[0]) + 1, text, cure) if back.size else None


def _joins(points: Points, turn_last: float, turn_first: float) -> bool:
    """Whether the chord that closes the path leads on, and the ends do not cross."""
    turns_back = max(abs(turn_last), abs(turn_first)) > _BACK
    kink = turn_last * turn_first < 0.0 and min(abs(turn_last), abs(turn_first)) > _KINK
    return not (turns_back or kink or _ends_cross(points))


def _ends_cross(points: Points) -> bool:
    """Whether chords near the end, the closing one included, cross chords near the start."""
    count = len(points.x)
    some = min(_NEAR_JOINT, count // 4)
    place = points.place
    near = ((i, j) for i in range(count - some, count) for j in range(some))
    pairs = ((i, j) for i, j in near if (j - i) % count > 1)  # neighbours share a point
    return any(_cross(place[i], place[(i + 1) % count], place[j], place[j + 1]) for i, j in pairs)


def _cross(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    """Whether the lines a-b and c-d cross between their ends."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0
