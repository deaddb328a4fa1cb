"""The geometries of a road's reference line, as they stand in a file."""

from __future__ import annotations

from steersman.paths.segments import MAX_LENGTH
from steersman.paths.xodr.model import ReferencePiece
from steersman.paths.xodr.notes import MapNotes
from steersman.paths.xodr.xml import Node

_SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")
# How far the geometries of a road may end from where its length says [m], and as a share of it.
_SLACK, _SLACK_SHARE = 0.1, 1e-3


def reference_pieces(road: Node, notes: MapNotes) -> tuple[tuple[ReferencePiece, ...], float]:
    """The geometries of a road in the order of s, and how far it can be followed [m].

    That is its length, or the end of its geometries where they end before.

    Raises:
        DataError: a geometry cannot be read, or there is none where the road begins.
    """
    length = _length(road)
    nodes = road.down("planView", "geometry")
    rows = [row for row in map(_geometry, nodes) if row.length > 0.0]
    if not rows:
        raise road.fault("has no <planView> with a <geometry> that has a length")
    ordered = sorted(rows, key=lambda row: row.s)
    if ordered != rows:
        notes.add(road.fault("its geometries are not in the order of s"), "taken in that order")
    begin, end = ordered[0].s, ordered[-1].s + ordered[-1].length
    if begin > _SLACK:
        raise road.fault(f"its geometries begin at {begin:g} m")
    if abs(end - length) > max(_SLACK, _SLACK_SHARE * length):
        fault = road.fault(f"its geometries end at {end:g} m, its length is {length:g} m")
        length = min(end, length)
        notes.add(fault, f"what is beyond {length:g} m is left out")
    return tuple(ordered), length


def _length(node: Node) -> float:
    length = node.number("length", low=0.0)
    if length > MAX_LENGTH:
        raise node.fault(f"length is {length:g} m, the most is {MAX_LENGTH:g} m")
    return length


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
