"""Build path tables: from line, arc and clothoid segments, and from sampled curves.

Every piece of a table is a clothoid (curvature linear in arc length) of at most ``MAX_PIECE``
metres and ``MAX_TURN`` radians, which is what :mod:`steersman.kernels.path` relies on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from steersman.errors import DataError
from steersman.kernels.path import (
    FIRST_CELL,
    FIRST_PIECE,
    KAPPA0,
    S0,
    SHARPNESS,
    X0,
    PathTable,
    at,
)
from steersman.types import FloatArray, Pose

MAX_PIECE = 2.0
"""Longest piece [m]."""
MAX_TURN = 0.25
"""Most turning within a piece [rad]."""
MAX_LENGTH = 1e6
"""Longest path [m]: more is a mistake in the units, and would only fill the memory."""
_CLOSING_DISTANCE = 1e-3
_CLOSING_HEADING = 1e-4
_MAX_PIECES = 2_000_000

# Eight-point Gauss-Legendre nodes and weights on [0, 1]; Abramowitz and Stegun, table 25.4. Over
# a quarter radian the rule is exact to rounding, so errors do not grow along a path.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS
_FIT_STEPS = 6

ORIGIN = Pose(0.0, 0.0, 0.0)


class Segment(NamedTuple):
    """A stretch of path with linear curvature: line, arc or clothoid."""

    length: float
    """Arc length [m]."""
    kappa_start: float
    """Curvature where it begins, left positive [1/m]."""
    kappa_end: float
    """Curvature where it ends [1/m]."""
    name: str = ""


def from_segments(
    segments: Sequence[Segment], *, closed: bool = False, start: Pose = ORIGIN
) -> PathTable:
    """The table of the path that lays ``segments`` one behind the other from ``start``.

    The small closing error of a closed path, which comes from rounded figures, is spread over
    its whole length: the heading's by a constant curvature, the position's by a linear shift.

    Raises:
        DataError: a segment is not usable, or a closed path does not close.
    """
    sizes, kappa, sharpness = _split(segments)
    s0 = np.concatenate(([0.0], np.cumsum(sizes)))
    if closed:
        kappa = kappa - _heading_error(sizes, kappa, sharpness) / s0[-1]
    x, y, psi = _accumulate(sizes, kappa, sharpness, start)
    if closed:
        gap_x, gap_y = x[-1] - start.x, y[-1] - start.y
        gap = math.hypot(gap_x, gap_y)
        if gap > _CLOSING_DISTANCE:
            raise DataError(
                f"the closed path ends {gap:.3g} m away from where it starts;"
                f" mend the segments or make it an open path"
            )
        x, y = x - gap_x * s0 / s0[-1], y - gap_y * s0 / s0[-1]
    return _table(s0, x[:-1], y[:-1], psi[:-1], kappa, sharpness, closed)


def from_samples(x: FloatArray, y: FloatArray, psi: FloatArray, *, closed: bool) -> PathTable:
    """The table of the curve through sampled positions with given tangent directions.

    Between neighbouring samples lies the one clothoid that meets both positions and both
    directions (Bertolazzi and Frego, "G1 fitting with clothoids", Math. Meth. Appl. Sci. 38,
    2015), so joints are exact in position and direction. The curvature jumps there by the order
    of its second derivative times the squared spacing. The last sample of a closed path repeats
    the first; ``psi`` is unwrapped here.

    Raises:
        DataError: neighbouring samples are too far apart for a piece, or turn too much.
    """
    psi = np.unwrap(psi)
    dx, dy = np.diff(x), np.diff(y)
    chord = np.hypot(dx, dy)
    away = np.arctan2(dy, dx)
    left = _wrapped(psi[:-1] - away)
    turn = np.diff(psi)
    quad = 3.0 * (2.0 * left + turn)
    for _ in range(_FIT_STEPS):
        angle = _fit_angle(quad, turn, left)
        miss = np.sin(angle) @ WEIGHTS
        slope = (np.cos(angle) * (NODES**2 - NODES)) @ WEIGHTS
        quad = quad - miss / slope
    sizes = chord / (np.cos(_fit_angle(quad, turn, left)) @ WEIGHTS)
    bound = 1.0 + 1e-6
    if not bool(np.all((sizes > 0.0) & (sizes <= bound * MAX_PIECE))):
        raise DataError(f"samples of a path must be at most {MAX_PIECE} m apart and move on")
    if float(np.max(np.abs(turn) + np.abs(quad))) > bound * MAX_TURN:
        raise DataError(f"a path turns more than {MAX_TURN} rad between neighbouring samples")
    s0 = np.concatenate(([0.0], np.cumsum(sizes)))
    kappa, sharpness = (turn - quad) / sizes, 2.0 * quad / sizes**2
    return _table(s0, x[:-1], y[:-1], psi[:-1], kappa, sharpness, closed)


def part(table: PathTable, start: float, end: float) -> PathTable:
    """The stretch of an open path between two arc lengths on it [m], itself counted from zero."""
    s0 = table.pieces[:, S0]
    first = int(np.searchsorted(s0, start, side="right")) - 1
    last = max(int(np.searchsorted(s0, end, side="left")), first + 1)
    pieces = table.pieces[first:last].copy()
    # The first piece begins later; all else of it goes on as it was.
    pieces[0, X0 : KAPPA0 + 1] = at(table, 0, start)
    pieces[0, S0] = start
    nodes = np.append(pieces[:, S0], end) - start
    x, y, psi, kappa, sharpness = pieces[:, X0 : SHARPNESS + 1].T
    return _table(nodes, x, y, psi, kappa, sharpness, closed=False)


def stack(paths: Iterable[PathTable]) -> PathTable:
    """One table with all the paths of ``paths`` behind each other, numbered in that order.

    Raises:
        DataError: there is nothing to stack.
    """
    tables = list(paths)
    if not tables:
        raise DataError("a bank of paths needs at least one path")
    pieces = cells = 0
    index, meta = [], []
    for table in tables:
        moved = table.meta.copy()
        moved[:, FIRST_PIECE] += pieces
        moved[:, FIRST_CELL] += cells
        index.append(table.index + pieces)
        meta.append(moved)
        pieces += len(table.pieces)
        cells += len(table.index)
    return PathTable(
        np.concatenate([table.pieces for table in tables]),
        np.concatenate(index),
        np.concatenate(meta),
    )


def turned(length: float, kappa_start: float, kappa_end: float) -> float:
    """Change of heading over a segment [rad]."""
    return 0.5 * length * (kappa_start + kappa_end)


def end_pose(segments: Sequence[Segment], start: Pose = ORIGIN) -> Pose:
    """Where a row of segments ends."""
    x, y, psi = _accumulate(*_split(segments), start)
    return Pose(float(x[-1]), float(y[-1]), float(psi[-1]))


def _split(segments: Sequence[Segment]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Length, first curvature and sharpness of all pieces."""
    if not segments:
        raise DataError("a path needs at least one segment")
    rows = np.array([segment[:3] for segment in segments], dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1) | ~(rows[:, 0] > 0.0))
    if bad.size:
        length, start, end = (float(value) for value in rows[bad[0]])
        raise DataError(
            f"segment {bad[0] + 1} cannot be built: length {length} m,"
            f" curvature {start} to {end} 1/m; lengths are positive, all figures finite"
        )
    length, start, end = rows.T
    total = float(np.sum(length))
    if total > MAX_LENGTH:
        raise DataError(f"the path is {total:.3g} m long, the most is {MAX_LENGTH:.0f} m")
    # The bound holds for every part of a segment, also where the curvature changes its sign.
    turning = length * np.maximum(np.abs(start), np.abs(end))
    shares = np.ceil(np.maximum(length / MAX_PIECE, turning / MAX_TURN) * (1.0 - 1e-12))
    if float(np.sum(shares)) > _MAX_PIECES:
        raise DataError(f"the path would need {np.sum(shares):.3g} pieces: it turns too sharply")
    count = np.maximum(shares, 1.0).astype(np.int64)
    size = length / count
    sharp = (end - start) / length
    which = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    return size[which], start[which] + sharp[which] * size[which] * nth, sharp[which]


def _heading_error(sizes: FloatArray, kappa: FloatArray, sharpness: FloatArray) -> float:
    turn = float(np.sum((kappa + 0.5 * sharpness * sizes) * sizes))
    error = math.remainder(turn, math.tau)
    if abs(error) > _CLOSING_HEADING:
        raise DataError(
            f"the closed path ends turned by {error:.3g} rad against its start;"
            f" mend the segments or make it an open path"
        )
    return error


def _accumulate(
    sizes: FloatArray, kappa: FloatArray, sharpness: FloatArray, start: Pose
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions and headings of all nodes, the end included."""
    turn = (kappa + 0.5 * sharpness * sizes) * sizes
    psi = start.psi + np.concatenate(([0.0], np.cumsum(turn)))
    u = sizes[:, None] * NODES
    angle = psi[:-1, None] + (kappa[:, None] + 0.5 * sharpness[:, None] * u) * u
    x = start.x + np.concatenate(([0.0], np.cumsum(sizes * (np.cos(angle) @ WEIGHTS))))
    y = start.y + np.concatenate(([0.0], np.cumsum(sizes * (np.sin(angle) @ WEIGHTS))))
    return x, y, psi


def _fit_angle(quad: FloatArray, turn: FloatArray, left: FloatArray) -> FloatArray:
    """Direction against the chord, left + (turn - quad) t + quad t^2, at the quadrature nodes."""
    linear: FloatArray = (turn - quad)[:, None] * NODES
    return left[:, None] + linear + quad[:, None] * NODES**2


def _wrapped(angle: FloatArray) -> FloatArray:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _table(
    s0: FloatArray,
    x: FloatArray,
    y: FloatArray,
    psi: FloatArray,
    kappa: FloatArray,
    sharpness: FloatArray,
    closed: bool,
) -> PathTable:
    length, count = float(s0[-1]), len(x)
    pieces = np.column_stack((s0[:-1], x, y, psi, kappa, sharpness, np.cos(psi), np.sin(psi)))
    # As many cells as pieces: then the piece is found within a step or two.
    cell = length / count
    index = np.searchsorted(s0[:-1], cell * np.arange(count), side="right") - 1
    meta = np.array([[0.0, count, 0.0, count, cell, length, float(closed)]])
    return PathTable(np.ascontiguousarray(pieces), index.astype(np.int64), meta)
