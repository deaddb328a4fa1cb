"""Which observations a car on its road can give; all others are faults of the measurement."""

from __future__ import annotations

import math
from operator import le

import numpy as np

from steersman.kernels.preview import lies_within
from steersman.types import Observation

# The largest that a car near its road can measure, far beyond what can be driven; sensors may read
# a little more than full lock. In the order of an observation's numbers after its time.
MOST = {
    "lateral_error": 20.0,
    "heading_error": 3.2,
    "v_x": 100.0,
    "v_y": 30.0,
    "yaw_rate": 5.0,
    "steer": 1.1,
    "curvature": 1.0,
}
_MOST = tuple(MOST.values())
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


def is_possible(o: Observation) -> bool:
    """Whether a car near its road can measure these numbers, of whatever array types."""
    points, spacing = o.preview, o.spacing
    # NaN is not less than anything.
    if not (all(map(le, map(abs, o[1:8]), _MOST)) and 0.0 < spacing < math.inf):
        return False
    if not math.isfinite(o.time) or points.ndim != _PLANE or points.shape[1] != _PLANE:
        return False
    return lies_within(np.asarray(points, np.float64), reach(len(points), spacing))


def reach(count: int, spacing: float) -> float:
    """Largest coordinate [m] of the ``count`` waypoints that lie ``spacing`` [m] apart."""
    return _FARTHEST * count * spacing + MOST["lateral_error"]


def usable(observation: Observation) -> Observation | None:
    """The observation with its heading error in [-pi, pi]; None if no controller can use it.

    That is if a number is not finite, if no car near its road can measure it, or if the car drives
    backwards, where steering acts the other way round.
    """
    o = observation
    if math.pi < abs(o.heading_error) < math.inf:
        o = o._replace(heading_error=math.remainder(o.heading_error, math.tau))
    return o if o.v_x >= -REVERSE and is_possible(o) else None


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
    if abs(o.lateral_error) <= most:
        return o
    excess = o.lateral_error - math.copysign(most, o.lateral_error)
    across = math.sin(o.heading_error), math.cos(o.heading_error)
    preview = o.preview + excess * np.array(across)
    return o._replace(lateral_error=o.lateral_error - excess, preview=preview)
