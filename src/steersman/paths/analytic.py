"""Paths given by formulas: straight, circle, lemniscate, figure eight, double lane change."""

from __future__ import annotations

import itertools
import math
from typing import Literal

import numpy as np
from pydantic import model_validator

from steersman.config import param, register
from steersman.errors import ConfigError
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, end_pose, from_samples, from_segments, turned

Direction = Literal["left", "right"]


def sign(direction: Direction) -> float:
    """Sign of curvature and lateral offset: 1 to the left, -1 to the right."""
    return 1.0 if direction == "left" else -1.0


@register("path", "straight")
class Straight(PathComponent):
    """A straight line from the origin along +x."""

    distance: float = param(500.0, "m", "length of the line", ge=0.1, le=1e5)

    def build_table(self) -> PathTable:
        """One line segment."""
        return from_segments([Segment(self.distance, 0.0, 0.0)])


@register("path", "circle")
class Circle(PathComponent):
    """A full circle from the origin, starting along +x (ISO 4138 uses 50 m and 100 m)."""

    radius: float = param(50.0, "m", "radius", ge=0.1, le=1e5)
    direction: Direction = param("left", "-", "side to which the circle turns")

    def build_table(self) -> PathTable:
        """One closed arc."""
        kappa = sign(self.direction) / self.radius
        return from_segments([Segment(math.tau * self.radius, kappa, kappa)], closed=True)


_LOBE = 1.5 * math.pi
_LENGTH_PER_SIZE = 5.244115108584240  # Twice the lemniscate constant.
_SAMPLES = 512


@register("path", "lemniscate")
class Lemniscate(PathComponent):
    """Bernoulli's lemniscate; smallest radius size / 3, length 5.244 size.

    Starts at the crossing, where the curvature is zero, and turns left first.
    """

    size: float = param(50.0, "m", "half the width, from the crossing to a tip", ge=1.0, le=1e4)

    def build_table(self) -> PathTable:
        """Clothoids through points of x = a cos t / (1 + sin^2 t), y = x sin t."""
        # Pieces turn at most 0.1 rad (512 of them) and are at most 0.5 m long.
        quarter = max(_SAMPLES, math.ceil(2.0 * _LENGTH_PER_SIZE * self.size)) // 4 + 1
        t = -0.5 * math.pi + 2.0 * math.pi * np.arange(4 * quarter + 1) / (4 * quarter)
        sin, cos = np.sin(t), np.cos(t)
        x = self.size * cos / (1.0 + sin**2)
        x[0] = x[-1] = x[2 * quarter] = 0.0
        # The tangent of the lemniscate: dx/dt and dy/dt without their positive factor.
        psi = np.arctan2(cos**2 - sin**2 - sin**4 - (sin * cos) ** 2, -sin * (3.0 - sin**2))
        return from_samples(x, x * sin, psi, closed=True)


@register("path", "figure_eight")
class FigureEight(PathComponent):
    """Two loops of arcs and clothoids that cross at a right angle; curvature-continuous.

    Starts at the crossing along +x on a straight; the first loop turns left.
    """

    radius: float = param(25.0, "m", "radius of the arcs", ge=1.0, le=1e4)
    clothoid: float = param(15.0, "m", "length of each clothoid", ge=0.1, le=1e4)

    @model_validator(mode="after")
    def _check(self) -> FigureEight:
        if self.clothoid / self.radius >= _LOBE:
            raise ConfigError(
                f"clothoid {self.clothoid} m leaves no arc of radius {self.radius} m;"
                f" it must be shorter than {_LOBE * self.radius:.6g} m"
            )
        return self

    def segments(self) -> list[Segment]:
        """Half straight, loop to the left, straight, loop to the right, half straight."""
        k, size = 1.0 / self.radius, self.clothoid
        arc = (_LOBE - 2.0 * turned(size, 0.0, k)) / k
        loop = [Segment(size, 0.0, k), Segment(arc, k, k), Segment(size, k, 0.0)]
        # From (0, 0) along +x the loop ends, heading along -y, at (-h, h); straights of h before
        # and after it close it.
        end = end_pose(loop)
        half = 0.5 * (end.y - end.x)
        mirrored = [Segment(s.length, -s.kappa_start, -s.kappa_end) for s in loop]
        straight = Segment(half, 0.0, 0.0)
        return [straight, *loop, Segment(2.0 * half, 0.0, 0.0), *mirrored, straight]

    def build_table(self) -> PathTable:
        """All segments, closed."""
        return from_segments(self.segments(), closed=True)


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
    size = along / end_pose(_there_and_back(1.0, high)).x
    return _there_and_back(size, math.copysign(high / size, offset))


def _there_and_back(size: float, k: float) -> list[Segment]:
    """Clothoids of ``size`` [m] to curvatures of k [1/m], 0, -k and 0; heading k size between."""
    bends = (0.0, k, 0.0, -k, 0.0)
    return [Segment(size, start, end) for start, end in itertools.pairwise(bends)]


def _slope(steepest: float) -> float:
    """Offset divided by the way along the road."""
    end = end_pose(_there_and_back(1.0, steepest))
    return end.y / end.x
