"""A feature of the observation and a term of the reward."""

from __future__ import annotations

import steersman as sm


@sm.register("feature", "lateral_acceleration_ahead")
class LateralAccelerationAhead(sm.Feature):
    """Lateral acceleration that the road asks for some waypoints ahead at the present speed."""

    unit, scale = "m/s^2", 0.2

    waypoints: int = sm.param(5, "-", "Waypoints ahead, with one more on either side.", ge=1)

    @property
    def reads(self) -> int:
        """One waypoint more than the one ahead."""
        return self.waypoints + 2

    def value(self, seen: sm.Observation) -> float:
        """v_x^2 times the curvature: the second difference over the squared distance [m/s^2]."""
        x = seen.preview[1, 0] - seen.preview[0, 0]
        y = seen.preview[1, 1] - seen.preview[0, 1]
        before = seen.preview[self.waypoints, 1] - seen.preview[self.waypoints - 1, 1]
        bend = seen.preview[self.waypoints + 1, 1] - seen.preview[self.waypoints, 1] - before
        return float(seen.v_x * seen.v_x * bend / (x * x + y * y))


@sm.register("reward", "calm")
class Calm(sm.RewardTerm):
    """Minus the squared lateral acceleration of the car beyond what the road asks for."""

    unit = "m^2/s^4"

    weight: float = sm.param(0.01, "s^4/m^2", "Factor on the term.", ge=0)

    def value(self, step: sm.Judged) -> float:
        """Weighted: v times the yaw rate less v^2 times the curvature, squared."""
        beyond = step.speed * (step.yaw_rate - step.speed * step.curvature)
        return -self.weight * beyond * beyond
