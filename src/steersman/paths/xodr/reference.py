"""Points of a reference line: line, arc, spiral, poly3 and paramPoly3 over true arc length.

ASAM OpenDRIVE 1.8, chapter 9 (geometries of the reference line).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from steersman.paths.segments import NODES, WEIGHTS
from steersman.paths.xodr.model import ReferencePiece
from steersman.types import FloatArray

# Steps of the quadrature [m, rad].
_STEP, _TURN = 2.0, 0.25
# Most turning of one geometry [rad]: ten times around.
_MOST_TURN = 63.0
# Cubics: spans of at most a metre, over which their arc length is integrated.
_SPANS, _MOST_SPANS = 1.0, 2000
_NEWTON = 8
# Slower than this, arc length per parameter, a cubic has a cusp.
_SLOWEST = 1e-6
_EXACT = 1e-6
# How far the arc length of a paramPoly3 may be from what is said [share].
_LENGTH_SLACK = 0.1


class ReferencePoints(NamedTuple):
    """Points of a curve, each (n,)."""

    x: FloatArray
    y: FloatArray
    psi: FloatArray
    """Direction of the tangent [rad]."""
    kappa: FloatArray
    """Curvature [1/m]."""


def points(geometry: ReferencePiece, u: FloatArray) -> ReferencePoints:
    """Points at distances ``u`` (n,) from where the geometry begins [m].

    Raises:
        DataError: the geometry cannot be evaluated.
    """
    if geometry.kind in {"poly3", "paramPoly3"}:
        found = _cubic(geometry, u)
    else:
        found = _clothoid(geometry, u)
    if not all(np.isfinite(column).all() for column in found):
        raise geometry.fault("its figures are too large")
    c, s = np.cos(geometry.psi), np.sin(geometry.psi)
    x = geometry.x + c * found.x - s * found.y
    y = geometry.y + s * found.x + c * found.y
    return ReferencePoints(x, y, geometry.psi + found.psi, found.kappa)


def _clothoid(geometry: ReferencePiece, u: FloatArray) -> ReferencePoints:
    """Points of linear curvature in the geometry's own frame, by quadrature of the tangent."""
    start, end = geometry.figures
    length = geometry.length
    turning = length * max(abs(start), abs(end))
    if turning > _MOST_TURN:
        raise geometry.fault(f"turns by {turning:.3g} rad; curvatures are in 1/m")
    sharp = (end - start) / length
    count = max(int(np.ceil(max(length / _STEP, turning / _TURN))), 1)
    grid = np.linspace(0.0, length, count + 1)
    ahead, left = _advance(start, sharp, grid[:-1], np.diff(grid))
    x = np.concatenate(([0.0], np.cumsum(ahead)))
    y = np.concatenate(([0.0], np.cumsum(left)))
    row = np.clip((u * (count / length)).astype(np.int64), 0, count - 1)
    ahead, left = _advance(start, sharp, grid[row], u - grid[row])
    return ReferencePoints(
        x[row] + ahead, y[row] + left, (start + 0.5 * sharp * u) * u, start + sharp * u
    )


def _advance(
    kappa: float, sharp: float, start: FloatArray, size: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What is covered along x and y between ``start`` and ``start + size``."""
    u = start[:, None] + size[:, None] * NODES
    angle = (kappa + 0.5 * sharp * u) * u
    return size * (np.cos(angle) @ WEIGHTS), size * (np.sin(angle) @ WEIGHTS)


def _cubic(geometry: ReferencePiece, u: FloatArray) -> ReferencePoints:
    """Points of a cubic in the geometry's own frame, its parameter found from arc length."""
    along, aside, span = _polynomials(geometry)
    count = int(np.clip(np.ceil(geometry.length / _SPANS), 4, _MOST_SPANS))
    grid = np.linspace(0.0, span, count + 1)
    inner = grid[:-1, None] + np.diff(grid)[:, None] * NODES
    arc = np.concatenate(
        ([0.0], np.cumsum(np.diff(grid) * (_speed(along, aside, inner) @ WEIGHTS)))
    )
    if not np.isfinite(arc[-1]):
        raise geometry.fault("its figures are too large")
    if geometry.kind == "paramPoly3":
        if abs(arc[-1] / geometry.length - 1.0) > _LENGTH_SLACK:
            raise geometry.fault(
                f"its curve is {arc[-1]:.4g} m long, its length is {geometry.length:.4g} m;"
                f" is pRange right?"
            )
        # What rounding has left between the two is spread, so that the curve ends where it ends.
        u = u * (arc[-1] / geometry.length)
    p = _parameter(along, aside, grid, arc, u)
    (x, dx, ddx), (y, dy, ddy) = _derivatives(along, p), _derivatives(aside, p)
    speed = np.hypot(dx, dy)
    # No chord is longer than its arc: where it is, the curve bends faster than it was integrated.
    if bool(np.any(np.hypot(np.diff(x), np.diff(y)) > 1.01 * np.abs(np.diff(u)) + _EXACT)):
        raise geometry.fault("its figures are too large")
    if float(np.min(speed)) < _SLOWEST * geometry.length / max(span, 1e-300):
        raise geometry.fault("the curve has a cusp")
    return ReferencePoints(x, y, np.arctan2(dy, dx), (dx * ddy - dy * ddx) / speed**3)


def _polynomials(geometry: ReferencePiece) -> tuple[FloatArray, FloatArray, float]:
    """Coefficients of both coordinates, and the largest parameter."""
    if geometry.kind == "poly3":
        # Along u the arc length grows at least as fast as u itself.
        return np.array([0.0, 1.0, 0.0, 0.0]), np.array(geometry.figures), geometry.length
    figures = np.array(geometry.figures)
    return figures[:4], figures[4:8], float(figures[8])


def _derivatives(c: FloatArray, p: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A polynomial, its first and its second derivative."""
    value = c[0] + p * (c[1] + p * (c[2] + p * c[3]))
    return value, c[1] + p * (2.0 * c[2] + 3.0 * c[3] * p), 2.0 * c[2] + 6.0 * c[3] * p


def _speed(along: FloatArray, aside: FloatArray, p: FloatArray) -> FloatArray:
    """Arc length per parameter."""
    return np.hypot(_derivatives(along, p)[1], _derivatives(aside, p)[1])


def _parameter(
    along: FloatArray, aside: FloatArray, grid: FloatArray, arc: FloatArray, u: FloatArray
) -> FloatArray:
    """Parameters at arc lengths ``u``: Newton's steps within the spans of ``grid``."""
    row = np.clip(np.searchsorted(arc, u, side="right") - 1, 0, len(grid) - 2)
    size = np.maximum(arc[row + 1] - arc[row], 1e-300)
    p = grid[row] + (grid[row + 1] - grid[row]) * (u - arc[row]) / size
    for _ in range(_NEWTON):
        inner = grid[row][:, None] + (p - grid[row])[:, None] * NODES
        reached = arc[row] + (p - grid[row]) * (_speed(along, aside, inner) @ WEIGHTS)
        p = p - (reached - u) / np.maximum(_speed(along, aside, p), 1e-300)
    return p
