"""Stanley: the front wheels point along the road and towards it.

Hoffmann, Tomlin, Montemerlo and Thrun, Autonomous automobile trajectory tracking for off-road
driving: controller design, experimental validation and racing, American Control Conference 2007,
eq. 5 to 9. docs/controllers.md has the equations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, NamedTuple

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent
from steersman.controllers.single_track import steady_side_slip
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle


class StanleyState(NamedTuple):
    """Nominal vehicle, and the steering at the last step."""

    vehicle: Vehicle
    steer: float | None = None
    """Measured normalised steering one step ago; None at first."""


@register("controller", "stanley")
class Stanley(ControllerComponent):
    """Heading error, arctan of the front axle's lateral error over speed, and two dampings.

    The front axle follows the road, so the centre of mass of a slow car runs
    (L^2 - l_r^2) kappa / 2 inside of it. With ``track: centre_of_mass`` the front axle is held
    on the circle beside the road on which the centre of mass follows it.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "gain": (0.1, 50.0, True),
        "softening": (0.05, 50.0, True),
        "yaw_damping": (0.0, 1.0, False),
        "steer_damping": (0.0, 0.9, False),
    }

    gain: float = param(1.5, "1/s", "Rate at which a small lateral error decays.", ge=0)
    softening: float = param(1.0, "m/s", "Added to the speed, so that low speeds stay calm.", gt=0)
    yaw_damping: float = param(0.05, "s", "Gain on yaw rate minus the road's.", ge=0)
    steer_damping: float = param(
        0.0, "-", "Gain against the change of the measured steering over a step.", ge=0
    )
    steady_yaw: bool = param(True, "-", "Add the front tyres' slip of the steady turn.")
    track: Literal["front_axle", "centre_of_mass"] = param(
        "front_axle", "-", "Point of the car that is to follow the road."
    )

    def init(self, vehicle: Vehicle, dt: float) -> StanleyState:
        """State before the first step."""
        return StanleyState(vehicle)

    def decide(
        self, state: StanleyState, observation: Observation
    ) -> tuple[float, Status, StanleyState]:
        """Normalised steering, unclipped."""
        vehicle, o = state.vehicle, observation
        v, kappa = max(o.v_x, 0.0), o.curvature
        error, heading = moved_errors(o.lateral_error, o.heading_error, kappa, vehicle.l_f)
        if self.track == "centre_of_mass":
            slip = steady_side_slip(vehicle, v, kappa)
            error -= moved_errors(0.0, -slip, kappa, vehicle.l_f)[0]
        # Hoffmann et al., eq. 9; the road's yaw rate is v kappa.
        angle = -heading - math.atan(self.gain * error / (self.softening + v))
        angle -= self.yaw_damping * (o.yaw_rate - v * kappa)
        if self.steady_yaw:
            # The slip angle with which the front axle carries its share of m v^2 kappa.
            angle += vehicle.mass * vehicle.l_r / (vehicle.wheelbase * vehicle.c_f) * v * v * kappa
        steer = vehicle.steer_for_wheel_angle(angle, o.v_x)
        last = o.steer if state.steer is None else state.steer
        steer -= self.steer_damping * (o.steer - last)
        return steer, Status.SOLVED, StanleyState(vehicle, o.steer)


def moved_errors(d: float, heading: float, kappa: float, ahead: float) -> tuple[float, float]:
    """Lateral [m] and heading error [rad] of the point ``ahead`` [m] on the car's axis.

    The road is the circle of curvature ``kappa`` [1/m] beside the centre of mass; ``d`` [m] and
    ``heading`` [rad] are the errors there.

    >>> moved_errors(0.5, 0.0, 0.0, 2.0)
    (0.5, 0.0)
    """
    if not math.isfinite(heading):
        return math.nan, math.nan
    x, y = ahead * math.cos(heading), d + ahead * math.sin(heading)
    # Distance from the centre (0, 1/kappa) against the radius, in a form that kappa = 0 allows.
    root = math.hypot(kappa * x, 1.0 - kappa * y)
    error = (2.0 * y - kappa * (x * x + y * y)) / (1.0 + root)
    turned = heading - math.atan2(kappa * x, 1.0 - kappa * y)
    return error, math.remainder(turned, 2.0 * math.pi)
