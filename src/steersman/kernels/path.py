"""Evaluate and project paths made of pieces whose curvature is linear in arc length.

A piece is a short clothoid (arcs and lines are clothoids with zero sharpness). Positions inside a
piece come from Gauss-Legendre quadrature of the tangent, exact to rounding because builders keep
pieces short (at most 2 m, at most 0.25 rad of turning). One :class:`PathTable` holds several
paths behind each other, so that a vector of vehicles can drive on different ones.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from steersman.types import FloatArray

# Columns of PathTable.pieces.
S0, X0, Y0, PSI0, KAPPA0, SHARPNESS, COS0, SIN0 = range(8)
# Columns of PathTable.meta.
FIRST_PIECE, N_PIECES, FIRST_CELL, N_CELLS, CELL, LENGTH, CLOSED = range(7)

# Three-point Gauss-Legendre nodes and weights on [0, 1]; Abramowitz and Stegun, table 25.4.
_G1, _G2, _G3 = 0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15)
_W1, _W2 = 5.0 / 18.0, 8.0 / 18.0
_NEWTON_STEPS = 12
_STEP_LIMIT = 20.0


class PathTable(NamedTuple):
    """Paths as the kernels read them."""

    pieces: FloatArray
    """(M, 8): s0, x0, y0, psi0, kappa0, sharpness dkappa/ds, cos psi0, sin psi0 of each piece."""
    index: Any
    """(K,) int64: the piece that holds the start of each equally long cell of arc length."""
    meta: FloatArray
    """(P, 7): first piece, pieces, first cell, cells, cell length, length, closed of each path."""


@njit(cache=True, inline="always")
def _wrap(table: PathTable, p: int, s: float) -> float:
    length = table.meta[p, LENGTH]
    if table.meta[p, CLOSED] > 0.0 and (s < 0.0 or s >= length):
        s -= length * math.floor(s / length)
        if s >= length:
            s = 0.0
    return s


@njit(cache=True)
def locate(table: PathTable, p: int, s: float) -> int:
    """Row of the piece of path ``p`` that holds arc length ``s`` (already wrapped)."""
    meta = table.meta
    first = int(meta[p, FIRST_PIECE])
    last = first + int(meta[p, N_PIECES]) - 1
    if s <= 0.0:
        return first
    cell = min(int(s / meta[p, CELL]), int(meta[p, N_CELLS]) - 1)
    row = int(table.index[int(meta[p, FIRST_CELL]) + cell])
    while row < last and table.pieces[row + 1, S0] <= s:
        row += 1
    return row


@njit(cache=True, inline="always")
def _inside(pieces: FloatArray, row: int, u: float) -> tuple[float, float, float, float]:
    """Point at distance ``u`` into a piece: x, y, heading gained, curvature."""
    kappa, sharp = pieces[row, KAPPA0], pieces[row, SHARPNESS]
    a1 = (kappa + 0.5 * sharp * _G1 * u) * _G1 * u
    a2 = (kappa + 0.5 * sharp * _G2 * u) * _G2 * u
    a3 = (kappa + 0.5 * sharp * _G3 * u) * _G3 * u
    ahead = u * (_W1 * (math.cos(a1) + math.cos(a3)) + _W2 * math.cos(a2))
    left = u * (_W1 * (math.sin(a1) + math.sin(a3)) + _W2 * math.sin(a2))
    c, s = pieces[row, COS0], pieces[row, SIN0]
    x = pieces[row, X0] + c * ahead - s * left
    y = pieces[row, Y0] + s * ahead + c * left
    return x, y, (kappa + 0.5 * sharp * u) * u, kappa + sharp * u


@njit(cache=True)
def at(table: PathTable, p: int, s: float) -> tuple[float, float, float, float]:
    """Position, tangent direction and curvature of path ``p`` at arc length ``s`` [m, rad, 1/m].

    Closed paths wrap (the tangent stays within one turn's range); open ones go on straight.
    """
    pieces = table.pieces
    s = _wrap(table, p, s)
    length = table.meta[p, LENGTH]
    beyond = 0.0
    if s < 0.0:
        beyond, s = s, 0.0
    elif s > length:
        beyond, s = s - length, length
    row = locate(table, p, s)
    x, y, turned, kappa = _inside(pieces, row, s - pieces[row, S0])
    psi = pieces[row, PSI0] + turned
    if beyond != 0.0:
        return x + beyond * math.cos(psi), y + beyond * math.sin(psi), psi, 0.0
    return x, y, psi, kappa


@njit(cache=True)
def project_near(
    table: PathTable, p: int, x: float, y: float, near: float
) -> tuple[float, float, float, float]:
    """Closest point of path ``p`` by Newton's method from arc length ``near``.

    Returns arc length s (wrapped on closed paths), signed offset d (left positive), and the
    path's tangent direction and curvature there. Solves (point - path(s)) . tangent(s) = 0.
    """
    s = near
    for _ in range(_NEWTON_STEPS):
        px, py, psi, kappa = at(table, p, s)
        c, n = math.cos(psi), math.sin(psi)
        along = (x - px) * c + (y - py) * n
        aside = (y - py) * c - (x - px) * n
        # The Jacobian 1 - kappa d vanishes at the centre of curvature: keep away from it.
        step = along / max(1.0 - kappa * aside, 0.2)
        step = min(max(step, -_STEP_LIMIT), _STEP_LIMIT)
        s += step
        if abs(step) < 1e-10:
            break
    px, py, psi, kappa = at(table, p, s)
    d = (y - py) * math.cos(psi) - (x - px) * math.sin(psi)
    return _wrap(table, p, s), d, psi, kappa


@njit(cache=True)
def project(table: PathTable, p: int, x: float, y: float) -> tuple[float, float]:
    """Closest point of the whole path: arc length s and signed offset d (left positive) [m]."""
    meta, pieces = table.meta, table.pieces
    first = int(meta[p, FIRST_PIECE])
    best, start = np.inf, 0.0
    for row in range(first, first + int(meta[p, N_PIECES])):
        gap = (x - pieces[row, X0]) ** 2 + (y - pieces[row, Y0]) ** 2
        if gap < best:
            best, start = gap, pieces[row, S0]
    s, d, _, _ = project_near(table, p, x, y, start)
    return s, d
