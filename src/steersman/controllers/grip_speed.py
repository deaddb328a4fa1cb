"""A controller with a speed that grip allows in the bends ahead: steering and speed, classically.

Point mass on the road: m v^2 |kappa| is at most a share of the grip, and before a bend the car
brakes at a constant rate ("friction circle", Rajamani, Vehicle Dynamics and Control, 2nd ed.,
sec. 13.6).
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import model_validator

from steersman.config import Of, param, register
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.controllers.delay_mpc import DelayMpc
from steersman.controllers.plausible import usable
from steersman.errors import ConfigError
from steersman.kernels.mpc_delay import road_ahead
from steersman.kernels.vehicle import GRAVITY
from steersman.types import Decision, Observation
from steersman.vehicles import Vehicle

# Waypoints that a curvature needs.
_FEWEST = 4
# The limit moves on from the last one, unless that is so far from the speed [m/s].
_AWAY = 0.5
# Least curvature that limits a speed [1/m].
_STRAIGHT = 1e-4


class GripSpeedState(NamedTuple):
    """State of the controller that steers, and what the speed follows from."""

    inner: Any
    friction: float
    """Nominal friction [-]."""
    dt: float
    limit: float = math.nan
    """The largest speed for the next control period [m/s]."""


@register("controller", "grip_speed")
class GripSpeed(Wrapper):
    """Lets a controller steer and limits the speed to what grip allows in the bends ahead.

    The limit changes no faster than the grip that is left to pedals allows.
    """

    inner: Annotated[ControllerComponent, Of("controller")] = param(
        "tuned/mpc_delay", "-", "The controller that steers."
    )
    friction: float | None = param(
        None, "-", "Tyre friction to reckon with; null: the nominal vehicle's.", gt=0
    )
    found: bool = param(
        False, "-", "Reckon with the friction that mpc_delay or nmpc finds, if that is lower."
    )
    used: float = param(0.6, "-", "Share of the grip for bends.", gt=0, le=1)
    braking: float = param(
        0.4, "-", "Share of the grip for braking before them, and for speeding up.", gt=0, le=1
    )

    @model_validator(mode="after")
    def _finds(self) -> GripSpeed:
        if self.found and not isinstance(self.inner, DelayMpc):
            raise ConfigError(
                f"{self.inner.kind!r} finds no friction; name mpc_delay or nmpc", ("inner",)
            )
        return self

    def init(self, vehicle: Vehicle, dt: float) -> GripSpeedState:
        """State before the first step."""
        friction = vehicle.friction if self.friction is None else self.friction
        return GripSpeedState(self.inner.init(vehicle, dt), friction, dt)

    def step(
        self, state: GripSpeedState, observation: Observation
    ) -> tuple[Decision, GripSpeedState]:
        """The inner controller's steering, and the largest speed [m/s] that grip allows."""
        decision, inner = self.inner.step(state.inner, observation)
        state, friction = state._replace(inner=inner), state.friction
        if self.found:
            friction = min(friction, inner.motion.friction)
        seen = usable(observation)
        if seen is not None and len(seen.preview) >= _FEWEST:
            grip = friction * GRAVITY
            last, most = seen.v_x, self.braking * grip * state.dt
            if math.isfinite(state.limit):
                last = min(max(state.limit, last - _AWAY), last + _AWAY)
            limit = min(max(self._fastest(seen, grip), last - most), last + most)
            state = state._replace(limit=limit)
        return decision._replace(speed_limit=state.limit), state

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
        kappa = np.empty(len(o.preview) - 2)
        road_ahead(o.preview, o.spacing, o.curvature, 0.0, o.spacing, kappa)
        ahead = o.spacing * np.arange(len(kappa))
        squares = self.used * grip / np.maximum(np.abs(kappa), _STRAIGHT)
        squares += 2.0 * self.braking * grip * ahead
        return float(np.sqrt(squares.min()))
