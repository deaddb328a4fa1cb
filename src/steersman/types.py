"""What flows through a control loop: named tuples in SI units, ISO 8855 signs.

ISO 8855: x forward, y left, z up. Steering, curvature, yaw and lateral error are positive to
the left. Angles are radians, lengths metres, times seconds. ``steer`` is the normalised steering
command in [-1, 1]; 1 is full lock to the left.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]


NO_WISH: FloatArray = np.zeros(0)


class CarAhead(NamedTuple):
    """What is known of a car ahead in the own lane."""

    gap: float
    """Distance to it along the road, bumper to bumper [m]."""
    relative_speed: float
    """Its speed less the own one [m/s]; negative while the gap closes."""
    wished_gap: float
    """Gap that is wished at the own speed [m]."""


class VehicleState(NamedTuple):
    """State of the vehicle at its centre of mass."""

    time: float
    """Time since the start of the run [s]."""
    x: float
    """Global position of the centre of mass [m]."""
    y: float
    """Global position of the centre of mass [m]."""
    psi: float
    """Yaw angle, unwrapped [rad]."""
    v_x: float
    """Longitudinal velocity in the vehicle's frame [m/s]."""
    v_y: float
    """Lateral velocity in the vehicle's frame, left positive [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s]."""
    a_x: float
    """Longitudinal acceleration of the centre of mass in the vehicle's frame [m/s^2]."""
    a_y: float
    """Lateral acceleration of the centre of mass in the vehicle's frame [m/s^2]."""
    steer: float
    """Actual (rate-limited) normalised steering [-]."""
    wheel_angle: float
    """Single-track angle of the front wheels: cot = mean of both wheels' cot [rad]."""
    throttle: float
    """Actual throttle [0..1]."""
    brake: float
    """Actual brake [0..1]."""


class Observation(NamedTuple):
    """What a controller sees at one control step; may carry sensor and waypoint errors."""

    time: float
    """Time since the start of the run [s]."""
    lateral_error: float
    """Signed distance of the tracked point from the path, left positive [m]."""
    heading_error: float
    """Yaw minus path tangent, in (-pi, pi] [rad]."""
    v_x: float
    """Longitudinal velocity [m/s]."""
    v_y: float
    """Lateral velocity [m/s]."""
    yaw_rate: float
    """Yaw rate [rad/s]."""
    steer: float
    """Actual normalised steering [-]."""
    curvature: float
    """Path curvature beside the tracked point [1/m]."""
    preview: FloatArray
    """Waypoints ahead in the vehicle's frame [m], shape (n, 2); row 0 is beside the car."""
    spacing: float
    """Distance between waypoints along the path [m]."""
    wished: FloatArray = NO_WISH
    """Speeds wished now at the waypoints [m/s], shape (n,); (0,) where no speed is wished."""
    ahead: CarAhead | None = None
    """The car ahead; None where there is none."""

    @property
    def speed(self) -> float:
        """Magnitude of the velocity [m/s]."""
        return float(np.hypot(self.v_x, self.v_y))


class Command(NamedTuple):
    """What a plant takes: normalised steering [-1, 1], throttle [0, 1], brake [0, 1]."""

    steer: float
    throttle: float
    brake: float


class Status(IntEnum):
    """How a decision came about."""

    SOLVED = 0
    SATURATED = 1
    """The command was clipped to a limit."""
    FALLBACK = 2
    """The controller's own method failed (or its input was not finite); its fallback answered."""
    ABSENT = 3
    """No decision, as of a person without hands on the wheel: the present steering is held."""


class Driver(IntEnum):
    """What steers under a supervisor; without one, always the own controller."""

    INNER = 0
    """The supervised controller."""
    FALLBACK = 1
    LAST = 2
    """The fallback of the fallback."""
    HOLD = 3
    """No controller: the steering is held, then straightened."""


class Reason(IntEnum):
    """What a supervisor found."""

    NONE = 0
    MISSING = 1
    """There was no observation, or the last one again."""
    STALE = 2
    """The observation's numbers stayed the same while the car moved."""
    INPUT_NOT_FINITE = 3
    INPUT_RANGE = 4
    """The observation holds what no car on a road can measure."""
    EXCEPTION = 5
    """The controller raised."""
    DEADLINE = 6
    """The controller answered too late."""
    COMMAND = 7
    """The command is not a finite number."""
    COMMAND_LIMIT = 8
    """The command is beyond the steering's limits."""
    COMMAND_RATE = 9
    """For some time the command changed faster than the steering may."""
    UNSOLVED = 10
    """The controller's own method failed."""
    CORRIDOR = 11
    """The car was about to leave the corridor."""
    OSCILLATION = 12
    """The steering swung to and fro."""


class Decision(NamedTuple):
    """A controller's answer: normalised steering command in [-1, 1] and how it came about."""

    steer: float
    status: Status = Status.SOLVED
    driver: Driver = Driver.INNER
    """What steers, as a supervisor decided."""
    reason: Reason = Reason.NONE
    """Why it is not the supervised controller, or why that steers by what would be seen."""
    speed_limit: float = math.nan
    """The largest speed for the next period [m/s]; NaN: that which is wished."""


class Pose(NamedTuple):
    """Global position of the centre of mass [m] and yaw [rad]."""

    x: float
    y: float
    psi: float


class PathPoint(NamedTuple):
    """A point of a path: position [m], tangent direction [rad], curvature [1/m]."""

    x: float
    y: float
    psi: float
    curvature: float


class Surface(NamedTuple):
    """Height and banking of the road under a path, linear between places; each (n,)."""

    s: FloatArray
    """Arc length [m], increasing."""
    height: FloatArray
    """Above the source's zero [m]."""
    bank: FloatArray
    """Roll of the road about the driving direction, ISO 8855: left side up positive [rad]."""

    def at(self, s: float) -> tuple[float, float]:
        """Height [m] and banking [rad] at an arc length [m]; held beyond the ends."""
        return float(np.interp(s, self.s, self.height)), float(np.interp(s, self.s, self.bank))
