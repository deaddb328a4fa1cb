"""What a model-based controller learns from the car's motion: delay, missing forces, friction.

Missing forces: Pannocchia and Rawlings, Disturbance models for offset-free model-predictive
control, AIChE Journal 49, 2003. docs/equations/mpc_delay.md has the equations.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from steersman.controllers.plausible import moving_time
from steersman.kernels import grip
from steersman.kernels import mpc_delay as kernel
from steersman.kernels import vehicle as car
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle

# Speed below which the model has no meaning; slower cars are taken for so fast [m/s].
SLOWEST = 1.0
# Delays that the estimate tries: 0, 10, ... 500 ms [s].
_RESOLUTION, _LONGEST = 0.01, 0.5
# Delays [s] that differ by less are the same, but for rounding.
_SAME = 1e-9
# Time over which the errors of the tried delays fade [s].
_MEMORY = 2.0
# Another delay has to explain the steering this much better than the present one.
_BETTER = 0.5
# Time constant of the acceleration's estimate [s].
_SURGE_TIME = 0.15
# Bound of the acceleration's estimate [m/s^2].
_FASTEST = 10.0
# Bounds of the missing accelerations, beyond what wind and wrong parameters do
# [m/s^2], [rad/s^2].
_MOST = 10.0
# Larger changes in a period than the model's are faults of the measurement [m/s], [rad/s].
_JUMP_SIDE, _JUMP_YAW = 1.0, 0.6
# Frictions that the estimate tries: so many, from the lowest to the nominal one.
_FRICTIONS, _ICE = 32, 0.1
# Time over which their errors fade, and the noise's [s].
_GRIP_TIME, _NOISE_TIME = 0.1, 1.0
# Time over which a force is learned that is missing without much slip [s].
_OFFSET_TIME = 1.0
# How much better than the nominal friction another one has to explain the motion, and then another
# one than that [variances].
_DOUBTED, _REFINED = 1.5, 0.1
NOTHING: FloatArray = np.zeros(2)


class Seen(NamedTuple):
    """The observation of one period ago."""

    v_x: float
    v_y: float
    yaw_rate: float
    steer: float


class MotionEstimate(NamedTuple):
    """The estimates, and what they are made from."""

    vehicle: Vehicle
    dt: float
    commands: FloatArray
    """Normalised steering commands, newest first."""
    delays: FloatArray
    """Squared errors of the steering that each tried delay predicts, fading over time."""
    frictions: FloatArray
    """Squared errors of the motion that each tried friction predicts, over their variances."""
    friction: float
    """Friction coefficient that the prediction uses [-]."""
    delay: float
    """Steering delay that the prediction uses [s]."""
    begun: bool = False
    """Whether there was a first step, which fills what follows."""
    seen: Seen = Seen(0.0, 0.0, 0.0, 0.0)
    acceleration: float = 0.0
    """Estimated from v_x [m/s^2]."""
    disturbance: tuple[float, float] = (0.0, 0.0)
    """Side [m/s^2] and yaw acceleration [rad/s^2] missing in the model."""
    missed: FloatArray = NOTHING
    """(2,) side forces of the front and of the rear axle measured less predicted [N]."""
    noise: FloatArray = NOTHING
    """(2,) variances of them that the measurement's noise explains [N^2]."""
    offset: FloatArray = NOTHING
    """(2,) side forces missing where there is little slip, which no want of grip explains [N]."""

    @property
    def grips(self) -> FloatArray:
        """Largest side forces of the front and of the rear axle (2,) [N]."""
        row, seen = self.vehicle.table.rows[0], self.seen
        a_x = self.acceleration - seen.v_y * seen.yaw_rate
        return np.array(grip.axle_grips(row, self.friction, seen.v_x, a_x))

    @property
    def lacks_when_linear(self) -> FloatArray:
        """Side and yaw acceleration (2,) that a model with linear tyres lacks at present."""
        row, (v_x, v_y, rate, steer) = self.vehicle.table.rows[0], self.seen
        v = max(v_x, SLOWEST)
        slip_f = kernel.wheel_angle(self.vehicle.table, steer, v) - (v_y + row[car.L_F] * rate) / v
        slip_r = (row[car.L_R] * rate - v_y) / v
        front, rear = grip.axle_forces(row, self.grips, slip_f, slip_r)
        front, rear = front - row[car.C_F] * slip_f, rear - row[car.C_R] * slip_r
        turning = (row[car.L_F] * front - row[car.L_R] * rear) / row[car.INERTIA]
        lacks = self.disturbance
        return np.array([lacks[0] + (front + rear) / row[car.MASS], lacks[1] + turning])

    def speed_in(self, time: float) -> float:
        """Speed after ``time`` [s], at least the slowest of the model [m/s]."""
        return max(self.seen.v_x + self.acceleration * time, SLOWEST)


def unmoved(vehicle: Vehicle, dt: float, delay: float | None) -> MotionEstimate:
    """Before the first observation, with a given ``delay`` [s] or one to be found."""
    known = 0.0 if delay is None else delay
    commands = np.zeros(int(max(known, _LONGEST) / dt + _SAME) + 2)
    delays = np.zeros(round(_LONGEST / _RESOLUTION) + 1)
    return MotionEstimate(
        vehicle, dt, commands, delays, np.zeros(_FRICTIONS), vehicle.friction, delay=known
    )


def first_seen(motion: MotionEstimate, o: Observation) -> MotionEstimate:
    """As if the present steering had been the command for a long time."""
    seen = Seen(o.v_x, o.v_y, o.yaw_rate, o.steer)
    return motion._replace(commands=np.full_like(motion.commands, o.steer), begun=True, seen=seen)


def commanded(motion: MotionEstimate, steer: float) -> MotionEstimate:
    """After another command [normalised]."""
    commands = np.empty_like(motion.commands)
    commands[0], commands[1:] = min(max(steer, -1.0), 1.0), motion.commands[:-1]
    return motion._replace(commands=commands)


def watched(
    motion: MotionEstimate,
    o: Observation,
    *,
    find_delay: bool,
    disturbance_time: float | None,
    find_friction: bool,
) -> MotionEstimate:
    """One period later.

    Args:
        motion: until now.
        o: the observation.
        find_delay: whether the delay is estimated.
        disturbance_time: time constant of the estimate of missing forces [s]; None: there is none.
        find_friction: whether the friction is estimated.
    """
    before, seen, dt = motion.seen, Seen(o.v_x, o.v_y, o.yaw_rate, o.steer), motion.dt
    if find_delay:
        motion = _judge_delays(motion, seen)
    blend = dt / (_SURGE_TIME + dt)
    surge = _within((seen.v_x - before.v_x) / dt, _FASTEST)
    acceleration = motion.acceleration + blend * (surge - motion.acceleration)
    side, yaw = _surprise(motion, o)
    if abs(side) < _JUMP_SIDE and abs(yaw) < _JUMP_YAW:
        if find_friction:
            motion = _judge_frictions(motion, seen, side, yaw)
        if disturbance_time is not None:
            gain = moving_time(o.v_x, dt) / dt / (disturbance_time + dt)
            lacks = motion.disturbance
            lacks = _within(lacks[0] + gain * side, _MOST), _within(lacks[1] + gain * yaw, _MOST)
            motion = motion._replace(disturbance=lacks)
    return motion._replace(seen=seen, acceleration=acceleration)


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)


def _judge_delays(motion: MotionEstimate, seen: Seen) -> MotionEstimate:
    """The delay that explains best how the measured steering followed the commands."""
    scores, dt = motion.delays.copy(), motion.dt
    row, keep = motion.vehicle.table.rows[0], max(1.0 - dt / _MEMORY, 0.0)
    best = kernel.score_delays(
        row, motion.commands, dt, _RESOLUTION, motion.seen.steer, seen.steer, keep, scores
    )
    present = min(round(motion.delay / _RESOLUTION), len(scores) - 1)
    better = scores[best] < _BETTER * scores[present]
    return motion._replace(delays=scores, delay=best * _RESOLUTION if better else motion.delay)


@lru_cache(maxsize=64)
def _tried(nominal: float) -> FloatArray:
    """The frictions that are tried, rising to the nominal one."""
    tried = np.geomspace(min(_ICE, 0.5 * nominal), nominal, _FRICTIONS)
    tried.setflags(write=False)
    return tried


def _judge_frictions(motion: MotionEstimate, seen: Seen, side: float, yaw: float) -> MotionEstimate:
    """The friction that explains best how the car moved; the nominal one unless that is wrong.

    What the forces change from one period to the next without the model is noise: a second
    difference of white noise has three times the variance of a first one.
    """
    before, dt, row = motion.seen, motion.dt, motion.vehicle.table.rows[0]
    lacks = motion.disturbance
    missed = np.array(grip.missed_forces(row, side + lacks[0] * dt, yaw + lacks[1] * dt, dt))
    blend = min(dt / _NOISE_TIME, 1.0)
    noise = motion.noise + blend * (np.square(missed - motion.missed) / 3.0 - motion.noise)
    v = max(0.5 * (before.v_x + seen.v_x), SLOWEST)
    v_y, rate = 0.5 * (before.v_y + seen.v_y), 0.5 * (before.yaw_rate + seen.yaw_rate)
    angle = kernel.wheel_angle(motion.vehicle.table, 0.5 * (before.steer + seen.steer), v)
    slips = np.array([angle - (v_y + row[car.L_F] * rate) / v, (row[car.L_R] * rate - v_y) / v])
    forces = missed + grip.axle_forces(row, motion.grips, slips[0], slips[1])
    offset = _without_slip(motion, slips, forces)
    forces = forces - offset
    tried, scores = _tried(motion.vehicle.friction), motion.frictions.copy()
    a_x, keep = motion.acceleration - v_y * rate, max(1.0 - dt / _GRIP_TIME, 0.0)
    best = grip.score_frictions(row, tried, v, a_x, slips, forces, noise, keep, scores)
    motion = motion._replace(frictions=scores, missed=missed, noise=noise, offset=offset)
    present = min(int(np.searchsorted(tried, motion.friction)), len(tried) - 1)
    nominal = present == len(tried) - 1
    if scores[present] - scores[best] <= (_DOUBTED if nominal else _REFINED):
        return motion
    if nominal:  # what was taken for missing forces was the missing grip
        motion = motion._replace(disturbance=(0.0, 0.0))
    return motion._replace(friction=float(tried[best]))


def _without_slip(motion: MotionEstimate, slips: FloatArray, forces: FloatArray) -> FloatArray:
    """The forces (2,) that are missing while an axle hardly slips [N].

    A wrong steering angle or side velocity moves a slip by a constant, and so the force of an axle
    that is far from its grip; saturation only shows at larger slips.
    """
    row = motion.vehicle.table.rows[0]
    linear = np.array([row[car.C_F], row[car.C_R]]) * slips
    grips = np.array(grip.axle_grips(row, motion.vehicle.friction, motion.seen.v_x, 0.0))
    little = np.abs(linear) < grip.LITTLE * grips
    blend = min(motion.dt / _OFFSET_TIME, 1.0)
    learned = motion.offset + blend * (forces - linear - motion.offset)
    return np.where(little, learned, motion.offset)


def _surprise(motion: MotionEstimate, o: Observation) -> tuple[float, float]:
    """Side velocity and yaw rate observed, less those the model predicted one period ago."""
    seen = motion.seen
    moved = np.array([0.0, 0.0, seen.v_y, seen.yaw_rate, seen.steer, 0.0])
    kernel.over_last_period(
        motion.vehicle.table,
        max(0.5 * (seen.v_x + o.v_x), SLOWEST),
        o.preview,
        o.spacing,
        np.array(motion.disturbance),
        motion.grips,
        motion.commands,
        motion.delay,
        motion.dt,
        moved,
        np.empty((2, kernel.N_MOTION)),
    )
    return o.v_y - float(moved[kernel.VY]), o.yaw_rate - float(moved[kernel.RATE])
