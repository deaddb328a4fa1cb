"""What every path has to fulfil: its geometry fits together, projection undoes evaluation."""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterator

import numpy as np

from steersman.config import dump, resolve
from steersman.contracts import Contract
from steersman.kernels import path as kernel
from steersman.paths.base import PathComponent
from steersman.paths.segments import MAX_PIECE, MAX_TURN
from steersman.types import FloatArray

# Largest differences: of places [m], of tangents [rad], of curvature at a joint [1/m].
_PLACE, _TANGENT, _JOINT = 1e-6, 1e-9, 1e-4
_CLOSED = 1e-7


def apart(path: PathComponent, a: float, b: float) -> float:
    """Difference of two arc lengths, modulo the length on a closed path [m]."""
    return abs(math.remainder(a - b, path.length)) if path.closed else abs(a - b)


def aside(path: PathComponent, s: float, d: float) -> tuple[float, float]:
    """The point at lateral offset d beside s [m]."""
    x, y, psi, _ = path.at(s)
    return x - d * math.sin(psi), y + d * math.cos(psi)


def offset(path: PathComponent, s: float, rng: np.random.Generator) -> float:
    """An offset of up to 1.5 m, or as far as the curve of radius 1 / kappa allows [m]."""
    return float(rng.uniform(-1.0, 1.0) * min(1.5, 0.8 / max(abs(path.at(s).curvature), 1e-9)))


def a_copy_lies_where_it_lay(path: PathComponent) -> Iterator[str]:
    """As data or pickled and back, the path is equal and lies where it lay."""
    again = resolve("path", dump(path)) if path.kind else path
    for other in (again, pickle.loads(pickle.dumps(path))):
        if other != path or hash(other) != hash(path):
            yield "a copy is another path"
        elif not np.array_equal(other.table.pieces, path.table.pieces):
            yield "a copy lies elsewhere"


def pieces_are_short_enough(path: PathComponent) -> Iterator[str]:
    """Each piece is as short, and turns as little, as the kernels' series need."""
    pieces, sizes, ends = _pieces(path)
    turn = sizes * np.maximum(np.abs(pieces[:, kernel.KAPPA0]), np.abs(ends))
    if not (np.all(sizes > 0.0) and np.max(sizes) <= MAX_PIECE * (1.0 + 1e-6)):
        yield f"a piece is {np.max(sizes):.3g} m long; at most {MAX_PIECE:g}"
    if np.max(turn) > MAX_TURN * (1.0 + 1e-6):
        yield f"a piece turns by {np.max(turn):.3g} rad; at most {MAX_TURN:g}"


def _pieces(path: PathComponent) -> tuple[FloatArray, FloatArray, FloatArray]:
    pieces = path.table.pieces
    sizes = np.diff(pieces[:, kernel.S0], append=path.length)
    return pieces, sizes, pieces[:, kernel.KAPPA0] + sizes * pieces[:, kernel.SHARPNESS]


def pieces_join(path: PathComponent) -> Iterator[str]:
    """In place, tangent and curvature."""
    pieces, sizes, curvature = _pieces(path)
    ends = np.array([kernel._inside(pieces, i, u) for i, u in enumerate(sizes)])
    rows = slice(None) if path.closed else slice(-1)
    starts = np.roll(pieces, -1, axis=0)
    gap = np.hypot(ends[:, 0] - starts[:, kernel.X0], ends[:, 1] - starts[:, kernel.Y0])[rows]
    turn = np.remainder(ends[:, 2] - starts[:, kernel.PSI0] + np.pi, 2.0 * np.pi) - np.pi
    jumps = np.abs(curvature - np.roll(pieces[:, kernel.KAPPA0], -1))[rows]
    if np.max(gap, initial=0.0) >= _CLOSED:
        yield f"pieces are {np.max(gap):.3g} m apart"
    if np.max(np.abs(turn[rows]), initial=0.0) >= _TANGENT:
        yield f"pieces join at an angle of {np.max(np.abs(turn[rows])):.3g} rad"
    # Exact for segments; fitted curves jump by the square of their short pieces.
    if np.max(jumps, initial=0.0) >= _JOINT:
        yield f"the curvature jumps by {np.max(jumps):.3g} 1/m"


def projection_near_undoes_evaluation(path: PathComponent) -> Iterator[str]:
    """With a place to search from, as the loop has one."""
    rng = np.random.default_rng(2)
    for s in rng.uniform(0.0, path.length, 150).tolist():
        d, near = offset(path, s, rng), s + rng.uniform(-2.0, 2.0)
        yield from _projected(path, s, d, near)


def projection_at_the_joint(path: PathComponent) -> Iterator[str]:
    """Around start and end, from both sides."""
    for s in (-0.5, -1e-9, 0.0, 1e-9, 0.5):
        for target in (s, s + path.length):
            for near in (target + 0.3, target - 0.3):
                yield from _projected(path, target, 0.4, near)
    found, _ = path.project(*aside(path, path.length, 0.4), near=path.length)
    if path.closed and not 0.0 <= found < path.length:
        yield f"projects its end to s = {found}"


def _projected(path: PathComponent, s: float, d: float, near: float | None) -> Iterator[str]:
    found, side = path.project(*aside(path, s, d), near=near)
    if apart(path, found, s) >= _PLACE or abs(side - d) > _PLACE:
        yield f"a point {d:.3g} m beside s = {s:.6g} is projected to {found:.6g}, {side:.3g} m"


def s_is_arc_length(path: PathComponent) -> Iterator[str]:
    """And tangent and curvature are the derivatives by it."""
    ds, fine = 0.01, 1e-4
    for s in np.linspace(0.013, path.length - 0.017, 97).tolist():
        # The chord of an arc is shorter by its third power.
        chord = math.dist(path.at(s)[:2], path.at(s + ds)[:2])
        a, m, b = path.at(s - fine), path.at(s), path.at(s + fine)
        slope = math.atan2(b.y - a.y, b.x - a.x)
        if abs(chord - ds) > _CLOSED:
            yield f"{ds} of arc length at s = {s:.6g} are {chord:.8g} m"
        if abs(math.remainder(slope - m.psi, math.tau)) > _PLACE:
            yield f"psi is no tangent at s = {s:.6g}"
        if abs((b.psi - a.psi) / (2.0 * fine) - m.curvature) > 2e-5 + 1e-6 * abs(m.curvature):
            yield f"kappa is not the change of psi at s = {s:.6g}"


def ends_fit(path: PathComponent) -> Iterator[str]:
    """A closed path joins its start; an open one goes on straight."""
    start, end, far = path.at(0.0), path.at(path.length), path.at(path.length + 3.0)
    if path.closed:
        if math.dist(start[:2], end[:2]) >= _TANGENT or path.at(-1.0) != path.at(path.length - 1.0):
            yield "is closed, and its end is not its start"
        return
    ahead = (end.x + 3.0 * math.cos(end.psi), end.y + 3.0 * math.sin(end.psi))
    if math.dist(far[:2], ahead) > _TANGENT or far.psi != end.psi or far.curvature != 0.0:
        yield "does not go on straight behind its end"
    before = path.at(-2.0)
    for point, s in ((far, path.length + 3.0), (before, -2.0)):
        if abs(path.project(point.x, point.y)[0] - s) > _PLACE:
            yield f"a point at s = {s:.6g}, beyond its ends, is projected elsewhere"


check: Contract[PathComponent] = Contract(
    a_copy_lies_where_it_lay,
    pieces_are_short_enough,
    pieces_join,
    projection_near_undoes_evaluation,
    projection_at_the_joint,
    s_is_arc_length,
    ends_fit,
)
