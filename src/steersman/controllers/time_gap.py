"""Adaptive cruise control: a controller that steers, and the constant-time-gap law for the speed.

Wished are the gap g_w = g_0 + h v and the acceleration that lets the error of the gap decay,
a = (1/h) (v_lead - v + lambda (g - g_w)) (Rajamani, Vehicle Dynamics and Control, 2nd ed., sec.
6.6; Ioannou and Chien, IEEE Transactions on Vehicular Technology 42, 1993). Here 1/h and lambda/h
are gains of their own. The speed controller below presses the pedals, as in Rajamani's sec. 6.3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

from steersman.config import Of, param, register
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.controllers.plausible import usable
from steersman.types import Decision, Observation
from steersman.vehicles import Vehicle


class TimeGapState(NamedTuple):
    """State of the controller that steers, and the speed."""

    inner: Any
    limit: float = math.nan
    """The largest speed for the next control period [m/s]; NaN: that which is wished."""


@register("controller", "time_gap")
class TimeGap(Wrapper):
    """Lets a controller steer and keeps a constant time gap to the car ahead.

    Where there is none, or it is far enough ahead, the car drives as fast as wished. The gains are
    those found by tuning on the suite ``acc_tuning``, rounded (results/acc/tuning).
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "k_gap": (0.05, 5.0, True),
        "k_speed": (0.02, 4.0, True),
        "ahead": (0.1, 2.0, True),
    }

    inner: Annotated[ControllerComponent, Of("controller")] = param(
        "tuned/mpc_delay", "-", "The controller that steers."
    )
    k_gap: float = param(
        1.84, "1/s^2", "Acceleration per error of the gap: lambda/h of the law.", ge=0
    )
    k_speed: float = param(0.1, "1/s", "Acceleration per relative speed: 1/h of the law.", ge=0)
    ahead: float = param(
        0.78, "s", "The speed asked for is the present one plus this times the acceleration.", gt=0
    )
    acceleration: float = param(2.0, "m/s^2", "Largest acceleration that is asked for.", gt=0)
    braking: float = param(8.0, "m/s^2", "Largest deceleration that is asked for.", gt=0)

    def init(self, vehicle: Vehicle, dt: float) -> TimeGapState:
        """State before the first step."""
        return TimeGapState(self.inner.init(vehicle, dt))

    def redesign(self, vehicle: Vehicle, dt: float) -> TimeGapState:
        """The same, with the inner controller's own redesign."""
        return TimeGapState(self.inner.redesign(vehicle, dt))

    def step(self, state: TimeGapState, observation: Observation) -> tuple[Decision, TimeGapState]:
        """The inner controller's steering, and the largest speed [m/s] that the gap allows."""
        decision, inner = self.inner.step(state.inner, observation)
        state = state._replace(inner=inner)
        if usable(observation) is not None:
            limit, inner_limit = self._allowed(observation), decision.speed_limit
            less = inner_limit < limit or math.isnan(limit)
            state = state._replace(limit=inner_limit if less else limit)
        return decision._replace(speed_limit=state.limit), state

    def _allowed(self, observation: Observation) -> float:
        """The largest speed behind the car ahead [m/s]; NaN without one."""
        v, ahead = observation.speed, observation.ahead
        if ahead is None:
            return math.nan
        error = ahead.gap - ahead.wished_gap
        wanted = self.k_gap * error + self.k_speed * ahead.relative_speed
        wanted = min(max(wanted, -self.braking), self.acceleration)
        return max(v + self.ahead * wanted, 0.0)

    def speed_limit(self, state: TimeGapState) -> float:
        """What the gap allows [m/s]."""
        return state.limit

    def limits_speed(self) -> bool:
        """It does."""
        return True

    def follows(self) -> bool:
        """It does."""
        return True

    def executed(self, state: TimeGapState, steer: float) -> TimeGapState:
        """The executed command goes to the inner controller."""
        return state._replace(inner=self.inner.executed(state.inner, steer))
