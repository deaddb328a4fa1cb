"""The road ahead: waypoints, curvatures, and the accelerations that they ask for."""

from __future__ import annotations

from steersman.config import param, register
from steersman.features.base import Feature, Loop
from steersman.types import Observation


@register("feature", "waypoints")
class Waypoints(Feature):
    """Waypoints ahead, x and y of each in the vehicle's frame."""

    unit = "m"
    count: int = param(15, "-", "Waypoints, from the one beside the vehicle on.", ge=1, le=1000)

    @property
    def size(self) -> int:
        """Two numbers for each."""
        return 2 * self.count

    @property
    def reads(self) -> int:
        """All of them."""
        return self.count

    def label(self, i: int, spacing: float) -> str:
        """Number and axis."""
        return f"waypoint_{i // 2}_{'xy'[i % 2]} [m]"

    def factor(self, i: int, spacing: float) -> float:
        """One over the preview's length for x, four times as much for y."""
        reach = max(self.count - 1, 1) * spacing
        return (4.0 if i % 2 else 1.0) / reach

    def mirrored(self, i: int) -> float:
        """Only y changes its sign."""
        return -1.0 if i % 2 else 1.0

    def value(self, seen: Observation, i: int) -> float:
        """X or y [m]."""
        return float(seen.preview[i // 2, i % 2])


@register("feature", "road_curvatures")
class RoadCurvatures(Feature):
    """Curvature of the road beside the vehicle, then its mean over 2, 4, ... waypoints ahead.

    Twice the road's offset from its tangent beside the vehicle, over the squared distance. The
    tangent follows from the sensed heading error, so these features hold the road's shape and not
    the vehicle's own error (small angles).
    """

    unit, scale = "1/m", 20.0
    count: int = param(7, "-", "Curvatures.", ge=1, le=1000)

    @property
    def size(self) -> int:
        """One number for each."""
        return self.count

    @property
    def reads(self) -> int:
        """Every second waypoint."""
        return 2 * self.count - 1

    def label(self, i: int, spacing: float) -> str:
        """The distance over which it is the mean."""
        return f"road_curvature_{2 * i * spacing:g}m [1/m]"

    def value(self, seen: Observation, loop: Loop, i: int) -> float:
        """Mean curvature [1/m]."""
        if i == 0:
            return seen.curvature
        u = 2 * i * loop.spacing
        ahead = seen.preview[2 * i, 0] - seen.preview[0, 0]
        offset = seen.preview[2 * i, 1] - seen.preview[0, 1] + seen.heading_error * ahead
        return float(2.0 * offset / (u * u))


@register("feature", "road_accelerations")
class RoadAccelerations(RoadCurvatures):
    """Lateral acceleration that the road asks for at the present speed: ``road_curvatures`` v^2."""

    unit, scale = "m/s^2", 0.1

    def label(self, i: int, spacing: float) -> str:
        """The distance over which it is the mean."""
        return f"road_acceleration_{2 * i * spacing:g}m [m/s^2]"

    def value(self, seen: Observation, loop: Loop, i: int) -> float:
        """Mean curvature times v_x^2 [m/s^2]."""
        square = seen.v_x * seen.v_x
        if i == 0:
            return square * seen.curvature
        u = 2 * i * loop.spacing
        ahead = seen.preview[2 * i, 0] - seen.preview[0, 0]
        offset = seen.preview[2 * i, 1] - seen.preview[0, 1] + seen.heading_error * ahead
        return float(square * 2.0 * offset / (u * u))
