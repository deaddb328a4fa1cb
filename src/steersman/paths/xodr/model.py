"""A road network as OpenDRIVE describes it: what is needed to follow its lanes.

Angles in radians, lengths in metres, curvature left positive, all as in the file.
"""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import NamedTuple, TypeAlias

from steersman.errors import DataError

RIGHT, LEFT = -1, 1
Side: TypeAlias = int
"""Side of the reference line on which a lane lies, the sign of its number: RIGHT or LEFT."""


class Cubic(NamedTuple):
    """a + b u + c u^2 + d u^3, u counted from where it begins [m]."""

    s: float
    """Where it begins: on the road, or in its lane section [m]."""
    a: float
    b: float
    c: float
    d: float

    def moved(self, u: float) -> tuple[float, float, float, float]:
        """The coefficients for a count that begins ``u`` later."""
        _, a, b, c, d = self
        return (a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * u * d), c + 3 * u * d, d)


class ReferencePiece(NamedTuple):
    """A stretch of a reference line."""

    s: float
    """Where it begins on its road [m]."""
    x: float
    y: float
    psi: float
    length: float
    kind: str
    """line, arc, spiral, poly3 or paramPoly3."""
    figures: tuple[float, ...]
    """Both curvatures of the first three; a to d of v; a to d of u, then of v, and p's end."""
    line: int

    def fault(self, text: str) -> DataError:
        """The error to raise about its shape."""
        return DataError(f"line {self.line}: <{self.kind}>: {text}")


class Lane(NamedTuple):
    """A lane within one lane section."""

    number: int
    kind: str
    """OpenDRIVE's type of lane, e.g. driving."""
    width: tuple[Cubic, ...]
    """Width over the section."""
    border: tuple[Cubic, ...]
    """Its outer edge, left positive from the shifted centre, where it has no width."""
    before: tuple[int, ...]
    """Numbers of the lanes that it continues towards smaller s."""
    after: tuple[int, ...]
    """Numbers of the lanes that continue it towards larger s."""
    line: int


class LaneSection(NamedTuple):
    """A stretch of a road with the same lanes on one of its sides."""

    start: float
    end: float
    lanes: dict[int, Lane]


class Contact(NamedTuple):
    """What a road leads to at one of its ends."""

    junction: bool
    name: str
    """The other road's, or the junction's."""
    at_start: bool
    """Whether it is the other road's start that is met; without meaning for junctions."""


class Relief(NamedTuple):
    """Height and banking of a road over its length; each () where there is none."""

    height: tuple[Cubic, ...] = ()
    """Of the reference line [m]."""
    bank: tuple[Cubic, ...] = ()
    """Superelevation: the road turned about the reference line, left side up positive [rad]."""
    fall: tuple[tuple[Cubic, ...], tuple[Cubic, ...]] = ((), ())
    """Crossfall of the left and of the right side, falling outwards positive [rad]."""


class RoadRecord(NamedTuple):
    """A road."""

    name: str
    """OpenDRIVE's id."""
    length: float
    junction: bool
    """Whether it is a way through a junction."""
    forward: Side
    """The side whose lanes are driven towards larger s."""
    geometries: tuple[ReferencePiece, ...]
    offset: tuple[Cubic, ...]
    """Lane offset."""
    sections: dict[Side, tuple[LaneSection, ...]]
    before: Contact | None
    after: Contact | None
    relief: Relief
    line: int


class Connection(NamedTuple):
    """A way from a road into a junction."""

    incoming: str
    road: str
    """The road that is entered."""
    at_start: bool
    """Whether it is entered at its start."""
    lanes: dict[int, tuple[int, ...]]
    """Numbers of the lanes that are entered by that of the incoming road."""


class MapFault(NamedTuple):
    """What is wrong with a map somewhere, and what is left out for it."""

    road: str
    """The road's name; empty if it is none or belongs to none."""
    s: float | None
    """Where on it [m], if known."""
    text: str

    def __str__(self) -> str:
        """One line."""
        place = f"road {self.road!r}: " if self.road else ""
        where = "" if self.s is None else f"s = {self.s:.1f} m: "
        return f"{place}{where}{self.text}"


class RoadNetwork(NamedTuple):
    """Roads and junctions of one file."""

    file: FilePath
    sha256: str
    """Digest of the file."""
    roads: dict[str, RoadRecord]
    junctions: dict[str, tuple[Connection, ...]]
    left_out: tuple[MapFault, ...] = ()
    """Elements that could not be read, or not as they stand."""
