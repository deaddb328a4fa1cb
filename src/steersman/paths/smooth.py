"""Clothoid transitions for paths whose curvature jumps, within a tolerance.

The moving average of a curve's position over a window of length w,

    q(s) = 1 / w  integral of p(s + u) over u from -w / 2 to w / 2,

has q'' = (t(s + w / 2) - t(s - w / 2)) / w with t the unit tangent of p: wherever the curvature of
p jumps, that of q changes linearly over w, as a clothoid does. An arc of curvature kappa moves
towards its middle by kappa w^2 / 24, which is the classical shift that makes room for a clothoid
of length w (e.g. Meyer and Gibson, *Route Surveying and Design*), so w follows from the tolerance.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from steersman.errors import DataError
from steersman.kernels import path as kernel
from steersman.kernels.path import KAPPA0, LENGTH, S0, SHARPNESS, X0, Y0, PathTable
from steersman.paths.segments import NODES, WEIGHTS, from_samples
from steersman.types import FloatArray

# Longest and shortest transitions [m].
_LONGEST, _SHORTEST = 30.0, 0.1
# Samples: at most so far apart [m], as a share of the window, and as turning [rad].
_STEP, _SHARE, _TURN = 0.5, 0.25, 0.1
_CLOSEST = 0.01
# Smaller jumps of curvature [1/m] need no sample of their own; less curvature than this is none.
_JUMP, _FLAT = 1e-4, 1e-9
_SHRINK, _TRIES = 0.9, 60


def smoothed(table: PathTable, tolerance: float) -> PathTable:
    """The path in ``table`` with clothoids where its curvature jumps.

    The ends of an open path stay where they are and have no curvature. A path without a jump
    stays as it is.

    Args:
        table: one path.
        tolerance: farthest that the smooth path lies beside the other [m].

    Raises:
        DataError: the tolerance leaves no room for transitions.
    """
    curve = _ExtendedPath(table)
    if not np.any((curve.jumps > 0.0) & (curve.closed | (curve.jumps < curve.length))):
        return table
    window = math.sqrt(24.0 * tolerance / max(curve.sharpest, _FLAT))
    window = min(window, _LONGEST, curve.length / 4.0)
    for _ in range(_TRIES):
        if window < _SHORTEST:
            break
        found = curve.averaged(window)
        if _farthest(table, found) <= tolerance:
            return found
        window *= _SHRINK
    raise DataError(
        f"no clothoids of {_SHORTEST} m and more stay within {tolerance:g} m of a path that bends"
        f" with {curve.sharpest:.3g} 1/m; allow more"
    )


def _farthest(table: PathTable, other: PathTable) -> float:
    """How far the pieces of ``other`` begin, at most, beside the path in ``table`` [m]."""
    share = table.meta[0, LENGTH] / other.meta[0, LENGTH]
    return max(
        abs(kernel.project_near(table, 0, x, y, s * share)[1])
        for s, x, y in other.pieces[:, : Y0 + 1].tolist()
    )


class _ExtendedPath:
    """A path that goes on beyond its ends, and the integral of its position over arc length."""

    def __init__(self, table: PathTable) -> None:
        self.closed = bool(table.meta[0, kernel.CLOSED])
        self.length = float(table.meta[0, LENGTH])
        rows = table.pieces[:, : SHARPNESS + 1]
        self.sharpest = float(np.max(np.abs(rows[:, KAPPA0])))
        self.jumps = _jumps(table)
        rows = _extended(table)
        self.s0, x, y, self.psi, self.kappa, self.sharp = rows.T
        # Large coordinates would cost figures in the integral.
        self.middle = complex(float(np.mean(x)), float(np.mean(y)))
        self.start = x + 1j * y - self.middle
        sizes = np.diff(self.s0)
        steps = self._sum_in(np.arange(len(sizes)), sizes)
        self.sums = np.concatenate(([0.0], np.cumsum(steps)))

    def averaged(self, window: float) -> PathTable:
        """The moving average as a path."""
        s = self._samples(window)
        (before, low), (after, high) = (self._at(s + side * window) for side in (-0.5, 0.5))
        place: Any = (high - low) / window + self.middle
        psi = np.angle(after - before)
        if self.closed:
            place[-1], psi[-1] = place[0], psi[0]
        return from_samples(place.real, place.imag, psi, closed=self.closed)

    def _samples(self, window: float) -> FloatArray:
        """Arc lengths of the samples: where transitions begin and end, and enough between."""
        step = min(_STEP, _SHARE * window, _TURN / max(self.sharpest, _FLAT))
        marks = np.concatenate((self.jumps - 0.5 * window, self.jumps + 0.5 * window))
        if self.closed:
            marks = marks % self.length
        marks = np.sort(marks[(marks > _CLOSEST) & (marks < self.length - _CLOSEST)])
        # Of marks that all but coincide one is enough.
        marks = marks[np.diff(marks, prepend=-1.0) > _CLOSEST]
        marks = np.concatenate(([0.0], marks, [self.length]))
        parts = [
            np.linspace(a, b, int(np.ceil((b - a) / step)), endpoint=False)
            for a, b in itertools.pairwise(marks)
        ]
        return np.append(np.concatenate(parts), self.length)

    def _at(self, s: FloatArray) -> tuple[Any, Any]:
        """Position, and its integral, as complex numbers."""
        row = np.clip(np.searchsorted(self.s0, s, side="right") - 1, 0, len(self.sums) - 1)
        u = s - self.s0[row]
        place = self.start[row] + u * (self._tangents(row, u) @ WEIGHTS)
        return place, self.sums[row] + self._sum_in(row, u)

    def _sum_in(self, row: Any, u: FloatArray) -> Any:
        """Integral of the position over a piece's first ``u`` metres.

        By parts, that of the way from its beginning is the integral of (u - v) t(v).
        """
        moment = u**2 * (self._tangents(row, u) @ (WEIGHTS * (1.0 - NODES)))
        return self.start[row] * u + moment

    def _tangents(self, row: Any, u: FloatArray) -> Any:
        """Unit tangents at the nodes of the quadrature over the first ``u`` metres of a piece."""
        v = u[:, None] * NODES
        angle = self.psi[row, None] + (self.kappa[row, None] + 0.5 * self.sharp[row, None] * v) * v
        return np.exp(1j * angle)


def _ends(table: PathTable) -> FloatArray:
    """Rows s, x, y, psi, kappa of where each piece ends."""
    pieces = table.pieces
    length = float(table.meta[0, LENGTH])
    s = np.append(pieces[1:, S0], length)
    # Just before the end: the end of a closed path is its beginning.
    row = len(pieces) - 1
    x, y, psi, *_ = kernel._inside(pieces, row, length - pieces[row, S0])
    places = np.vstack((pieces[1:, X0:KAPPA0], (x, y, psi)))
    kappa = pieces[:, KAPPA0] + pieces[:, SHARPNESS] * (s - pieces[:, S0])
    return np.column_stack((s, places, kappa))


def _jumps(table: PathTable) -> FloatArray:
    """Where the curvature jumps; also at the ends of an open path that bends there."""
    begin, ends = table.pieces[:, KAPPA0], _ends(table)
    closed = table.meta[0, kernel.CLOSED] > 0.0
    before = np.insert(ends[:, -1], 0, ends[-1, -1] if closed else 0.0)
    after = np.append(begin, begin[0] if closed else 0.0)
    places = np.insert(ends[:, 0], 0, 0.0)
    found: FloatArray = places[np.abs(after - before) > _JUMP]
    return found


def _extended(table: PathTable) -> FloatArray:
    """The pieces with more of them before and behind.

    A closed path goes on around. An open one goes on turned by half a turn about its end, so that
    its average keeps the end: tangents are those at the same distance within, curvatures opposite.
    """
    rows, ends = table.pieces[:, : SHARPNESS + 1], _ends(table)
    length = float(table.meta[0, LENGTH])
    head, tail = rows[:, S0] < _LONGEST, ends[:, 0] > length - _LONGEST
    if table.meta[0, kernel.CLOSED] > 0.0:
        around = np.zeros(rows.shape[1])
        around[S0] = length
        return np.concatenate((rows[tail] - around, rows, rows[head] + around))
    turned = np.column_stack((ends, rows[:, SHARPNESS]))
    turned[:, [S0, X0, Y0, KAPPA0]] *= -1.0
    first, last = np.zeros(rows.shape[1]), np.zeros(rows.shape[1])
    first[[X0, Y0]] = 2.0 * rows[0, [X0, Y0]]
    last[[S0, X0, Y0]] = 2.0 * ends[-1, [S0, X0, Y0]]
    return np.concatenate((turned[head][::-1] + first, rows, turned[tail][::-1] + last))
