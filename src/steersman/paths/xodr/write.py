"""Write a path as OpenDRIVE: one lane whose centre is the path.

Signs and units are OpenDRIVE's own: x, y in metres, heading in radians, counter-clockwise; the
same as ours. ASAM OpenDRIVE 1.4 is what CARLA reads.
"""

from __future__ import annotations

import itertools
import math
from xml.etree import ElementTree as ET

from steersman.kernels import path as kernel
from steersman.paths.xodr.shapes import Shape, cut, shapes
from steersman.protocols import Path

LANE_WIDTH = 4.0
"""Width of the lane [m]."""
SHOULDER = 2.0
"""Width of the shoulder on either side [m]."""
# CARLA's reader ends a closed road at its joint unless it is made of three (PR #7137 there).
_LEAST_ROADS = 3
_LONGEST_ROAD = 1000.0
_GEO = "+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
_DRIVING = -1


def opendrive(
    path: Path, name: str = "path", *, lane_width: float = LANE_WIDTH, shoulder: float = SHOULDER
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
        profile = ET.SubElement(road, "elevationProfile")
        _cubic(profile, "elevation", "s", 0.0)
        ET.SubElement(road, "lateralProfile")
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


def _cubic(parent: ET.Element, tag: str, where: str, value: float) -> None:
    """A polynomial that is constant, from the beginning on."""
    ET.SubElement(parent, tag, {where: "0.0", "a": repr(value), "b": "0.0", "c": "0.0", "d": "0.0"})
