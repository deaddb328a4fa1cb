"""Write a path as OpenDRIVE: one lane whose centre is the path, in as few shapes as possible.

Signs and units are OpenDRIVE's own: x, y in metres, heading in radians, counter-clockwise; the
same as ours. ASAM OpenDRIVE 1.4 is what CARLA reads.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from steersman.kernels import path as kernel
from steersman.kernels.path import PathTable
from steersman.paths.segments import Segment, end_pose
from steersman.protocols import Path
from steersman.types import FloatArray, Pose, Surface

LANE_WIDTH = 4.0
"""Width of the lane [m]."""
SHOULDER = 2.0
"""Width of the shoulder on either side [m]."""
# CARLA's reader ends a closed road at its joint unless it is made of three (PR #7137 there).
_LEAST_ROADS = 3
_LONGEST_ROAD = 1000.0
_GEO = "+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
_DRIVING = -1
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
# Distance between records of height and superelevation, at most [m].
_RELIEF = 5.0
# The longer such a spiral, the farther off is the place where its curvature would be zero, from
# which readers count; up to this length [m] double precision has figures enough.
_LONGEST = 500.0


def opendrive(
    path: Path,
    name: str = "path",
    *,
    lane_width: float = LANE_WIDTH,
    shoulder: float = SHOULDER,
    surface: Surface | None = None,
) -> str:
    """The path as the text of an OpenDRIVE file.

    Lane -1 is the driving lane: a lane offset of half its width puts its centre on the reference
    line, which is the path. On both sides lies a shoulder, on which a car is still on the ground.
    A closed path is three roads or more, linked in a ring; their lanes are linked too.

    Args:
        path: any path of ours.
        name: of the map and its roads.
        lane_width: [m].
        shoulder: width on either side [m]; 0 for none.
        surface: height and banking of the road; None: it is flat.
    """
    row = shapes(path.table)
    least = _LEAST_ROADS if path.closed else 1
    count = max(least, math.ceil(path.length / _LONGEST_ROAD))
    ends = [path.length * i / count for i in range(count + 1)]
    root = ET.Element("OpenDRIVE")
    _header(root, path, name)
    for i, (start, end) in enumerate(itertools.pairwise(ends)):
        road = ET.SubElement(
            root, "road", name=name, length=repr(end - start), id=str(i + 1), junction="-1"
        )
        _links(road, i, count, path.closed)
        _plan_view(road, cut(row, start, end))
        _profiles(road, surface, start, end)
        _lanes(road, lane_width, shoulder)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _header(root: ET.Element, path: Path, name: str) -> None:
    """No date: the same path gives the same file."""
    x, y = path.table.pieces[:, kernel.X0], path.table.pieces[:, kernel.Y0]
    header = ET.SubElement(root, "header", revMajor="1", revMinor="4", name=name, version="1.00")
    sides = {"north": y.max(), "south": y.min(), "east": x.max(), "west": x.min()}
    for side, value in sides.items():
        header.set(side, repr(float(value)))
    header.set("vendor", "Steersman")
    ET.SubElement(header, "geoReference").text = _GEO


def _links(road: ET.Element, i: int, count: int, closed: bool) -> None:
    link = ET.SubElement(road, "link")
    if closed or i > 0:
        _link(link, "predecessor", (i - 1) % count, "end")
    if closed or i < count - 1:
        _link(link, "successor", (i + 1) % count, "start")


def _link(link: ET.Element, side: str, other: int, contact: str) -> None:
    ET.SubElement(link, side, elementType="road", elementId=str(other + 1), contactPoint=contact)


def _plan_view(road: ET.Element, row: list[Shape]) -> None:
    view = ET.SubElement(road, "planView")
    for shape in row:
        geometry = ET.SubElement(view, "geometry", s=repr(shape.s))
        for key, value in zip(("x", "y", "hdg"), shape.start, strict=True):
            geometry.set(key, repr(value))
        geometry.set("length", repr(shape.length))
        # A spiral that does not change its curvature makes CARLA answer with NaN.
        if shape.kappa_start != shape.kappa_end:
            bounds = {"curvStart": repr(shape.kappa_start), "curvEnd": repr(shape.kappa_end)}
            ET.SubElement(geometry, "spiral", bounds)
        elif shape.kappa_start != 0.0:
            ET.SubElement(geometry, "arc", curvature=repr(shape.kappa_start))
        else:
            ET.SubElement(geometry, "line")


def _profiles(road: ET.Element, surface: Surface | None, start: float, end: float) -> None:
    """Height and superelevation between two places on the path, by cubic splines."""
    from scipy.interpolate import CubicSpline  # it takes a while to import

    height, lateral = (ET.SubElement(road, f"{name}Profile") for name in ("elevation", "lateral"))
    if surface is None:
        _cubic(height, "elevation", "s", 0.0)
        return
    s = np.linspace(0.0, end - start, math.ceil((end - start) / _RELIEF) + 1)
    values = np.array([surface.at(start + each) for each in s])
    for parent, tag, column in ((height, "elevation", 0), (lateral, "superelevation", 1)):
        for at, row in zip(s, CubicSpline(s, values[:, column]).c.T[:, ::-1], strict=False):
            _cubic(parent, tag, "s", *row.tolist(), at=float(at))


def _lanes(road: ET.Element, width: float, shoulder: float) -> None:
    lanes = ET.SubElement(road, "lanes")
    _cubic(lanes, "laneOffset", "s", width / 2.0)
    section = ET.SubElement(lanes, "laneSection", s="0.0")
    if shoulder > 0.0:
        _lane(ET.SubElement(section, "left"), 1, "shoulder", shoulder)
    _lane(ET.SubElement(section, "center"), 0, "none", 0.0)
    right = ET.SubElement(section, "right")
    _lane(right, _DRIVING, "driving", width)
    if shoulder > 0.0:
        _lane(right, _DRIVING - 1, "shoulder", shoulder)


def _lane(side: ET.Element, number: int, kind: str, width: float) -> None:
    lane = ET.SubElement(side, "lane", id=str(number), type=kind, level="false")
    if number != 0:
        link = ET.SubElement(lane, "link")
        ET.SubElement(link, "predecessor", id=str(number))
        ET.SubElement(link, "successor", id=str(number))
        _cubic(lane, "width", "sOffset", width)
    mark = ET.SubElement(lane, "roadMark", sOffset="0.0")
    mark.set("type", "solid" if number in {0, _DRIVING} else "none")
    for key, value in (("weight", "standard"), ("color", "standard"), ("width", "0.12")):
        mark.set(key, value)


def _cubic(
    parent: ET.Element, tag: str, where: str, a: float, *more: float, at: float = 0.0
) -> None:
    """A polynomial of the distance from where it begins; without ``more``, a constant."""
    values = dict(zip("abcd", (a, *more, 0.0, 0.0, 0.0), strict=False))
    ET.SubElement(parent, tag, {where: repr(at), **{k: repr(v) for k, v in values.items()}})


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
