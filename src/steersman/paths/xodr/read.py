"""From the elements of an OpenDRIVE file (1.1 to 1.8) to the network of its roads."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path as FilePath

from steersman.errors import DataError
from steersman.paths.xodr.model import (
    LEFT,
    RIGHT,
    Connection,
    Contact,
    Cubic,
    Lane,
    LaneSection,
    Relief,
    RoadNetwork,
    RoadRecord,
    Side,
)
from steersman.paths.xodr.notes import MapNotes
from steersman.paths.xodr.pieces import reference_pieces
from steersman.paths.xodr.xml import Node, parse

# All lanes of a file together [m]: more would fill the memory.
_MOST_LANES = 1e7
_CONTACTS = {"start": True, "end": False}
_RULES = {"RHT": RIGHT, "LHT": LEFT}
# Heights [m], superelevation and crossfall [rad] of roads are less.
_HIGHEST, _STEEPEST = 1e4, 1.5
_YES = {"true": True, "1": True, "false": False, "0": False}


def read_network(file: FilePath) -> RoadNetwork:
    """The roads and junctions of a file; an element that cannot be read costs itself alone.

    Raises:
        DataError: nothing in the file can be used; one line says which element and what is wrong.
    """
    root, sha256 = parse(file)
    if root.tag != "OpenDRIVE":
        raise root.fault("this is no OpenDRIVE file, whose first element is <OpenDRIVE>")
    notes = MapNotes(file)
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
            notes.add(error, "this road is left out")
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
    return RoadNetwork(file, sha256, roads, junctions, notes.found)


def _lane_length(road: RoadRecord) -> float:
    rows = (section for sections in road.sections.values() for section in sections)
    return sum((section.end - section.start) * len(section.lanes) for section in rows)


def _road(node: Node, notes: MapNotes) -> RoadRecord:
    pieces, length = reference_pieces(node, notes)
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
        geometries=pieces,
        offset=_cubics(lanes.children("laneOffset"), "s"),
        sections=_sections(lanes, length, notes),
        before=before,
        after=after,
        relief=_relief(node, length, notes),
        line=node.line,
    )


def _relief(road: Node, length: float, notes: MapNotes) -> Relief:
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


def _contact(road: Node, name: str) -> Contact | None:
    found = next(iter(road.down("link", name)), None)
    if found is None:
        return None
    junction = found.choice("elementType", {"road": False, "junction": True}, "road")
    # Without a contact point nothing is known of the end that is met: the usual one.
    usual = "end" if name == "predecessor" else "start"
    at_start = found.choice("contactPoint", _CONTACTS, usual)
    return Contact(junction, found.get("elementId"), at_start)


def _cubics(nodes: Iterable[Node], where: str) -> tuple[Cubic, ...]:
    """Polynomials in the order of where they begin."""
    rows = [
        Cubic(node.number(where, low=0.0), *(node.number(name) for name in "abcd"))
        for node in nodes
    ]
    return tuple(sorted(rows, key=lambda row: row.s))


def _sections(lanes: Node, length: float, notes: MapNotes) -> dict[Side, tuple[LaneSection, ...]]:
    """Lane sections by side; a section may be valid for one side alone."""
    out: dict[Side, tuple[LaneSection, ...]] = {}
    for side, name in ((LEFT, "left"), (RIGHT, "right")):
        found: list[tuple[float, dict[int, Lane]]] = []
        for node in _in_order(lanes, side, notes):
            here = node.down(name, "lane")
            if not here and node.choice("singleSide", _YES, "false"):
                continue
            found.append((node.number("s", low=0.0), _lanes(here, side, notes)))
        ends = [*(start for start, _ in found[1:]), length]
        # An empty section stays: the links of its neighbours' lanes go through it.
        out[side] = tuple(
            LaneSection(min(start, length), min(end, length), numbers)
            for (start, numbers), end in zip(found, ends, strict=True)
        )
    return out


def _in_order(lanes: Node, side: Side, notes: MapNotes) -> list[Node]:
    """The lane sections of a road in the order of s."""
    nodes = lanes.children("laneSection")
    ordered = sorted(nodes, key=lambda node: node.number("s", low=0.0))
    if ordered != nodes and side == LEFT:  # told once
        notes.add(lanes.fault("its sections are not in the order of s"), "taken in that order")
    return ordered


def _lanes(nodes: list[Node], side: Side, notes: MapNotes) -> dict[int, Lane]:
    """Lanes by their numbers; where one is missing, nothing is known of those beyond it."""
    out: dict[int, Lane] = {}
    for node in nodes:
        lane = notes.without("this lane is", _lane, node, side, notes, default=None)
        if lane is not None and lane.number in out:
            fault = node.fault(f"id {lane.number} is there twice")
            notes.add(fault, "the second of them is left out")
        elif lane is not None:
            out[lane.number] = lane
    inner = 0
    while side * (inner + 1) in out:
        inner += 1
    for number in [number for number in out if abs(number) > inner]:
        fault = nodes[0].fault(f"lane {number} has no neighbour towards the middle")
        notes.add(fault, "it is left out")
        del out[number]
    return out


def _lane(node: Node, side: Side, notes: MapNotes) -> Lane:
    number = node.integer("id")
    if number * side <= 0:
        raise node.fault(f"id is {number}, on the wrong side")
    width = _cubics(node.children("width"), "sOffset")
    border = () if width else _cubics(node.children("border"), "sOffset")
    before, after = (
        notes.without("this link is", _lane_links, node, name, default=tuple[int, ...]())
        for name in ("predecessor", "successor")
    )
    return Lane(number, node.get("type", "none"), width, border, before, after, node.line)


def _lane_links(lane: Node, name: str) -> tuple[int, ...]:
    """Numbers of the lanes at one of its ends: several where it splits, or lanes become one."""
    return tuple(dict.fromkeys(found.integer("id") for found in lane.down("link", name)))


def _connection(node: Node) -> Connection | None:
    road = node.get("connectingRoad", "") or node.get("linkedRoad", "")
    incoming = node.get("incomingRoad", "")
    # Of a virtual junction, one or the other may be missing: it leads nowhere.
    if not road or not incoming:
        return None
    lanes: dict[int, tuple[int, ...]] = {}
    for link in node.children("laneLink"):
        number = link.integer("from")
        lanes[number] = (*lanes.get(number, ()), link.integer("to"))
    at_start = node.choice("contactPoint", _CONTACTS, "start")
    return Connection(incoming, road, at_start, lanes)
