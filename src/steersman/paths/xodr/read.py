"""From the elements of an OpenDRIVE file (1.1 to 1.8) to the network of its roads."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path as FilePath
from typing import Any, TypeVar

from steersman.errors import DataError
from steersman.paths.segments import MAX_LENGTH
from steersman.paths.xodr.model import (
    LEFT,
    RIGHT,
    Connection,
    Contact,
    Cubic,
    Lane,
    LaneSection,
    MapFault,
    ReferencePiece,
    Relief,
    RoadNetwork,
    RoadRecord,
    Side,
)
from steersman.paths.xodr.xml import Node, parse

T = TypeVar("T")
_SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")
# How far the geometries of a road may end from where its length says [m], and as a share of it.
_SLACK, _SLACK_SHARE = 0.1, 1e-3
# All lanes of a file together [m]: more would fill the memory.
_MOST_LANES = 1e7
# Lines about what cannot be read.
_MOST_NOTES = 1000
_CONTACTS = {"start": True, "end": False}
_RULES = {"RHT": RIGHT, "LHT": LEFT}
# Heights [m], superelevation and crossfall [rad] of roads are less.
_HIGHEST, _STEEPEST = 1e4, 1.5
_YES = {"true": True, "1": True, "false": False, "0": False}


class _Notes:
    """Elements that cannot be read: each costs itself, and leaves a line."""

    def __init__(self, file: FilePath) -> None:
        self.file, self.road, self.found, self.more = file, "", list[MapFault](), 0

    def without(self, what: str, read: Callable[..., T], *words: Any, default: T) -> T:
        """What ``read`` makes of ``words``; if it raises, ``default`` and a line."""
        try:
            return read(*words)
        except DataError as error:
            self.add(error, what)
            return default

    def add(self, error: DataError, what: str) -> None:
        if len(self.found) >= _MOST_NOTES:
            self.more += 1
            return
        text = str(error).removeprefix(f"{self.file}: ")
        self.found.append(MapFault(self.road, None, f"{text}; {what} left out"))


def read_network(file: FilePath) -> RoadNetwork:
    """The roads and junctions of a file; an element that cannot be read costs itself alone.

    Raises:
        DataError: nothing in the file can be used; one line says which element and what is wrong.
    """
    root, sha256 = parse(file)
    if root.tag != "OpenDRIVE":
        raise root.fault("this is no OpenDRIVE file, whose first element is <OpenDRIVE>")
    notes = _Notes(file)
    roads: dict[str, RoadRecord] = {}
    first: DataError | None = None
    for node in root.children("road"):
        notes.road = node.get("id", "")
        try:
            road = _road(node, notes)
            if road.name in roads:
                line = roads[road.name].line
                raise node.fault(f"id {road.name!r} is that of the road in line {line} too")
            roads[road.name] = road
        except DataError as error:
            first = first or error
            notes.add(error, "this road is")
    if not roads:
        raise first or root.fault("holds no road")
    total = sum(_lane_length(road) for road in roads.values())
    if total > _MOST_LANES:
        raise root.fault(f"its lanes are {total:.3g} m long, the most is {_MOST_LANES:.0g} m")
    notes.road = ""
    junctions = dict[str, tuple[Connection, ...]]()
    for node in root.children("junction"):
        name = notes.without("this junction is", node.get, "id", default="")
        found = (
            notes.without("this connection is", _connection, each, default=None)
            for each in node.children("connection")
        )
        junctions[name] = tuple(each for each in found if each is not None)
    if notes.more:
        notes.found.append(MapFault("", None, f"{notes.more} more elements left out"))
    return RoadNetwork(file, sha256, roads, junctions, tuple(notes.found))


def _lane_length(road: RoadRecord) -> float:
    rows = (section for sections in road.sections.values() for section in sections)
    return sum((section.end - section.start) * len(section.lanes) for section in rows)


def _road(node: Node, notes: _Notes) -> RoadRecord:
    length = _length(node)
    before, after = (
        notes.without("this link is", _contact, node, name, default=None)
        for name in ("predecessor", "successor")
    )
    lanes = node.child("lanes")
    if lanes is None:
        raise node.fault("has no <lanes>")
    return RoadRecord(
        name=node.get("id"),
        length=length,
        junction=node.get("junction", "-1") != "-1",
        forward=notes.without("it is", node.choice, "rule", _RULES, "RHT", default=RIGHT),
        geometries=_geometries(node, length),
        offset=_cubics(lanes.children("laneOffset"), "s"),
        sections=_sections(lanes, length, notes),
        before=before,
        after=after,
        relief=_relief(node, length, notes),
        line=node.line,
    )


def _relief(road: Node, length: float, notes: _Notes) -> Relief:
    """Heights and banking; those of a kind in which one cannot be read are left out together."""

    def read(what: str, most: float, *names: str, side: str = "both") -> tuple[Cubic, ...]:
        nodes = [n for n in road.down(*names) if n.get("side", "both") in {side, "both"}]
        return notes.without(f"{what} is", _bounded, nodes, length, most, default=())

    left, right = (
        read("crossfall", _STEEPEST, "lateralProfile", "crossfall", side=side)
        for side in ("left", "right")
    )
    return Relief(
        read("the road's height", _HIGHEST, "elevationProfile", "elevation"),
        read("superelevation", _STEEPEST, "lateralProfile", "superelevation"),
        (left, right),
    )


def _bounded(nodes: list[Node], length: float, most: float) -> tuple[Cubic, ...]:
    """Polynomials of s that can be no more than ``most``, up or down, on the road."""
    rows = _cubics(nodes, "s")
    for k, row in enumerate(rows):
        span = max((rows[k + 1].s if k + 1 < len(rows) else length) - row.s, 0.0)
        if abs(row.a) + span * (abs(row.b) + span * (abs(row.c) + span * abs(row.d))) > most:
            raise nodes[0].fault(f"the {nodes[0].tag} from s = {row.s:g} m on is beyond {most:g}")
    return rows


def _length(node: Node) -> float:
    length = node.number("length", low=0.0)
    if length > MAX_LENGTH:
        raise node.fault(f"length is {length:g} m, the most is {MAX_LENGTH:g} m")
    return length


def _contact(road: Node, name: str) -> Contact | None:
    found = next(iter(road.down("link", name)), None)
    if found is None:
        return None
    junction = found.choice("elementType", {"road": False, "junction": True}, "road")
    # Without a contact point nothing is known of the end that is met: the usual one.
    usual = "end" if name == "predecessor" else "start"
    at_start = found.choice("contactPoint", _CONTACTS, usual)
    return Contact(junction, found.get("elementId"), at_start)


def _geometries(road: Node, length: float) -> tuple[ReferencePiece, ...]:
    rows: list[ReferencePiece] = []
    for node in road.down("planView", "geometry"):
        row = _geometry(node)
        if rows and row.s < rows[-1].s:
            raise node.fault(f"s is {row.s:g}, less than the {rows[-1].s:g} before it")
        if row.length > 0.0:
            rows.append(row)
    if not rows:
        raise road.fault("has no <planView> with a <geometry> that has a length")
    end = rows[-1].s + rows[-1].length
    if rows[0].s > _SLACK or abs(end - length) > max(_SLACK, _SLACK_SHARE * length):
        raise road.fault(
            f"its geometries reach from {rows[0].s:g} m to {end:g} m, its length is {length:g} m"
        )
    return tuple(rows)


def _geometry(node: Node) -> ReferencePiece:
    shape = next(iter(node.children(*_SHAPES)), None)
    if shape is None:
        raise node.fault(f"holds none of {', '.join(_SHAPES)}")
    length = _length(node)
    x, y, psi = (node.number(name) for name in ("x", "y", "hdg"))
    s = node.number("s", low=0.0)
    return ReferencePiece(s, x, y, psi, length, shape.tag, _figures(shape, length), node.line)


def _figures(shape: Node, length: float) -> tuple[float, ...]:
    if shape.tag == "line":
        return (0.0, 0.0)
    if shape.tag == "arc":
        return (shape.number("curvature"),) * 2
    if shape.tag == "spiral":
        return (shape.number("curvStart"), shape.number("curvEnd"))
    if shape.tag == "poly3":
        return tuple(shape.number(name) for name in "abcd")
    end = shape.choice("pRange", {"arcLength": length, "normalized": 1.0}, "normalized")
    return (*(shape.number(f"{name}{axis}") for axis in "UV" for name in "abcd"), end)


def _cubics(nodes: Iterable[Node], where: str) -> tuple[Cubic, ...]:
    """Polynomials in the order of where they begin."""
    rows = [
        Cubic(node.number(where, low=0.0), *(node.number(name) for name in "abcd"))
        for node in nodes
    ]
    return tuple(sorted(rows, key=lambda row: row.s))


def _sections(lanes: Node, length: float, notes: _Notes) -> dict[Side, tuple[LaneSection, ...]]:
    """Lane sections by side; a section may be valid for one side alone."""
    out: dict[Side, tuple[LaneSection, ...]] = {}
    for side, name in ((LEFT, "left"), (RIGHT, "right")):
        found: list[tuple[float, dict[int, Lane]]] = []
        for node in lanes.children("laneSection"):
            here = node.down(name, "lane")
            if not here and node.choice("singleSide", _YES, "false"):
                continue
            start = node.number("s", low=0.0)
            if found and start < found[-1][0]:
                raise node.fault(f"s is {start:g}, less than the {found[-1][0]:g} before it")
            found.append((start, _lanes(here, side, notes)))
        ends = [*(start for start, _ in found[1:]), length]
        # An empty section stays: the links of its neighbours' lanes go through it.
        out[side] = tuple(
            LaneSection(min(start, length), min(end, length), numbers)
            for (start, numbers), end in zip(found, ends, strict=True)
        )
    return out


def _lanes(nodes: list[Node], side: Side, notes: _Notes) -> dict[int, Lane]:
    """Lanes by their numbers; where one is missing, nothing is known of those beyond it."""
    out: dict[int, Lane] = {}
    for node in nodes:
        lane = notes.without("this lane is", _lane, node, side, notes, default=None)
        if lane is not None and lane.number in out:
            fault = node.fault(f"id {lane.number} is there twice")
            notes.add(fault, "the second of them is")
        elif lane is not None:
            out[lane.number] = lane
    inner = 0
    while side * (inner + 1) in out:
        inner += 1
    for number in [number for number in out if abs(number) > inner]:
        fault = nodes[0].fault(f"lane {number} has no neighbour towards the middle")
        notes.add(fault, "it is")
        del out[number]
    return out


def _lane(node: Node, side: Side, notes: _Notes) -> Lane:
    number = node.integer("id")
    if number * side <= 0:
        raise node.fault(f"id is {number}, on the wrong side")
    width = _cubics(node.children("width"), "sOffset")
    border = () if width else _cubics(node.children("border"), "sOffset")
    before, after = (
        notes.without("this link is", _lane_link, node, name, default=None)
        for name in ("predecessor", "successor")
    )
    return Lane(number, node.get("type", "none"), width, border, before, after, node.line)


def _lane_link(lane: Node, name: str) -> int | None:
    found = next(iter(lane.down("link", name)), None)
    return None if found is None else found.integer("id")


def _connection(node: Node) -> Connection | None:
    road = node.get("connectingRoad", "") or node.get("linkedRoad", "")
    incoming = node.get("incomingRoad", "")
    # Of a virtual junction, one or the other may be missing: it leads nowhere.
    if not road or not incoming:
        return None
    lanes = {link.integer("from"): link.integer("to") for link in node.children("laneLink")}
    at_start = node.choice("contactPoint", _CONTACTS, "start")
    return Connection(incoming, road, at_start, lanes)
