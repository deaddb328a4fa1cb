"""How the car moves now, and its errors from the road."""

from __future__ import annotations

from steersman.config import param, register
from steersman.features.base import Feature
from steersman.types import Observation


@register("feature", "v_x")
class LongitudinalVelocity(Feature):
    """Longitudinal velocity."""

    unit, sign, scale = "m/s", 1.0, 1.0 / 15.0

    def value(self, seen: Observation) -> float:
        """As sensed [m/s]."""
        return seen.v_x


@register("feature", "v_y")
class LateralVelocity(Feature):
    """Lateral velocity of the centre of mass, left positive."""

    unit, scale = "m/s", 0.5

    def value(self, seen: Observation) -> float:
        """As sensed [m/s]."""
        return seen.v_y


@register("feature", "yaw_rate")
class YawRate(Feature):
    """Yaw rate."""

    unit = "rad/s"

    def value(self, seen: Observation) -> float:
        """As sensed [rad/s]."""
        return seen.yaw_rate


@register("feature", "yaw_rate_error")
class YawRateError(Feature):
    """Yaw rate less that of the road, v_x times its curvature beside the vehicle."""

    unit, scale = "rad/s", 4.0

    def value(self, seen: Observation) -> float:
        """As sensed [rad/s]."""
        return seen.yaw_rate - seen.v_x * seen.curvature


@register("feature", "speed_across")
class SpeedAcross(Feature):
    """Speed away from the path to the left, for small angles: the rate of the lateral error."""

    unit = "m/s"

    def value(self, seen: Observation) -> float:
        """v_y + v_x times the heading error [m/s]."""
        return seen.v_y + seen.v_x * seen.heading_error


@register("feature", "steer")
class ActualSteering(Feature):
    """Actual normalised steering, which follows the command with delay and rate limit."""

    scale = 5.0

    def value(self, seen: Observation) -> float:
        """As sensed [-]."""
        return seen.steer


@register("feature", "lateral_error")
class LateralError(Feature):
    """Distance from the path, left positive."""

    unit = "m"

    def value(self, seen: Observation) -> float:
        """As sensed [m]."""
        return seen.lateral_error


@register("feature", "heading_error")
class HeadingError(Feature):
    """Yaw less the path's tangent."""

    unit, scale = "rad", 4.0

    def value(self, seen: Observation) -> float:
        """As sensed [rad]."""
        return seen.heading_error


@register("feature", "lateral_error_fine")
class FineLateralError(Feature):
    """Lateral error d on a scale that is fine near zero, d / (half + |d|)."""

    half: float = param(0.05, "m", "Error at half range.", gt=0)

    def value(self, seen: Observation) -> float:
        """In (-1, 1)."""
        return seen.lateral_error / (self.half + abs(seen.lateral_error))


@register("feature", "heading_error_fine")
class FineHeadingError(Feature):
    """Heading error on a scale that is fine near zero, as the lateral error's."""

    half: float = param(0.02, "rad", "Heading error at half range.", gt=0)

    def value(self, seen: Observation) -> float:
        """In (-1, 1)."""
        return seen.heading_error / (self.half + abs(seen.heading_error))
