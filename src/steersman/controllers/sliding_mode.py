"""Sliding mode with a boundary layer on the lateral error of a point ahead of the car.

Surface and boundary layer: Slotine and Li, Applied Nonlinear Control, 1991, sec. 7.1 and 7.2
(with the integral of the error as the lowest state, exercise of sec. 7.1). Reaching law, constant
plus proportional: Gao and Hung, Variable structure control of nonlinear systems: a new approach,
IEEE Trans. Industrial Electronics 40, 1993. Looking ahead for steering: Guldner, Tan and
Patwardhan, Analysis of automatic steering control for highway vehicles with look-down lateral
reference systems, Vehicle System Dynamics 26, 1996. docs/controllers.md has the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent
from steersman.controllers.plausible import moving_time
from steersman.controllers.single_track import errors, preview_curvature, steady_side_slip
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle

# The model's tyre terms grow with 1/v; below this speed it is taken as it is there [m/s].
_SLOWEST = 2.0


class SlidingModeState(NamedTuple):
    """Nominal vehicle, control period [s] and the integral of the error [m s]."""

    vehicle: Vehicle
    dt: float
    integral: float = 0.0


@register("controller", "sliding_mode")
class SlidingMode(ControllerComponent):
    """Drives s = y' + 2 c y + c^2 (integral of y) to zero by s' = -q s - k sat(s / layer).

    y is the lateral error of a point ahead of the centre of mass, less what the steady turn has
    there. The equivalent control comes from the linear error dynamics.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "slope": (0.2, 20.0, True),
        "proportional": (0.1, 10.0, True),
        "reaching": (0.05, 10.0, True),
        "layer": (0.05, 3.0, True),
        "look_ahead": (0.0, 5.0, False),
        "preview_time": (1e-2, 1.0, True),
    }

    slope: float = param(1.0, "1/s", "c: on the surface errors decay at this rate, twice.", gt=0)
    proportional: float = param(2.0, "1/s", "q of the reaching law.", ge=0)
    reaching: float = param(0.5, "m/s^2", "k of the reaching law.", ge=0)
    layer: float = param(0.5, "m/s", "Half width of the boundary layer around s = 0.", gt=0)
    look_ahead: float = param(1.0, "m", "The point's distance ahead of the centre of mass.", ge=0)
    integral_limit: float = param(1.0, "m s", "Bound of the integral of the error.", ge=0)
    preview_time: float = param(0.05, "s", "Look-ahead of the curvature.", ge=0)

    def init(self, vehicle: Vehicle, dt: float) -> SlidingModeState:
        """State before the first step."""
        return SlidingModeState(vehicle, dt)

    def decide(
        self, state: SlidingModeState, observation: Observation
    ) -> tuple[float, Status, SlidingModeState]:
        """Normalised steering, unclipped."""
        vehicle, dt, integral = state
        o, v = observation, max(observation.v_x, _SLOWEST)
        e1, e1_rate, e2, e2_rate = errors(o)
        e2 += steady_side_slip(vehicle, v, o.curvature)
        y, rate = e1 + self.look_ahead * e2, e1_rate + self.look_ahead * e2_rate
        wanted = integral + y * moving_time(o.v_x, dt)
        wanted = min(max(wanted, -self.integral_limit), self.integral_limit)
        c = self.slope
        s = rate + 2.0 * c * y + c * c * wanted
        law = -self.proportional * s - self.reaching * min(max(s / self.layer, -1.0), 1.0)
        drift, effect = self._dynamics(vehicle, v, preview_curvature(o, self.preview_time * v), o)
        angle = (law - 2.0 * c * rate - c * c * y - drift) / effect
        steer = vehicle.steer_for_wheel_angle(angle, o.v_x)
        # While the steering is saturated the integral stands still.
        kept = wanted if abs(steer) <= 1.0 else integral
        return steer, Status.SOLVED, SlidingModeState(vehicle, dt, kept)

    def _dynamics(
        self, vehicle: Vehicle, v: float, kappa: float, o: Observation
    ) -> tuple[float, float]:
        """Drift and effect in y'' = drift + effect x wheel angle, from both axles' slip angles."""
        _, e1_rate, e2, e2_rate = errors(o)
        rate = e2_rate + v * kappa
        across = e1_rate - v * e2
        front = -vehicle.c_f * (across + vehicle.l_f * rate) / v
        rear = -vehicle.c_r * (across - vehicle.l_r * rate) / v
        # Newton at the point: acceleration of the centre of mass, less the road's, plus turning.
        turning = (vehicle.l_f * front - vehicle.l_r * rear) / vehicle.yaw_inertia
        drift = (front + rear) / vehicle.mass - v * v * kappa + self.look_ahead * turning
        effect = vehicle.c_f / vehicle.mass
        effect += self.look_ahead * vehicle.c_f * vehicle.l_f / vehicle.yaw_inertia
        return drift, effect
