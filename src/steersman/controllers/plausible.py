"""Which observations a car on its road can give; all others are faults of the measurement."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.types import Observation


class Magnitudes(NamedTuple):
    """Of the numbers of an observation after its time."""

    lateral_error: float
    heading_error: float
    v_x: float
    v_y: float
    yaw_rate: float
    steer: float
    curvature: float


# The largest that a car near its road can measure, far beyond what can be driven; sensors may read
# a little more than full lock.
MOST = Magnitudes(20.0, 3.2, 100.0, 30.0, 5.0, 1.1, 1.0)
# Waypoints farther from the car than this many times the preview's length are faults.
_FARTHEST = 2.0
_PLANE = 2
# A car that rolls back faster than this drives in reverse [m/s]. Slower ones are taken to stand,
# since speed sensors read a little below zero there.
REVERSE = 1.0
# Tangent of the largest angle at which a road is approached.
_APPROACH = 0.5
# Beyond this heading error a car drives against the road, for which no small angle holds [rad].
ACROSS = 0.5 * math.pi
# Walking pace [m/s].
WALK = 1.4


def is_finite(observation: Observation) -> bool:
    """Whether every number of the observation is finite."""
    total = sum(observation[:8]) + float(observation.preview.sum()) + observation.spacing
    return math.isfinite(total)


def is_possible(o: Observation) -> bool:
    """Whether a car near its road can measure these finite numbers, of whatever array types."""
    if any(abs(value) > most for value, most in zip(o[1:8], MOST, strict=True)):
        return False
    points = o.preview
    if points.ndim != _PLANE or points.shape[1] != _PLANE:
        return False
    if o.spacing <= 0.0:
        return False
    return bool(np.abs(points).max(initial=0.0) <= reach(len(points), o.spacing))


def reach(count: int, spacing: float) -> float:
    """Largest coordinate [m] of the ``count`` waypoints that lie ``spacing`` [m] apart."""
    return _FARTHEST * count * spacing + MOST.lateral_error


def usable(observation: Observation) -> Observation | None:
    """The observation with its heading error in [-pi, pi]; None if no controller can use it.

    That is if a number is not finite, if no car near its road can measure it, or if the car drives
    backwards, where steering acts the other way round.
    """
    o = observation
    if not is_finite(o) or o.v_x < -REVERSE:
        return None
    if abs(o.heading_error) > math.pi:
        o = o._replace(heading_error=math.remainder(o.heading_error, math.tau))
    return o if is_possible(o) else None


def moving_time(v_x: float, dt: float) -> float:
    """The time [s] by which an integral of the lateral error moves on in a period ``dt``.

    The whole period from walking pace on, less below it, nothing at standstill: the error of a
    car that does not move says nothing about its steering. ``v_x`` [m/s] is the forward speed.
    """
    return dt * min(max(v_x / WALK, 0.0), 1.0)


def nearer(observation: Observation, time: float) -> Observation:
    """The observation with the road moved as near as the car can reach it in ``time`` [s].

    A car at speed v approaches a road at a small angle, by v ``time`` / 2 at most. A plan over that
    time that is to remove more steers to full lock; that of a standing car would do so for the
    least error. Other numbers stay.
    """
    o, most = observation, _APPROACH * max(observation.v_x, 0.0) * time
    excess = o.lateral_error - min(max(o.lateral_error, -most), most)
    if excess == 0.0:
        return observation
    across = math.sin(o.heading_error), math.cos(o.heading_error)
    preview = o.preview + excess * np.array(across)
    return o._replace(lateral_error=o.lateral_error - excess, preview=preview)
