"""The centre line of a lane: a curve at a changing offset from the reference line."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np

from steersman.paths.xodr.model import Cubic, LaneSection, ReferencePiece, RoadRecord
from steersman.paths.xodr.reference import points
from steersman.types import FloatArray

_R = TypeVar("_R", Cubic, ReferencePiece)
# Distance from the reference line, left positive, and its slope, each (n,), at s on the road (n,).
_Offset: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
_HALF = 0.5
# Samples are at most so far apart [m], and the curve turns by at most so much between them [rad].
_STEP, _TURN = 1.0, 0.1
_PROBES = 4
# Most turning of the piece between two records of a road [rad].
_MOST_TURN = 63.0
# How much longer than the road a lane may be: steeper ones come of wrong figures.
_MOST_STRETCH = 20.0
# The narrowest bend of a lane that is not taken for a fault [m].
_LEAST_RADIUS = 0.1


class Curve(NamedTuple):
    """A smooth stretch of a lane's centre, sampled along the road's growing s; each (n,)."""

    x: FloatArray
    y: FloatArray
    psi: FloatArray
    """Direction of the tangent, towards growing s [rad]."""
    s: FloatArray
    """Where on the road [m]."""

    @property
    def steps(self) -> FloatArray:
        """Distances between the samples (n - 1,) [m]."""
        return np.hypot(np.diff(self.x), np.diff(self.y))

    @property
    def length(self) -> float:
        """Their sum [m]."""
        return float(np.sum(self.steps))

    def backward(self) -> Curve:
        """The same, driven towards falling s."""
        return Curve(self.x[::-1], self.y[::-1], self.psi[::-1] + np.pi, self.s[::-1])


def lane_line(road: RoadRecord, section: LaneSection, number: int) -> list[Curve]:
    """The centre of a lane in one section: a curve for each stretch without a break of records.

    Raises:
        DataError: the lane cannot be followed; the message begins with a line of the file.
    """
    marks = _marks(road, section, number)
    return _stretches(
        road, marks, lambda start, middle: _centre(road, section, number, start, middle)
    )


def changing_line(
    road: RoadRecord, section: LaneSection, numbers: tuple[int, int], begin: float, end: float
) -> list[Curve]:
    """From the centre of one lane to that of another, between two places on the road [m].

    The curvature that this adds grows and falls linearly, to either side in turn, as that of four
    clothoids of the same length: at most 8 distance / (end - begin)^2.

    Raises:
        DataError: a lane cannot be followed.
    """
    quarters = np.linspace(begin, end, 5).tolist()
    marks = sorted({*quarters, *(s for number in numbers for s in _marks(road, section, number))})

    def offset(start: float, middle: float) -> _Offset:
        first, second = (_centre(road, section, number, start, middle) for number in numbers)

        def blended(s: FloatArray) -> tuple[FloatArray, FloatArray]:
            (t, slope), (u, other) = first(s), second(s)
            share, growth = _changed((s - begin) / (end - begin))
            growth = growth / (end - begin)
            return t + share * (u - t), slope + share * (other - slope) + growth * (u - t)

        return blended

    return _stretches(road, marks, offset)


def _changed(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of a change that is made after the share ``z`` of its length, and its slope."""
    near = np.clip(np.where(z > _HALF, 1.0 - z, z), 0.0, _HALF)  # the second half mirrors the first
    left = _HALF - near
    early = near < 0.5 * _HALF
    share = np.where(early, 16.0 / 3.0 * near**3, 0.5 - 2.0 * left + 16.0 / 3.0 * left**3)
    slope = np.where(early, 16.0 * near**2, 2.0 - 16.0 * left**2)
    return np.where(z > _HALF, 1.0 - share, share), slope


def _stretches(
    road: RoadRecord, marks: Sequence[float], offset: Callable[[float, float], _Offset]
) -> list[Curve]:
    """A curve between each mark and the next, at the offset that holds there."""
    out = []
    for start, end in itertools.pairwise(marks):
        if end > start:
            middle = 0.5 * (start + end)
            geometry = at_place(road.geometries, middle) or road.geometries[0]
            out.append(_sample(geometry, start, end, offset(start, middle)))
    return out


def _marks(road: RoadRecord, section: LaneSection, number: int) -> list[float]:
    """Where a record begins that bears on the lane, within the section, its ends included."""
    places = {section.start, section.end}
    places.update(geometry.s for geometry in road.geometries)
    places.update(record.s for record in road.offset)
    for inner in _inner(number):
        lane = section.lanes[inner]
        places.update(section.start + record.s for record in (*lane.width, *lane.border))
    return sorted(s for s in places if section.start <= s <= section.end)


def _inner(number: int) -> Iterator[int]:
    """The lanes from the middle to ``number``, itself included."""
    sign = 1 if number > 0 else -1
    return (sign * k for k in range(1, abs(number) + 1))


def at_place(rows: Sequence[_R], s: float) -> _R | None:
    """The last record that begins at or before ``s``; the rows are sorted."""
    return next((row for row in reversed(rows) if row.s <= s), None)


def _centre(
    road: RoadRecord, section: LaneSection, number: int, start: float, middle: float
) -> _Offset:
    """The centre's offset from the reference line in the stretch that begins at ``start``.

    ``middle`` lies within the stretch, and selects the records that hold there.
    """
    shift = np.zeros(4)
    record = at_place(road.offset, middle)
    if record is not None:
        shift += record.moved(start - record.s)
    sign = 1.0 if number > 0 else -1.0
    inside = outside = np.zeros(4)
    for inner in _inner(number):
        lane, inside = section.lanes[inner], outside
        record = at_place(lane.width or lane.border, middle - section.start)
        row = np.zeros(4)
        if record is not None:
            row += record.moved(start - section.start - record.s)
        outside = row if lane.border else inside + sign * row
    a, b, c, d = (float(value) for value in shift + 0.5 * (inside + outside))

    def cubic(s: FloatArray) -> tuple[FloatArray, FloatArray]:
        u = s - start
        return a + u * (b + u * (c + u * d)), b + u * (2.0 * c + 3.0 * d * u)

    return cubic


def _sample(geometry: ReferencePiece, start: float, end: float, offset: _Offset) -> Curve:
    """Samples close enough for short clothoids between them."""
    count = max(int(np.ceil((end - start) / _STEP)), _PROBES)
    curve = _evaluate(geometry, np.linspace(start, end, count + 1), offset)
    turning = float(np.sum(np.abs(np.diff(np.unwrap(curve.psi)))))
    if turning > _MOST_TURN:
        raise geometry.fault(f"a lane turns by {turning:.3g} rad here")
    if curve.length > _MOST_STRETCH * (end - start):
        raise geometry.fault(
            f"a lane is {curve.length:.3g} m long here on {end - start:.3g} m of the road; widths"
            f" and offsets are in metres"
        )
    count = max(int(np.ceil(max(curve.length / _STEP, turning / _TURN))), 1)
    return _evaluate(geometry, np.linspace(start, end, count + 1), offset)


def _evaluate(geometry: ReferencePiece, s: FloatArray, offset: _Offset) -> Curve:
    """Points at the offset t from the reference line, with t' the offset's slope.

    position = r + t n, d/ds position = (1 - kappa t) tangent + t' n.
    """
    t, slope = offset(s)
    line = points(geometry, s - geometry.s)
    ahead = 1.0 - line.kappa * t
    # The radius left of the lane's own arc is ahead / kappa.
    if not bool(np.all(ahead > _LEAST_RADIUS * np.abs(line.kappa))):
        raise geometry.fault(
            f"a lane turns with a radius below {_LEAST_RADIUS} m here: it lies too far inside the"
            f" bend"
        )
    x = line.x - t * np.sin(line.psi)
    y = line.y + t * np.cos(line.psi)
    return Curve(x, y, line.psi + np.arctan2(slope, ahead), s)
