"""Closed tracks that come with the package as tables of segments."""

from __future__ import annotations

import csv
import math
from abc import abstractmethod
from importlib.resources import files

from steersman.config import param, register
from steersman.kernels.path import PathTable
from steersman.paths.base import Corner, PathComponent
from steersman.paths.segments import ORIGIN, Segment, from_segments

_PLAIN = "straight"


def read_segments(name: str) -> list[Segment]:
    """The packaged table ``name``: length, curvature at both ends, name of each segment."""
    text = files("steersman.paths").joinpath("data", f"{name}.csv").read_text(encoding="utf-8")
    return [
        Segment(float(length), float(start), float(end), label)
        for length, start, end, label in list(csv.reader(text.splitlines()))[1:]
    ]


class Track(PathComponent):
    """A packaged closed track, which starts at the origin along +x (reversed: along -x)."""

    reverse: bool = param(False, "-", "drive the other way round")
    mirror: bool = param(False, "-", "swap left and right: y becomes -y")

    @abstractmethod
    def source(self) -> list[Segment]:
        """The segments as they are packaged."""

    def segments(self) -> list[Segment]:
        """The segments as they are driven."""
        rows = self.source()
        if self.reverse:
            rows = [Segment(s.length, -s.kappa_end, -s.kappa_start, s.name) for s in rows[::-1]]
        if self.mirror:
            rows = [Segment(s.length, -s.kappa_start, -s.kappa_end, s.name) for s in rows]
        if self.reverse != self.mirror:
            rows = [s._replace(name=_other_side(s.name)) for s in rows]
        return rows

    def build_table(self) -> PathTable:
        """All segments, closed."""
        start = ORIGIN._replace(psi=math.pi) if self.reverse else ORIGIN
        return from_segments(self.segments(), closed=True, start=start)

    def corners(self) -> list[Corner]:
        """Named stretches; neighbours of the same name, or with a straight between, are one."""
        out: list[Corner] = []
        s = 0.0
        for segment in self.segments():
            if segment.name == _PLAIN:
                s += segment.length
                continue
            if out and out[-1].name == segment.name:
                out[-1] = out[-1]._replace(s_end=s + segment.length)
            else:
                out.append(Corner(segment.name, s, s + segment.length))
            s += segment.length
        return out


@register("path", "training_circuit")
class TrainingCircuit(Track):
    """1502 m of straights, soft (R 90-200 m) and sharp (R 15-30 m) corners; counter-clockwise."""

    def source(self) -> list[Segment]:
        """The segments as they are packaged."""
        return read_segments("training_circuit")


@register("path", "monza")
class Monza(Track):
    """Monza's centre line, 5793 m, clockwise.

    Fitted to public geometry: OpenStreetMap contributors / TUMFTM racetrack database.
    """

    def source(self) -> list[Segment]:
        """The segments as they are packaged."""
        return read_segments("monza")


def _other_side(name: str) -> str:
    swap = {"left": "right", "right": "left"}
    return " ".join(swap.get(word, word) for word in name.split(" "))
