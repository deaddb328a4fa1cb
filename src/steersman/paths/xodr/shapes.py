"""The pieces of a path joined to lines, arcs and spirals as long as they can be."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.kernels import path as kernel
from steersman.kernels.path import PathTable
from steersman.paths.segments import Segment, end_pose
from steersman.types import FloatArray, Pose

# How far a joined shape may lie from the pieces that it stands for [m].
_APART = 1e-6
# A line or arc in place of a spiral may leave so much of a jump in curvature [1/m].
_JUMP = 2e-5
# Curvature and sharpness that differ by less are the same [1/m, 1/m^2].
_SAME = 1e-10
# CARLA's reader turns an arc about its centre in single precision, so it loses as many figures as
# the radius has: 0.5 mm at 8 km, 2 mm at 31 km. Beyond 1 km, below this curvature [1/m], an arc is
# written as a spiral, which is read in double precision.
_GENTLE = 1e-3
# Both curvatures of a spiral must differ; so much between them is always enough [1/m].
_APART_ENDS = 1e-7
# The longer such a spiral, the farther off is the place where its curvature would be zero, from
# which readers count; up to this length [m] double precision has figures enough.
_LONGEST = 500.0


class Shape(NamedTuple):
    """A line, arc or spiral: a stretch of linear curvature."""

    s: float
    """Arc length where it begins [m]."""
    start: Pose
    """Where it begins [m, rad]."""
    length: float
    """Arc length [m]."""
    kappa_start: float
    """Curvature where it begins [1/m]."""
    kappa_end: float
    """Curvature where it ends [1/m]; equal to the first on lines and arcs, and zero on lines."""


def shapes(table: PathTable) -> list[Shape]:
    """The one path in ``table`` as few shapes, each within a micrometre of its pieces."""
    pieces = table.pieces
    ends = np.append(pieces[1:, kernel.S0], table.meta[0, kernel.LENGTH])
    sizes = ends - pieces[:, kernel.S0]
    out: list[Shape] = []
    first = 0
    for last in _joints(pieces, sizes):
        out += _joined(pieces, sizes, first, last)
        first = last
    return out


def cut(row: list[Shape], start: float, end: float) -> list[Shape]:
    """What lies between two arc lengths, itself counted from ``start``."""
    out = []
    for shape in row:
        low, high = max(start, shape.s), min(end, shape.s + shape.length)
        if high - low > _APART:
            out.append(_part(shape, low - shape.s, high - shape.s)._replace(s=low - start))
    return out


def _joints(pieces: FloatArray, sizes: FloatArray) -> list[int]:
    """Where curvature or sharpness changes: the row after each run of pieces that go on alike."""
    kappa, sharp = pieces[:, kernel.KAPPA0], pieces[:, kernel.SHARPNESS]
    reached = kappa[:-1] + sharp[:-1] * sizes[:-1]
    # What differs in sharpness alone shows in the curvature after the next piece's length.
    bend = np.abs(np.diff(sharp)) * np.maximum(sizes[1:], sizes[:-1])
    joint = (np.abs(kappa[1:] - reached) > _SAME) | (bend > _SAME)
    return [*(np.flatnonzero(joint) + 1).tolist(), len(pieces)]


def _joined(pieces: FloatArray, sizes: FloatArray, first: int, last: int) -> list[Shape]:
    """The rows from ``first`` up to ``last`` as one shape, or as two where that is not so."""
    shape = _shape(pieces, sizes, first, last)
    if last - first == 1:
        return [shape]
    if shape.length <= _LONGEST:
        x, y, _ = end_pose([Segment(shape.length, *shape[3:])], shape.start)
        end = _shape(pieces, sizes, last - 1, last)
        there = end_pose([Segment(end.length, *end[3:])], end.start)
        if math.hypot(x - there.x, y - there.y) <= _APART:
            return [shape]
    middle = (first + last) // 2
    return _joined(pieces, sizes, first, middle) + _joined(pieces, sizes, middle, last)


def _shape(pieces: FloatArray, sizes: FloatArray, first: int, last: int) -> Shape:
    s, x, y, psi, kappa = (float(value) for value in pieces[first, :5])
    length = float(np.sum(sizes[first:last]))
    end = float(pieces[last - 1, kernel.KAPPA0])
    end += float(pieces[last - 1, kernel.SHARPNESS] * sizes[last - 1])
    return Shape(s, Pose(x, y, psi), length, *_plain(length, kappa, end))


def _plain(length: float, start: float, end: float) -> tuple[float, float]:
    """Both curvatures: equal, and zero, where that moves nothing by more than a micrometre.

    Equal but almost zero would be a very large arc: then they are as different as that allows.
    """
    if max(abs(start), abs(end)) <= min(2.0 * _APART / length**2, _JUMP):
        return 0.0, 0.0
    change = 6.0 * _APART / length**2
    if abs(end - start) > min(change, _JUMP):
        return start, end
    middle = (start + end) / 2.0
    if abs(middle) > _GENTLE:
        return middle, middle
    half = min(change, _APART_ENDS) / 2.0
    return middle - half, middle + half


def _part(shape: Shape, start: float, end: float) -> Shape:
    """The stretch of a shape between two distances from its beginning [m]."""
    sharp = (shape.kappa_end - shape.kappa_start) / shape.length
    low, high = (shape.kappa_start + sharp * u for u in (start, end))
    pose = shape.start
    if start > 0.0:
        pose = end_pose([Segment(start, shape.kappa_start, low)], pose)
    return Shape(shape.s + start, pose, end - start, *_plain(end - start, low, high))
