"""Evaluate and project paths made of pieces whose curvature is linear in arc length.

A piece is a short clothoid (arcs and lines are clothoids with zero sharpness). Positions inside a
piece come from Gauss-Legendre quadrature of the tangent; builders keep pieces short (at most 2 m,
at most 0.25 rad of turning), so the error stays below 1e-9 m and does not add up from piece to
piece. One :class:`PathTable` holds several paths behind each other, so that a vector of vehicles
can drive on different ones.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from steersman.kernels.compiled import inlined, kernel
from steersman.types import FloatArray

# Columns of PathTable.pieces.
S0, X0, Y0, PSI0, KAPPA0, SHARPNESS, COS0, SIN0 = range(8)
# Columns of PathTable.meta.
FIRST_PIECE, N_PIECES, FIRST_CELL, N_CELLS, CELL, LENGTH, CLOSED = range(7)

# Four-point Gauss-Legendre nodes and weights on [0, 1]; Abramowitz and Stegun, table 25.4.
# (Three points are not enough where curvature changes fast: 2e-7 m.)
_INNER = 0.5 * math.sqrt(3.0 / 7.0 - 2.0 / 7.0 * math.sqrt(1.2))
_OUTER = 0.5 * math.sqrt(3.0 / 7.0 + 2.0 / 7.0 * math.sqrt(1.2))
_G1, _G2, _G3, _G4 = 0.5 - _OUTER, 0.5 - _INNER, 0.5 + _INNER, 0.5 + _OUTER
_W1, _W2 = (18.0 - math.sqrt(30.0)) / 72.0, (18.0 + math.sqrt(30.0)) / 72.0
# Taylor coefficients of cosine and sine; products, because divisions are slow.
_C2, _C4, _C6, _C8, _C10 = -1.0 / 2, 1.0 / 24, -1.0 / 720, 1.0 / 40320, -1.0 / 3628800
_C3, _C5, _C7, _C9 = -1.0 / 6, 1.0 / 120, -1.0 / 5040, 1.0 / 362880
# ... and of the arctangent.
_A3, _A5, _A7 = 1.0 / 3, 1.0 / 5, 1.0 / 7
_NEAR_STEPS = 24
_PIECE_STEPS = 4
_STEP_LIMIT = 20.0
# Convergence is quadratic: after a step this short the point is right to rounding.
_SHORT_STEP = 1e-6


class PathTable(NamedTuple):
    """Paths as the kernels read them."""

    pieces: FloatArray
    """(M, 8): s0, x0, y0, psi0, kappa0, sharpness dkappa/ds, cos psi0, sin psi0 of each piece."""
    index: Any  # An int64 array; its type would clash with tuple.index.
    """(K,) int64: the piece that holds the start of each equally long cell of arc length."""
    meta: FloatArray
    """(P, 7): first piece, pieces, first cell, cells, cell length, length, closed of each path."""


@inlined
def _cos_sin(a: float) -> tuple[float, float]:
    """Cosine and sine of an angle of at most 0.25 rad, by Taylor series, to rounding."""
    q = a * a
    c = 1.0 + q * (_C2 + q * (_C4 + q * (_C6 + q * (_C8 + q * _C10))))
    s = a * (1.0 + q * (_C3 + q * (_C5 + q * (_C7 + q * _C9))))
    return c, s


@inlined
def _wrap(table: PathTable, p: int, s: float) -> float:
    """Arc length within [0, length) on closed paths, unchanged on open ones."""
    length = table.meta[p, LENGTH]
    if table.meta[p, CLOSED] > 0.0 and (s < 0.0 or s >= length):
        s -= length * math.floor(s / length)
        # Rounding can land on the length itself or, from an absurd s, anywhere.
        if s < 0.0 or s >= length:
            s = 0.0
    return s


@inlined
def locate(table: PathTable, p: int, s: float) -> int:
    """Row of the piece of path ``p`` that holds arc length ``s`` (already wrapped)."""
    meta = table.meta
    first = int(meta[p, FIRST_PIECE])
    last = first + int(meta[p, N_PIECES]) - 1
    # Written so that NaN, too, ends here and never becomes an index.
    if not s > 0.0:
        return first
    if s >= meta[p, LENGTH]:
        return last
    cell = min(int(s / meta[p, CELL]), int(meta[p, N_CELLS]) - 1)
    row = int(table.index[int(meta[p, FIRST_CELL]) + cell])
    while row < last and table.pieces[row + 1, S0] <= s:
        row += 1
    # Rounding of the division may have picked the cell behind.
    while row > first and table.pieces[row, S0] > s:
        row -= 1
    return row


@inlined
def _inside(
    pieces: FloatArray, row: int, u: float
) -> tuple[float, float, float, float, float, float]:
    """Point at distance ``u`` into a piece: x, y, psi, kappa, cos psi, sin psi."""
    kappa, sharp = pieces[row, KAPPA0], pieces[row, SHARPNESS]
    c1, s1 = _cos_sin((kappa + 0.5 * sharp * _G1 * u) * _G1 * u)
    c2, s2 = _cos_sin((kappa + 0.5 * sharp * _G2 * u) * _G2 * u)
    c3, s3 = _cos_sin((kappa + 0.5 * sharp * _G3 * u) * _G3 * u)
    c4, s4 = _cos_sin((kappa + 0.5 * sharp * _G4 * u) * _G4 * u)
    ahead = u * (_W1 * (c1 + c4) + _W2 * (c2 + c3))
    left = u * (_W1 * (s1 + s4) + _W2 * (s2 + s3))
    turned = (kappa + 0.5 * sharp * u) * u
    ct, st = _cos_sin(turned)
    c, s = pieces[row, COS0], pieces[row, SIN0]
    x = pieces[row, X0] + c * ahead - s * left
    y = pieces[row, Y0] + s * ahead + c * left
    return x, y, pieces[row, PSI0] + turned, kappa + sharp * u, c * ct - s * st, s * ct + c * st


@inlined
def frame(table: PathTable, p: int, s: float) -> tuple[float, float, float, float, float, float]:
    """Point of path ``p`` at arc length ``s``: x, y, psi, kappa, cos psi, sin psi."""
    s = _wrap(table, p, s)
    length = table.meta[p, LENGTH]
    # On closed paths s is in range by now, so nothing is beyond. NaN stays NaN.
    on_path = min(max(s, 0.0), length) if s == s else s  # noqa: PLR0124
    beyond = s - on_path
    row = locate(table, p, on_path)
    x, y, psi, kappa, c, n = _inside(table.pieces, row, on_path - table.pieces[row, S0])
    if beyond != 0.0:
        return x + beyond * c, y + beyond * n, psi, 0.0, c, n
    return x, y, psi, kappa, c, n


@inlined
def at(table: PathTable, p: int, s: float) -> tuple[float, float, float, float]:
    """Position, tangent direction and curvature of path ``p`` at arc length ``s`` [m, rad, 1/m].

    Closed paths wrap (the tangent stays within one turn's range); open ones go on straight.
    """
    x, y, psi, kappa, _, _ = frame(table, p, s)
    return x, y, psi, kappa


@inlined
def _towards(along: float, aside: float, kappa: float) -> float:
    """Arc length to the closest point of the osculating circle.

    The point to project lies ``along`` ahead and ``aside`` left of the path's present point.
    Agrees with Newton's step along / (1 - kappa aside) to second order, is exact on lines and
    circles, and moves the right way beyond the centre of curvature too.
    """
    room = 1.0 - kappa * aside
    if abs(kappa * along) < 0.1 * room:
        step = along / room
        q = (kappa * step) ** 2
        return step * (1.0 - q * (_A3 - q * (_A5 - q * _A7)))
    # kappa cannot be zero here: room would be 1 and the test above true (or along not finite).
    return math.atan2(kappa * along, room) / kappa


@kernel
def project_near(
    table: PathTable, p: int, x: float, y: float, near: float
) -> tuple[float, float, float, float]:
    """Closest point of path ``p`` that is found by going downhill from arc length ``near``.

    Returns arc length s (wrapped on closed paths), signed offset d (left positive), and the
    path's tangent direction and curvature there. Solves (point - path(s)) . tangent(s) = 0.
    On closed paths ``near`` may lie below zero or above the length.
    """
    s, before, limit = near, 0.0, _STEP_LIMIT
    for i in range(_NEAR_STEPS):
        px, py, psi, kappa, c, n = frame(table, p, s)
        along = (x - px) * c + (y - py) * n
        d = (y - py) * c - (x - px) * n
        step = _towards(along, d, kappa)
        # A change of direction has bracketed the solution: halving makes sure to reach it.
        if step * before < 0.0:
            limit = 0.5 * abs(before)
        step = min(max(step, -limit), limit)
        if i == _NEAR_STEPS - 1 or not abs(step) > _SHORT_STEP:
            break
        s += step
        before = step
    # The offset is stationary, so what is left of the step moves only s and the tangent.
    return _wrap(table, p, s + step), d, psi + kappa * step, kappa


@kernel
def _closest_in_piece(
    pieces: FloatArray, row: int, piece_length: float, x: float, y: float
) -> tuple[float, float]:
    """Distance into a piece of its point closest to (x, y), and the squared distance to it."""
    u, gap = 0.0, np.inf
    best = 0.0
    for _ in range(_PIECE_STEPS):
        px, py, _, kappa, c, n = _inside(pieces, row, u)
        dx, dy = x - px, y - py
        if dx * dx + dy * dy < gap:
            gap, best = dx * dx + dy * dy, u
        moved = u + _towards(dx * c + dy * n, dy * c - dx * n, kappa)
        moved = min(max(moved, 0.0), piece_length)
        if abs(moved - u) < 1e-6:
            break
        u = moved
    return best, gap


@kernel
def project(table: PathTable, p: int, x: float, y: float) -> tuple[float, float]:
    """Closest point of the whole path: arc length s and signed offset d (left positive) [m].

    Where a path crosses itself the first of equally close points is taken. Beyond the ends of an
    open path the offset is measured from its straight continuation, and s is below zero or above
    the length.
    """
    meta, pieces = table.meta, table.pieces
    first = int(meta[p, FIRST_PIECE])
    last = first + int(meta[p, N_PIECES]) - 1
    bound = np.inf
    for row in range(first, last + 1):
        bound = min(bound, (x - pieces[row, X0]) ** 2 + (y - pieces[row, Y0]) ** 2)
    bound = math.sqrt(bound)
    # No point of a piece is closer than its first point's distance less its length.
    best, start = np.inf, 0.0
    for row in range(first, last + 1):
        end = pieces[row + 1, S0] if row < last else meta[p, LENGTH]
        size = end - pieces[row, S0]
        if (x - pieces[row, X0]) ** 2 + (y - pieces[row, Y0]) ** 2 <= (bound + size) ** 2:
            u, gap = _closest_in_piece(pieces, row, size, x, y)
            if gap < best:
                best, start = gap, pieces[row, S0] + u
    s, d, _, _ = project_near(table, p, x, y, start)
    return s, d
