"""A stadium: two straights and two bends, with clothoids between them."""

from __future__ import annotations

import math

from pydantic import model_validator

from steersman.config import param, register
from steersman.errors import ConfigError
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, from_segments


@register("path", "stadium")
class Stadium(PathComponent):
    """A closed track of two straights and two half turns to the left."""

    straight: float = param(100.0, "m", "length of each straight", ge=1.0, le=1e4)
    radius: float = param(30.0, "m", "radius of the bends", ge=1.0, le=1e4)
    clothoid: float = param(20.0, "m", "length of each transition", ge=0.1, le=1e4)

    @model_validator(mode="after")
    def _check(self) -> Stadium:
        longest = math.pi * self.radius
        if self.clothoid >= longest:
            raise ConfigError(
                f"clothoid {self.clothoid} m leaves no arc of radius {self.radius} m;"
                f" it must be shorter than {longest:.6g} m"
            )
        return self

    def build_table(self) -> PathTable:
        """Each clothoid turns by half its length over the radius; the arc by what is left."""
        k = 1.0 / self.radius
        half = [
            Segment(self.straight, 0.0, 0.0),
            Segment(self.clothoid, 0.0, k),
            Segment(math.pi / k - self.clothoid, k, k),
            Segment(self.clothoid, k, 0.0),
        ]
        return from_segments([*half, *half], closed=True)
