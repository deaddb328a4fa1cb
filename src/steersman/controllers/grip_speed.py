"""A controller with a speed that grip allows in the bends ahead: steering and speed, classically.

Point mass on the road: m v^2 |kappa| is at most a share of the grip, and before a bend the car
brakes at a constant rate ("friction circle", Rajamani, Vehicle Dynamics and Control, 2nd ed.,
ch. 13, with Dugoff's tyre model).
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
# Share of the grip for bends and pedals together, and for braking where bends take it all.
_CIRCLE, _LEAST_BRAKING = 0.7, 0.1
# Time constant of the accelerations that tyres have shown [s].
_SHOWN_TIME = 0.15
# What an acceleration along the road counts, where nothing shows that tyres are near their grip.
_ALONG = 0.5
# After a slide, the friction reckoned with stays below this share of what it was.
_AFTER_SLIDE = 0.9
# Least curvature that limits a speed [1/m].
_STRAIGHT = 1e-4


class Belief(NamedTuple):
    """What a drive has shown of the friction."""

    friction: float
    """Friction to reckon with [-]."""
    most: float
    """The largest that it may become; lower after a slide [-]."""
    a_x: float = 0.0
    """Acceleration along the road, filtered [m/s^2]."""
    a_y: float = 0.0
    """Across it [m/s^2]."""
    v: float = math.nan
    """Speed one period ago [m/s]."""


class GripSpeedState(NamedTuple):
    """State of the controller that steers, and what the speed follows from."""

    inner: Any
    belief: Belief
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
        False,
        "-",
        "Find the friction by driving: reckon with little at first, and with more as tyres show "
        "it; with less when mpc_delay or nmpc finds less.",
    )
    least: float = param(0.2, "-", "Where it is found: the friction at first, and the least.", gt=0)
    reach: float = param(
        2.2, "-", "Where it is found: friction over what accelerations have shown of it.", ge=1
    )
    growth: float = param(0.5, "1/s", "Its largest rate of growth, relative.", gt=0)
    used: float = param(0.6, "-", "Share of the grip for bends.", gt=0, le=1)
    braking: float = param(
        0.5, "-", "Share of the grip for braking before them, and for speeding up.", gt=0, le=1
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
        most = vehicle.friction if self.friction is None else self.friction
        belief = Belief(min(self.least, most) if self.found else most, most)
        return GripSpeedState(self.inner.init(vehicle, dt), belief, dt)

    def step(
        self, state: GripSpeedState, observation: Observation
    ) -> tuple[Decision, GripSpeedState]:
        """The inner controller's steering, and the largest speed [m/s] that grip allows."""
        decision, inner = self.inner.step(state.inner, observation)
        state = state._replace(inner=inner)
        seen = usable(observation)
        if seen is not None and len(seen.preview) >= _FEWEST:
            if self.found:
                state = state._replace(belief=self._shown(state, seen))
            state = state._replace(limit=self._moved(state, seen))
        return decision._replace(speed_limit=state.limit), state

    def _shown(self, state: GripSpeedState, o: Observation) -> Belief:
        """The friction to reckon with, after one more period.

        It grows while the car's acceleration comes near it, and falls to what the inner controller
        finds, once the tyres slide.
        """
        belief, dt = state.belief, state.dt
        surge = 0.0 if math.isnan(belief.v) else (o.v_x - belief.v) / dt
        blend = min(dt / _SHOWN_TIME, 1.0)
        a_x = belief.a_x + blend * (surge - belief.a_x)
        a_y = belief.a_y + blend * (o.v_x * o.yaw_rate - belief.a_y)
        reached = self.reach * math.hypot(_ALONG * a_x, a_y) / GRAVITY
        grown = min(reached, belief.friction * (1.0 + self.growth * dt))
        friction, most = max(belief.friction, grown), belief.most
        found = state.inner.motion.friction
        if found < friction:
            most = min(most, _AFTER_SLIDE * friction)
        least = min(self.least, belief.most)
        friction = max(min(friction, most, found), least)
        return Belief(friction, max(most, least), a_x, a_y, o.v_x)

    def _moved(self, state: GripSpeedState, o: Observation) -> float:
        """The limit [m/s], moved on by no more than grip leaves to the pedals."""
        grip = state.belief.friction * GRAVITY
        across = o.v_x * o.v_x * abs(o.curvature)
        left = math.sqrt(max((_CIRCLE * grip) ** 2 - across * across, 0.0))
        last = o.v_x
        if math.isfinite(state.limit):
            last = min(max(state.limit, last - _AWAY), last + _AWAY)
        least = last - max(left, _LEAST_BRAKING * grip) * state.dt
        most = last + min(left, self.braking * grip) * state.dt
        return min(max(self._fastest(o, grip), least), most)

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
