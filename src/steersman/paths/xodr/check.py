"""What is wrong with a map, by road and place on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

from steersman.paths.xodr.joined import ROUNDED, TOLERANCE, Gap, gap
from steersman.paths.xodr.lane_line import Curve
from steersman.paths.xodr.lanes import Place
from steersman.paths.xodr.model import MapFault
from steersman.paths.xodr.ways import Ways


def faults(ways: Ways) -> list[MapFault]:
    """Elements that are left out, lanes that cannot be driven, joints that are none, kinks."""
    found = list(ways.network.left_out)
    for place in ways.graph.all():
        fault = ways.fault(place)
        found += [fault] if fault is not None else _joints(ways, place)
    return found


def _joints(ways: Ways, place: Place) -> Iterator[MapFault]:
    """Of a lane that can be driven: within it, and to those that its links lead to."""
    lane, line = f"lane {place.lane}", ways.line(place)
    for a, b in pairwise(line):
        yield from _kink(place, a, gap(a, b), lane)
    for other in ways.graph.after(place):
        if ways.fault(other) is not None:
            continue
        after: Sequence[Curve] = ways.line(other)
        if line and after:
            step = gap(line[-1], after[0])
            to = f"{lane} to lane {other.lane} of road {other.road!r}"
            yield from _kink(place, line[-1], step, to)


def _kink(place: Place, before: Curve, step: Gap, what: str) -> Iterator[MapFault]:
    s = float(before.s[-1])
    if not step.passable:
        yield MapFault(place.road, s, f"{what}: {step}")
    elif abs(step.kink) > ROUNDED:
        text = f"{what}: a kink of {step.kink:.2f} rad, rounded within {TOLERANCE} m"
        yield MapFault(place.road, s, text)
