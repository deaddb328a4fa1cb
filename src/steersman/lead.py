"""A car ahead in the own lane, with a speed over time: the task of adaptive cruise control.

It keeps to the path and to the limits along it, and nothing that the own car does changes it. The
gap is measured along the path, bumper to bumper, and reaches controllers without errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import field_validator

from steersman.config import Of, Settings, param, required
from steersman.profiles import Profile
from steersman.speed import SpeedComponent, SpeedTracking
from steersman.types import FloatArray


class LeadStart(NamedTuple):
    """A car ahead at the start of a drive."""

    times: FloatArray
    """Breakpoints of its speed [s], increasing."""
    speeds: FloatArray
    """Speeds there [m/s]."""
    gap: float | None
    """Gap at the start [m]; None: the one that is wished at the own speed."""
    standstill: float
    """Gap wished at standstill [m]."""
    headway: float
    """Growth of the wished gap with the own speed [s]."""
    length: float
    """Distance of both cars' centres when they touch [m]."""


class Lead(Settings):
    """A car ahead, and the gap that is wished to it: standstill + headway x own speed."""

    speed: Annotated[SpeedComponent, Of("speed")] = required(
        "-", "Its speed over time: recorded (csv, nedc) or drawn (random_profile, stop_and_go)."
    )
    gap: float | None = param(
        None, "m", "Gap at the start, bumper to bumper; null: the one that is wished there.", gt=0
    )
    standstill: float = param(3.0, "m", "Gap that is wished at standstill.", gt=0)
    headway: float = param(1.5, "s", "Time gap: growth of the wished gap with the speed.", gt=0)
    length: float = param(4.8, "m", "Distance of both cars' centres when they touch.", gt=0)
    spread: float = param(
        0.0, "-", "A training draws the gap at the start from 1 less to 1 more this.", ge=0, lt=1
    )

    @field_validator("speed")
    @classmethod
    def _over_time(cls, value: SpeedComponent) -> SpeedComponent:
        if not isinstance(value, SpeedTracking) or value.along() is not None:
            raise ValueError(
                f"{value.kind} has no speeds over time alone; name csv, nedc, random_profile, "
                "stop_and_go or constant_speed"
            )
        return value

    def start(self) -> LeadStart:
        """The car ahead of a drive."""
        return self._of(self.speed.profile(), 1.0)

    def draw(self, rng: np.random.Generator, seconds: float) -> LeadStart:
        """The car ahead of a training episode of so many seconds."""
        profile = self.speed.draw(rng, seconds)
        return self._of(profile, 1.0 + self.spread * rng.uniform(-1.0, 1.0))

    def _of(self, profile: Profile, share: float) -> LeadStart:
        gap = None if self.gap is None else share * self.gap
        wish = self.standstill, self.headway, self.length
        return LeadStart(profile.times, profile.speeds, gap, *wish)


def most_points(leads: Sequence[Lead], seconds: float) -> int:
    """Most breakpoints that the speed of a car ahead has in an episode; 0 where there is none."""
    rng = np.random.default_rng(0)
    return max((len(each.draw(rng, seconds).times) for each in leads), default=0)
