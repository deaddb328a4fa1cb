"""Fuses a noisy sensor's road over time into an observation with less noise."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.kernels import road_filter as kernel
from steersman.types import FloatArray, Observation

# The noise is estimated over about this time [s].
_NOISE_TIME = 2.0
# Standard deviation of errors [m, rad] and waypoints [m] that the first look is taken to have.
_FIRST_D, _FIRST_HEADING = 0.03, 0.005
# Number of observations that this guess weighs.
_FIRST_WEIGHT = 4.0
# Errors that differ more than this from those predicted are no noise: the filter restarts [m, rad].
_ELSEWHERE_D, _ELSEWHERE_HEADING = 2.0, 0.5


class RoadState(NamedTuple):
    """State of the filter, in the car's frame of the last observation."""

    points: FloatArray
    """(n, 2) waypoints [m]."""
    spread: FloatArray
    """(n,) their variances over that of a measured waypoint."""
    memory: FloatArray
    """Errors, their covariance and the noise of what is measured; columns as in the kernel."""
    motion: tuple[float, float, float]
    """v_x, v_y [m/s] and yaw rate [rad/s] of that observation."""
    kappa: float
    """Curvature beside the car then [1/m]."""


# Before the first observation; as a named tuple like every later one, so that a checkpoint of a
# demonstrator can keep it.
NOTHING_SEEN = RoadState(
    np.zeros((0, 2)), np.zeros(0), np.zeros(kernel.N_MEMORY), (0.0, 0.0, 0.0), 0.0
)


def first_look(o: Observation) -> RoadState:
    """The state after the first observation, which is taken as it is."""
    memory = np.zeros(kernel.N_MEMORY)
    memory[kernel.D], memory[kernel.HEADING] = o.lateral_error, o.heading_error
    # The first look is as uncertain as the noise, whatever that turns out to be.
    memory[kernel.P_DD] = memory[kernel.R_D] = _FIRST_D**2
    memory[kernel.P_HH] = memory[kernel.R_H] = _FIRST_HEADING**2
    memory[kernel.R_POINTS], memory[kernel.COUNT] = _FIRST_D**2, 1.0
    motion = (o.v_x, o.v_y, o.yaw_rate)
    return RoadState(o.preview.copy(), np.ones(len(o.preview)), memory, motion, o.curvature)


def fuse(state: RoadState, o: Observation, dt: float) -> tuple[Observation, RoadState]:
    """The observation with errors and waypoints fused over time, and the new state.

    An observation too far from the prediction is taken as a first look.

    Args:
        state: that of one period ago.
        o: the present observation. Its velocities, yaw rate and curvature are taken as exact.
        dt: control period [s].
    """
    v_x, v_y, rate = (0.5 * (a + b) for a, b in zip(state.motion, o[3:6], strict=True))
    memory = state.memory.copy()
    count, slow = memory[kernel.COUNT], dt / _NOISE_TIME
    kappa = 0.5 * (state.kappa + o.curvature)
    way = kernel.reckon_errors(v_x, v_y, rate, kappa, dt, memory)
    if not _plausible(memory, o):
        return o, first_look(o)
    kernel.correct_errors(
        o.lateral_error, o.heading_error, max(slow, 1.0 / (count + _FIRST_WEIGHT)), memory
    )
    half = 0.5 * rate * dt
    c, s = math.cos(half), math.sin(half)
    points, spread = np.empty_like(o.preview), np.empty(len(o.preview))
    kernel.fuse_points(
        o.preview,
        o.spacing,
        dt * (c * v_x - s * v_y),
        dt * (s * v_x + c * v_y),
        rate * dt,
        way,
        max(slow, 1.0 / (count + 1.0)),  # many waypoints at once say more than one pair of errors
        state.points,
        state.spread,
        memory,
        points,
        spread,
    )
    smooth = np.empty_like(points)
    factor = np.empty((len(points), len(points)))
    kernel.smooth_points(points, o.spacing, spread, memory[kernel.R_POINTS], factor, smooth)
    memory[kernel.COUNT] += 1.0
    if not (np.isfinite(smooth).all() and math.isfinite(memory.sum())):
        return o, first_look(o)
    quiet = o._replace(
        lateral_error=float(memory[kernel.D]),
        heading_error=math.remainder(float(memory[kernel.HEADING]), math.tau),
        preview=smooth,
    )
    return quiet, RoadState(points, spread, memory, (o.v_x, o.v_y, o.yaw_rate), o.curvature)


def _plausible(memory: FloatArray, o: Observation) -> bool:
    """Whether the predicted errors are finite and near those measured."""
    d, heading = float(memory[kernel.D]), float(memory[kernel.HEADING])
    if not abs(o.lateral_error - d) <= _ELSEWHERE_D or not abs(heading) < math.inf:
        return False
    return abs(math.remainder(o.heading_error - heading, math.tau)) <= _ELSEWHERE_HEADING
