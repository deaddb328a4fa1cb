"""Curves of lanes, one behind the other, as the samples of one smooth path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from steersman.errors import DataError
from steersman.paths.segments import MAX_TURN
from steersman.paths.xodr.lane_line import Curve
from steersman.types import FloatArray

MAX_ASIDE = 0.1
"""A lane whose next one begins further to the side [m] does not go on there: it ends or merges."""
MAX_AHEAD = 0.5
"""... or further ahead or behind [m]."""
MAX_KINK = 0.2
"""... or in a direction that differs by more [rad]."""
ROUNDED = 0.03
"""A kink of more than this [rad] is rounded by an arc ..."""
TOLERANCE = 0.1
"""... that passes its corner at no more than this distance [m]."""
# Shorter curves only repeat what their neighbours say, with more rounding [m].
_SHORTEST = 0.02
# Samples are at least so far apart [m]: closer, rounded figures would pass for bends.
_CLOSEST = 0.05
# A step to the side is spread over both lanes so that it bends them by no more than this [1/m],
# within these distances [m].
_EASE_BEND, _EASE_LEAST, _EASE_MOST = 0.005, 1.0, 10.0
_EXACT = 1e-6
# A kink of more [rad] cannot stay one; samples of a rounded one, as shares of its arc's half.
_SHARP = 0.1
_MARKS = (-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0)
# Pieces beside a step are at most so long [m], and bend less than this share of what is allowed.
_BRIDGED, _CALM = 1.0, 0.8


class Gap(NamedTuple):
    """How one curve's beginning lies seen from another's end."""

    ahead: float
    aside: float
    """Left positive [m]."""
    kink: float
    """Change of direction [rad]."""

    def __str__(self) -> str:
        """One line about a joint that is none."""
        return (
            f"the next piece begins {self.ahead:z.2f} m ahead, {self.aside:z.2f} m to the left,"
            f" turned by {self.kink:z.2f} rad; the map does not join here"
        )

    @property
    def passable(self) -> bool:
        """Whether it is small enough to be driven as a joint."""
        return (
            abs(self.ahead) <= MAX_AHEAD
            and abs(self.aside) <= MAX_ASIDE
            and abs(self.kink) <= MAX_KINK
        )


def gap(a: Curve, b: Curve) -> Gap:
    """The gap between the end of ``a`` and the beginning of ``b``."""
    dx, dy, psi = b.x[0] - a.x[-1], b.y[0] - a.y[-1], a.psi[-1]
    c, s = math.cos(psi), math.sin(psi)
    kink = math.remainder(float(b.psi[0] - psi), math.tau)
    return Gap(float(dx * c + dy * s), float(dy * c - dx * s), kink)


def joined(curves: Sequence[Curve], closed: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions and directions along all curves, as ``segments.from_samples`` takes them.

    Where two curves meet but for a little, the path goes through the middle of both ends, in
    the mean direction; a step to the side is eased into both lanes.

    Raises:
        DataError: neighbouring curves do not meet.
    """
    rows = [curve for curve in curves if curve.length > _EXACT]
    # An open path begins and ends where its first and last curve do, however short they are.
    ends = (0, len(rows) - 1) if not closed else ()
    rows = [row for i, row in enumerate(rows) if row.length > _SHORTEST or i in ends]
    if sum(row.length for row in rows) < _SHORTEST:
        raise DataError("the path is shorter than 2 cm")
    pairs = [(i, (i + 1) % len(rows)) for i in range(len(rows) - (not closed))]
    gaps = [gap(rows[i], rows[j]) for i, j in pairs]
    for found, row in zip(gaps, rows, strict=False):
        if not found.passable:
            raise DataError(f"s = {row.s[-1]:.1f} m: {found}")
    kinks = {i: found.kink for i, found in enumerate(gaps) if abs(found.kink) > ROUNDED}
    if kinks:
        rows = _met(rows, {pairs[i]: gaps[i] for i in kinks})
        gaps = [gap(rows[i], rows[j]) for i, j in pairs]
        rows = _rounded(rows, kinks, closed)
    steps = {i: found.aside for i, found in enumerate(gaps) if abs(found.aside) > _EXACT}
    return _calmed(*_thinned(*_nodes(_eased(rows, steps, closed) if steps else rows, closed)))


def _met(rows: list[Curve], gaps: dict[tuple[int, int], Gap]) -> list[Curve]:
    """The rows cut or drawn out to where their tangents cross.

    Beside a reference line with a kink, lanes overlap inside of the bend and gape outside.
    """
    starts, ends = dict[int, float](), dict[int, float]()
    for (i, j), found in gaps.items():
        cut = -found.aside / math.sin(found.kink)
        drawn = found.ahead + cut * math.cos(found.kink)
        short = min(0.5 * rows[i].length, 0.5 * rows[j].length, MAX_AHEAD)
        if abs(cut) <= short and abs(drawn) <= short:
            starts[j], ends[i] = cut, drawn
    out = []
    for i, row in enumerate(rows):
        run = np.concatenate(([0.0], np.cumsum(row.steps)))
        first, last = starts.get(i, 0.0), run[-1] + ends.get(i, 0.0)
        inner = run[(run > first + _EXACT) & (run < last - _EXACT)]
        out.append(_sampled(row, run, np.concatenate(([first], inner, [last]))))
    return out


def _sampled(row: Curve, run: FloatArray, new: FloatArray) -> Curve:
    """The row, with its samples at ``run``, sampled at ``new`` [m] by cubics between them."""
    from scipy.interpolate import CubicHermiteSpline  # it takes a while to import

    x = CubicHermiteSpline(run, row.x, np.cos(row.psi))(new)
    y = CubicHermiteSpline(run, row.y, np.sin(row.psi))(new)
    return Curve(x, y, np.interp(new, run, row.psi), np.interp(new, run, row.s))


def _rounded(rows: list[Curve], kinks: dict[int, float], closed: bool) -> list[Curve]:
    """The rows with an arc in place of each kink between row i and the next.

    Seen from the corner in its mean direction, both rows lie at kink / 2 |u|; over the last w
    before and after it they are moved to kink (u^2 + w^2) / (4 w), which has the curvature
    kink / (2 w) and passes the corner at kink w / 4.
    """
    ends = np.cumsum([row.length for row in rows])
    total = float(ends[-1])
    corners = ends[list(kinks)]
    widths = [
        max(min(4.0 * TOLERANCE / abs(kink), _room(corner, corners, total, closed)), _EXACT)
        for corner, kink in zip(corners, kinks.values(), strict=True)
    ]
    for (i, kink), wide in zip(kinks.items(), widths, strict=True):
        if wide < _CLOSEST and abs(kink) > _SHARP:
            raise DataError(
                f"s = {rows[i].s[-1]:.1f} m: a kink of {kink:.2f} rad has no room to be rounded,"
                f" {wide:.2f} m; mend the map there, or take another lane"
            )
    marks = np.add.outer(_MARKS, np.zeros(len(widths))) * widths + corners
    marks = np.sort((marks % total if closed else marks).ravel())
    out = []
    for coarse, end in zip(rows, ends, strict=True):
        row = _refined(coarse, marks - (end - coarse.length))
        run = np.concatenate(([0.0], np.cumsum(row.steps)))
        # A row's ends belong to its own side of a corner.
        run = end - coarse.length + np.clip(run, _EXACT, coarse.length - _EXACT)
        shift, slope = np.zeros_like(run), np.zeros_like(run)
        for corner, wide, kink in zip(corners, widths, kinks.values(), strict=True):
            away = run - corner
            away = away - total * np.round(away / total) if closed else away
            inside = np.clip(wide - np.abs(away), 0.0, None)
            shift += kink / (4.0 * wide) * inside**2
            slope -= kink / (2.0 * wide) * inside * np.sign(away)
        x = row.x - shift * np.sin(row.psi)
        y = row.y + shift * np.cos(row.psi)
        out.append(Curve(x, y, row.psi + np.arctan(slope), row.s))
    return out


def _room(corner: float, corners: FloatArray, total: float, closed: bool) -> float:
    """How far an arc may reach: half the way to the next corner, or to the path's end [m]."""
    away = np.abs(corners - corner)
    if closed:
        away = np.minimum(away, total - away)
    others = 0.5 * away[away > 0.0]
    end = 0.5 * total if closed else min(corner, total - corner)
    return float(np.min(others, initial=end))


def _refined(row: Curve, marks: FloatArray) -> Curve:
    """The row with samples at these distances from its beginning as well, by cubics."""
    run = np.concatenate(([0.0], np.cumsum(row.steps)))
    inside = marks[(marks > _CLOSEST) & (marks < run[-1] - _CLOSEST)]
    far = np.abs(inside[:, None] - run).min(axis=1, initial=np.inf) > _EXACT
    return _sampled(row, run, np.sort(np.concatenate((run, inside[far]))))


def _eased(rows: list[Curve], steps: dict[int, float], closed: bool) -> list[Curve]:
    """The rows with each step to the left after row i spread over both sides of it.

    Over the distance 2 w the step is made as 3 z^2 - 2 z^3 with z from 0 to 1, which bends the
    rows by at most 6 step / (2 w)^2.
    """
    ends = np.cumsum([row.length for row in rows])
    total = float(ends[-1])
    out = []
    for row, end in zip(rows, ends, strict=True):
        run = end - row.length + np.concatenate(([0.0], np.cumsum(row.steps)))
        # A row's ends belong to its own side of a step.
        run = np.clip(run, run[0] + _EXACT, run[-1] - _EXACT)
        shift, slope = np.zeros_like(run), np.zeros_like(run)
        for i, step in steps.items():
            away = run - ends[i]
            room = max(min(ends[i], total - ends[i]), _CLOSEST)
            if closed:  # the beginning is ahead of the end
                away, room = away - total * np.round(away / total), total / 2.0
            wide = math.sqrt(1.5 * abs(step) / _EASE_BEND)
            wide = min(max(wide, _EASE_LEAST), _EASE_MOST, room)
            z = np.clip(0.5 + 0.5 * away / wide, 0.0, 1.0)
            shift += step * (z * z * (3.0 - 2.0 * z) - (away > 0.0))
            slope += step * 3.0 * z * (1.0 - z) / wide
        x = row.x - shift * np.sin(row.psi)
        y = row.y + shift * np.cos(row.psi)
        out.append(Curve(x, y, row.psi + np.arctan(slope), row.s))
    return out


def _nodes(rows: list[Curve], closed: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """All samples, those of two ends that meet as one between them."""
    x, y, psi = rows[0][:3]
    for row in rows[1:]:
        between = _between((x[-1], y[-1], psi[-1]), (row.x[0], row.y[0], row.psi[0]))
        columns = zip((x, y, psi), between, row[:3], strict=True)
        x, y, psi = (np.concatenate((a[:-1], [m], b[1:])) for a, m, b in columns)
    if closed:
        x, y, psi = x.copy(), y.copy(), psi.copy()
        middle = _between((x[-1], y[-1], psi[-1]), (x[0], y[0], psi[0]))
        for column, value in zip((x, y, psi), middle, strict=True):
            column[0] = column[-1] = value
    return x, y, psi


def _between(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    turn = math.remainder(b[2] - a[2], math.tau)
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), a[2] + 0.5 * turn


def _thinned(
    x: FloatArray, y: FloatArray, psi: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Without samples that come too close after another; the ends stay."""
    kept = [0]
    for i in range(1, len(x) - 1):
        last = kept[-1]
        ahead = (x[i] - x[last]) * math.cos(psi[last]) + (y[i] - y[last]) * math.sin(psi[last])
        if ahead >= _CLOSEST:
            kept.append(i)
    end = len(x) - 1
    if len(kept) > 1 and math.hypot(x[end] - x[kept[-1]], y[end] - y[kept[-1]]) < _CLOSEST:
        kept.pop()
    kept.append(end)
    return x[kept], y[kept], psi[kept]


def _calmed(
    x: FloatArray, y: FloatArray, psi: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Without samples beside what is left of a step, where a piece would bend to and fro too much.

    Where each metre of a map has its kink, steps of millimetres stay: longer pieces bridge them.
    """
    limit, columns = MAX_TURN, (x, y, psi)
    while True:
        bends = _bends(*columns)
        worst, end = int(np.argmax(bends)), len(bends)
        if bends[worst] <= limit:
            return columns
        found = []
        for i in {worst, worst + 1} - {0, end}:
            x, y, psi = (np.delete(column, i) for column in columns)
            chord = math.hypot(x[i] - x[i - 1], y[i] - y[i - 1])
            if chord <= _BRIDGED and (bend := _bends(x, y, psi)[i - 1]) < bends[worst]:
                found.append((bend, (x, y, psi)))
        if not found:
            return columns
        limit, columns = _CALM * MAX_TURN, min(found, key=lambda each: each[0])[1]


def _bends(x: FloatArray, y: FloatArray, psi: FloatArray) -> FloatArray:
    """By how much each piece turns at most, to first order, as a clothoid between its samples."""
    turn = np.diff(np.unwrap(psi))
    left = np.unwrap(psi)[:-1] - np.arctan2(np.diff(y), np.diff(x))
    left -= math.tau * np.round(left / math.tau)
    return np.asarray(np.abs(turn) + np.abs(3.0 * (2.0 * left + turn)))
