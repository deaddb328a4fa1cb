"""A controller with a speed that grip allows in the bends ahead: steering and speed, classically.

Point mass on the road: m v^2 |kappa| is at most a share of the grip, and before a bend the car
brakes at a constant rate ("friction circle", Rajamani, Vehicle Dynamics and Control, 2nd ed.,
ch. 13, with Dugoff's tyre model).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from pydantic import model_validator

from steersman.config import Of, param, register
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.controllers.delay_mpc import DelayMpc
from steersman.controllers.grip_use import Belief, GripUse, bends_in_view, near_speed
from steersman.controllers.plausible import usable
from steersman.errors import ConfigError
from steersman.kernels.bend_speed import approach_speed, for_pedals, pedal_shares
from steersman.kernels.vehicle import GRAVITY
from steersman.types import Decision, Observation
from steersman.vehicles import Vehicle

# Waypoints that a curvature needs.
_FEWEST = 4


class GripSpeedState(NamedTuple):
    """State of the controller that steers, and what the speed follows from."""

    inner: Any
    belief: Belief
    dt: float
    shares: tuple[float, float]
    """Of the grip, for driving and for braking [-]."""
    limit: float = math.nan
    """The largest speed for the next control period [m/s]."""


@register("controller", "grip_speed")
class GripSpeed(GripUse, Wrapper):
    """Lets a controller steer and limits the speed to what grip allows in the bends ahead.

    The limit changes no faster than the grip that is left to pedals allows.
    """

    inner: Annotated[ControllerComponent, Of("controller")] = param(
        "tuned/mpc_delay", "-", "The controller that steers."
    )

    @model_validator(mode="after")
    def _finds(self) -> GripSpeed:
        if self.found and not isinstance(self.inner, DelayMpc):
            around = (
                "" if self.inner.kind != "estimated" else ", and let 'estimated' hold grip_speed"
            )
            raise ConfigError(
                f"{self.inner.kind!r} finds no friction; name mpc_delay or nmpc{around}", ("inner",)
            )
        return self

    def init(self, vehicle: Vehicle, dt: float) -> GripSpeedState:
        """State before the first step."""
        return self._begun(self.inner.init(vehicle, dt), vehicle, dt)

    def redesign(self, vehicle: Vehicle, dt: float) -> GripSpeedState:
        """The same, with the inner controller's own redesign."""
        return self._begun(self.inner.redesign(vehicle, dt), vehicle, dt)

    def _begun(self, inner: Any, vehicle: Vehicle, dt: float) -> GripSpeedState:
        shares = pedal_shares(vehicle.row())
        return GripSpeedState(inner, self.believed(vehicle), dt, shares)

    def step(
        self, state: GripSpeedState, observation: Observation
    ) -> tuple[Decision, GripSpeedState]:
        """The inner controller's steering, and the largest speed [m/s] that grip allows."""
        decision, inner = self.inner.step(state.inner, observation)
        state = state._replace(inner=inner)
        seen = usable(observation)
        if seen is not None and len(seen.preview) >= _FEWEST:
            if self.found:
                found = inner.motion.friction
                state = state._replace(belief=self.shown(state.belief, seen, found, state.dt))
            state = state._replace(limit=self._moved(state, seen))
        return decision._replace(speed_limit=state.limit), state

    def _moved(self, state: GripSpeedState, o: Observation) -> float:
        """The limit [m/s], moved on by no more than grip leaves to the pedals."""
        grip = state.belief.friction * GRAVITY
        least, most = for_pedals(grip, self.braking * grip, state.shares, o.v_x, o.curvature)
        last = near_speed(state.limit, o.v_x)
        return min(max(self._fastest(o, grip), last + least * state.dt), last + most * state.dt)

    def speed_limit(self, state: GripSpeedState) -> float:
        """What grip allows [m/s]."""
        return state.limit

    def limits_speed(self) -> bool:
        """It does."""
        return True

    def executed(self, state: GripSpeedState, steer: float) -> GripSpeedState:
        """The executed command goes to the inner controller."""
        return state._replace(inner=self.inner.executed(state.inner, steer))

    def _fastest(self, o: Observation, grip: float) -> float:
        """The largest speed from which every bend in view can be braked for [m/s]."""
        kappa = bends_in_view(o)
        return approach_speed(kappa, o.spacing, 0.0, self.used * grip, self.braking * grip)
