"""The two simplest paths: a straight and a circle."""

from __future__ import annotations

import math
from typing import Literal

from steersman.config import param, register
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, from_segments

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
