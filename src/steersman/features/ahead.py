"""The car ahead in the own lane, where there is one."""

from __future__ import annotations

from steersman.config import param, register
from steersman.features.base import Feature, Loop


@register("feature", "gap")
class GapAhead(Feature):
    """Distance to the car ahead along the road, bumper to bumper."""

    unit, sign, scale, lead = "m", 1.0, 1.0 / 40.0, True
    reach: float = param(120.0, "m", "Largest value: a car farther ahead is as far.", gt=0)

    def value(self, loop: Loop) -> float:
        """As it is, at most ``reach`` [m]."""
        return min(loop.gap, self.reach)


@register("feature", "relative_speed")
class RelativeSpeed(Feature):
    """Speed of the car ahead less the own one; negative while the gap closes."""

    unit, sign, scale, lead = "m/s", 1.0, 0.3, True
    reach: float = param(120.0, "m", "A car farther ahead than this is as fast as the own.", gt=0)

    def value(self, loop: Loop) -> float:
        """The difference [m/s]."""
        return loop.relative_speed if loop.gap < self.reach else 0.0


@register("feature", "time_to_collision")
class TimeToCollision(Feature):
    """Inverse time to collision at constant speeds, 1/TTC; 0 while the gap does not close."""

    unit, sign, scale, lead = "1/s", 1.0, 2.0, True
    least: float = param(1.0, "m", "Least gap that it is computed with.", gt=0)

    def value(self, loop: Loop) -> float:
        """Closing speed over gap [1/s]."""
        return max(-loop.relative_speed, 0.0) / max(loop.gap, self.least)


@register("feature", "gap_error")
class GapError(Feature):
    """Gap less the one that is wished at the own speed."""

    unit, sign, scale, lead = "m", 1.0, 0.1, True
    most: float = param(30.0, "m", "Largest size: a car farther off is as far.", gt=0)

    def value(self, loop: Loop) -> float:
        """Positive where the car is too far behind [m]."""
        return min(max(loop.gap - loop.wished_gap, -self.most), self.most)
