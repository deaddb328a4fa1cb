"""Vector field: at every distance from the path there is a course that leads back to it.

Nelson, Barber, McLain and Beard, "Vector field path following for miniature air vehicles", IEEE
Trans. Robotics 23, 2007, eq. 4; here the course is followed by a car's front wheels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle


class VectorFieldState(NamedTuple):
    """The nominal vehicle; nothing changes from step to step."""

    vehicle: Vehicle


@register("controller", "vector_field")
class VectorField(ControllerComponent):
    """Follows the course -approach (2 / pi) atan(gain d) against the path's tangent."""

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "gain": (0.02, 5.0, True),
        "rate": (0.2, 20.0, True),
    }

    approach: float = param(0.8, "rad", "Course towards the path from far away.", gt=0, le=1.5)
    gain: float = param(0.5, "1/m", "How near the path the course begins to bend into it.", gt=0)
    rate: float = param(4.0, "1/s", "Rate at which the car's course follows the field's.", gt=0)

    def init(self, vehicle: Vehicle, dt: float) -> VectorFieldState:
        """State before the first step."""
        return VectorFieldState(vehicle)

    def decide(
        self, state: VectorFieldState, observation: Observation
    ) -> tuple[float, Status, VectorFieldState]:
        """Normalised steering, unclipped: left is positive, as all angles are."""
        vehicle, o = state.vehicle, observation
        v = max(o.v_x, 1.0)
        moving = min(max(o.v_x, 0.0), 1.0)  # a car that stands cannot change its course
        wanted = -self.approach * (2.0 / math.pi) * math.atan(self.gain * o.lateral_error)
        course = math.remainder(o.heading_error + math.atan2(o.v_y, v), 2.0 * math.pi)
        kappa = o.curvature + moving * self.rate / v * (wanted - course)
        angle = math.atan(vehicle.wheelbase * kappa)
        return vehicle.steer_for_wheel_angle(angle, o.v_x), Status.SOLVED, state
