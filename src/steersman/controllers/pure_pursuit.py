"""Pure pursuit: drive the circle that leads to a point of the road ahead.

Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01, 1992;
look-ahead in proportion to speed as usual since. docs/controllers.md has the equations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Literal, NamedTuple

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent
from steersman.kernels.preview import at_distance
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle

# Speed at which side-slip is reckoned at least [m/s].
_CREEP = 1.0


class PurePursuitState(NamedTuple):
    """The nominal vehicle; nothing changes from step to step."""

    vehicle: Vehicle


@register("controller", "pure_pursuit")
class PurePursuit(ControllerComponent):
    """Steer along the circle from the rear axle to the road's point at the look-ahead distance.

    As in the literature the rear axle follows the road, so the centre of mass of a slow car runs
    l_r^2 kappa / 2 outside of it. With ``track: centre_of_mass`` the circle starts there, along
    the velocity, and it is the centre of mass that follows.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "look_ahead_time": (0.05, 1.5, True),
        "look_ahead_offset": (0.1, 10.0, True),
    }

    look_ahead_time: float = param(
        0.35, "s", "Look-ahead distance is this times the speed, plus the offset.", ge=0
    )
    look_ahead_offset: float = param(3.0, "m", "Look-ahead distance at standstill.", gt=0)
    track: Literal["rear_axle", "centre_of_mass"] = param(
        "rear_axle", "-", "Point of the car that is to follow the road."
    )

    def init(self, vehicle: Vehicle, dt: float) -> PurePursuitState:
        """State before the first step."""
        return PurePursuitState(vehicle)

    def decide(
        self, state: PurePursuitState, observation: Observation
    ) -> tuple[float, Status, PurePursuitState]:
        """Normalised steering, unclipped."""
        vehicle, v = state.vehicle, observation.v_x
        distance = max(v, 0.0) * self.look_ahead_time + self.look_ahead_offset
        if self.track == "rear_axle":
            kappa = pursuit_curvature(observation, -vehicle.l_r, 0.0, distance)
        else:
            slip = math.atan2(observation.v_y, max(v, _CREEP))
            kappa = pursuit_curvature(observation, 0.0, slip, distance)
            # The rear axle's circle has the same centre.
            kappa /= math.sqrt(max(1.0 - (vehicle.l_r * kappa) ** 2, 0.1))
        angle = math.atan(vehicle.wheelbase * kappa)
        return vehicle.steer_for_wheel_angle(angle, v), Status.SOLVED, state


def pursuit_curvature(
    observation: Observation, origin: float, direction: float, distance: float
) -> float:
    """Curvature of the circle from a point of the car to the road [1/m]; Coulter, sec. 2.

    Args:
        observation: what the controller sees.
        origin: the point, on the car's axis, ahead of the centre of mass [m].
        direction: the circle's direction there, against the car's axis [rad].
        distance: straight distance to the road's point ahead [m]. If the waypoints end before
            that, the circle leads to the last of them.
    """
    x, y = at_distance(observation.preview, observation.spacing, origin, 0.0, distance)
    ahead = x - origin
    across = y * math.cos(direction) - ahead * math.sin(direction)
    return 2.0 * across / max(ahead * ahead + y * y, 1e-6)
