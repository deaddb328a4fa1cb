"""Steering without eyes: on along the road that was seen last, then straight ahead."""

from __future__ import annotations

import math

from steersman.controllers.pid import preview_curvature, steady_wheel_angle
from steersman.types import Observation
from steersman.vehicles import Vehicle

# Road over which a curvature is fitted, against noisy waypoints [m].
_WINDOW = 8.0
# How fast the steering goes to the middle where no road was seen [1/s].
STRAIGHTEN = 0.5


def blind_steer(
    vehicle: Vehicle, seen: Observation, last: float, before: float, now: float, dt: float
) -> float:
    """Normalised steering: the last one, changed as the steady turn's along the road changes.

    Args:
        vehicle: nominal parameters.
        seen: the last observation that could be trusted.
        last: the steering executed last [normalised].
        before: how long after ``seen`` that was meant for [s].
        now: how long after ``seen`` this is [s].
        dt: control period [s].
    """
    ahead = seen.v_x * now
    if ahead > (len(seen.preview) - 1) * seen.spacing:
        return math.copysign(max(abs(last) - STRAIGHTEN * dt, 0.0), last)
    return last + _steady(vehicle, seen, ahead) - _steady(vehicle, seen, seen.v_x * before)


def _steady(vehicle: Vehicle, seen: Observation, ahead: float) -> float:
    """Normalised steering of the steady turn ``ahead`` [m] of where the car was."""
    v, ahead = seen.v_x, max(ahead, 0.0)
    kappa = preview_curvature(seen, ahead, _WINDOW)
    if 2.0 * ahead < _WINDOW:  # there the fit is one around the middle of the first window
        kappa = seen.curvature + (kappa - seen.curvature) * 2.0 * ahead / _WINDOW
    return vehicle.steer_for_wheel_angle(steady_wheel_angle(vehicle, v, kappa), v)
