"""The speed wished, for joint actions."""

from __future__ import annotations

from steersman.config import param, register
from steersman.features.base import Feature, Loop
from steersman.kernels import encode as kernel
from steersman.types import Observation


@register("feature", "wished_speeds")
class WishedSpeeds(Feature):
    """Speed wished now beside the vehicle and at every third waypoint ahead."""

    unit, sign, scale, joint = "m/s", 1.0, 1.0 / 15.0, True
    count: int = param(kernel.N_WISHES, "-", "Places.", ge=1, le=kernel.N_WISHES)

    @property
    def size(self) -> int:
        """One number for each place."""
        return self.count

    @property
    def reads(self) -> int:
        """Up to the last place."""
        return kernel.STRIDE * (self.count - 1) + 1

    def label(self, i: int, spacing: float) -> str:
        """The distance ahead."""
        return f"wished_speed_{kernel.STRIDE * i * spacing:g}m [{self.unit}]"

    def value(self, loop: Loop, i: int) -> float:
        """The speed [m/s]."""
        return float(loop.wishes[i, 0])


@register("feature", "speed_error")
class SpeedError(Feature):
    """Longitudinal velocity less the speed wished here and now."""

    unit, sign, scale, joint = "m/s", 1.0, 0.3, True

    def value(self, seen: Observation, loop: Loop) -> float:
        """Positive where the car is too fast [m/s]."""
        return float(seen.v_x - loop.wishes[0, 0])


@register("feature", "last_share")
class LastShare(Feature):
    """Share of the wished speed that the last action allowed."""

    sign, joint = 1.0, True

    def value(self, loop: Loop) -> float:
        """In [0, 1]."""
        return loop.last_share
