"""Paths given by formulas: straight, circle, lemniscate and figure eight."""

from __future__ import annotations

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
