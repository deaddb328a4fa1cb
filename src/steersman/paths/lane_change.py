"""The double lane change of ISO 3888-1 as one smooth path."""

from __future__ import annotations

import math

from pydantic import model_validator

from steersman.config import param, register
from steersman.errors import ConfigError
from steersman.kernels.path import PathTable
from steersman.paths.analytic import Direction, sign
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, end_pose, from_segments

# Beyond about 75 degrees in the middle the lane change would turn back on itself.
_STEEPEST = 1.3
_BISECTIONS = 60


@register("path", "double_lane_change")
class DoubleLaneChange(PathComponent):
    """Out to the next lane and back (ISO 3888-1), from the origin along +x; open.

    The defaults are the standard's sections and its offset between the lanes' centres, which do
    not depend on the vehicle's width. Each change of lane is four equally long clothoids.
    """

    entry: float = param(15.0, "m", "straight before", ge=0.1, le=1e4)
    out: float = param(30.0, "m", "way along the road to change to the other lane", ge=1.0, le=1e4)
    beside: float = param(25.0, "m", "straight in the other lane", ge=0.1, le=1e4)
    back: float = param(25.0, "m", "way along the road to change back", ge=1.0, le=1e4)
    exit: float = param(30.0, "m", "straight after", ge=0.1, le=1e4)
    offset: float = param(3.5, "m", "distance between the lanes", ge=0.01, le=1e3)
    direction: Direction = param("left", "-", "side of the first lane change")

    @model_validator(mode="after")
    def _check(self) -> DoubleLaneChange:
        shortest = min(self.out, self.back)
        if _slope(_STEEPEST) * shortest < self.offset:
            raise ConfigError(
                f"offset {self.offset} m is too much for a lane change over {shortest} m;"
                f" the most is {_slope(_STEEPEST) * shortest:.4g} m"
            )
        return self

    def segments(self) -> list[Segment]:
        """Straight, lane change, straight, lane change back, straight."""
        side = sign(self.direction)
        return [
            Segment(self.entry, 0.0, 0.0),
            *lane_change(self.out, side * self.offset),
            Segment(self.beside, 0.0, 0.0),
            *lane_change(self.back, -side * self.offset),
            Segment(self.exit, 0.0, 0.0),
        ]

    def build_table(self) -> PathTable:
        """All segments, open."""
        return from_segments(self.segments())


def lane_change(along: float, offset: float) -> list[Segment]:
    """Four clothoids of one length that move ``offset`` aside (left positive) in ``along``."""
    low, high = 0.0, _STEEPEST
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if _slope(middle) < abs(offset) / along:
            low = middle
        else:
            high = middle
    # The shape depends only on the steepest heading; its size follows from the way along.
    size = along / end_pose(_unit(high)).x
    kappa = math.copysign(high / size, offset)
    return [
        Segment(size, 0.0, kappa),
        Segment(size, kappa, 0.0),
        Segment(size, 0.0, -kappa),
        Segment(size, -kappa, 0.0),
    ]


def _unit(steepest: float) -> list[Segment]:
    """A lane change of clothoids of 1 m that reaches heading ``steepest`` in its middle."""
    k = steepest
    return [
        Segment(1.0, 0.0, k),
        Segment(1.0, k, 0.0),
        Segment(1.0, 0.0, -k),
        Segment(1.0, -k, 0.0),
    ]


def _slope(steepest: float) -> float:
    """Offset divided by the way along the road."""
    end = end_pose(_unit(steepest))
    return end.y / end.x
