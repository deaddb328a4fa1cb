"""The estimator's update: an observation corrects car, road and biases.

Independent measurements follow each other, each a scalar (Sarkka, Bayesian Filtering and Smoothing,
2013, sec. 4.3 and 5.2). docs/equations/estimator.md has the equations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.kernels import observe
from steersman.kernels.compiled import kernel
from steersman.kernels.observe import wrap_angle
from steersman.kernels.road_walk import (
    BIAS_RATE,
    BIAS_VY,
    HEADING,
    LACK_RATE,
    LACK_Y,
    NODES,
    POSE_D,
    RATE,
    SCALE,
    VX,
    VY,
    D,
    walk,
)
from steersman.kernels.sensor_noise import points_variance, variance, watch
from steersman.types import FloatArray

# Columns of what is kept beside mean and covariance: whether there was an observation; the time
# that the estimates hold for; time and sum of the numbers of the last observation; the steering now
# and the last command; steps without a plausible road; number of observations; variance of a
# waypoint's errors, of the signals' noise; medians of the signals' surprises.
BEGUN, NOW, TIME, SEEN, STEER, COMMAND, LOST, COUNT, POINT, NOISE = range(10)
# Signals whose noise is watched: lateral error, heading error, v_x, v_y, yaw rate.
_N_SIGNALS = 5
SIZES = NOISE + _N_SIGNALS
N_MEMORY = SIZES + _N_SIGNALS
# Columns of the settings.
CURVATURE, SD_VY, SD_RATE, SD_SCALE, EXACT = range(5)
N_SETTINGS = 5
# Errors of measurements never vanish: SDs of waypoints [m]; lateral [m] and heading error [rad],
# v_x, v_y [m/s], yaw rate [rad/s].
_FLOOR_POINT = 1e-3
_FLOORS = (1e-3, 2e-4, 5e-3, 5e-3, 1e-3)
# Deviations from the prediction, in SDs and beside [m], [m/s], [rad/s], beyond which a measurement
# is an outlier.
_GATE = 6.0
_FAR_POINT, _FAR_SPEED, _FAR_RATE = 0.1, 2.0, 0.5
# SDs of the first look: lateral error [m], heading error [rad], curvature [1/m]; of v_x, v_y [m/s],
# yaw rate [rad/s], longitudinal acceleration [m/s^2].
_FIRST = (0.5, 0.2, 0.05)
_FIRST_MOTION = (1.0, 1.0, 0.5, 3.0)
# Looks at the first observation: each linearises about the road that the last one found.
_LOOKS = 4
# Weight of the present waypoints in the estimate of their noise, in the long run.
_SHARE = 0.03
# Noise of waypoints that grows more than this from one look to the next is believed at once.
_SUDDEN = 4.0


class Estimates(NamedTuple):
    """What is kept for one vehicle."""

    memory: FloatArray
    """(N_MEMORY,)"""
    mean: FloatArray
    """(N,) columns as in ``road_walk``."""
    cov: FloatArray
    """(N, N)"""


class EstimatorWork(NamedTuple):
    """Arrays to work in, for n waypoints."""

    rows: FloatArray
    """(2 N_MOVED, N)"""
    points: FloatArray
    """(n, 2)"""
    directions: FloatArray
    """(n,)"""
    jacobian: FloatArray
    """(n, N)"""
    spread: FloatArray
    """(2 n,)"""


@kernel
def _surprise(i: int, row: FloatArray, mean: FloatArray, cov: FloatArray) -> tuple[float, float]:
    """Signal ``i`` less its prediction, and that one's variance."""
    if i == observe.O_D:
        return row[i] - mean[D], cov[D, D]
    if i == observe.O_HEADING:
        return wrap_angle(row[i] - mean[HEADING]), cov[HEADING, HEADING]
    if i == observe.O_VX:
        scale = 1.0 + mean[SCALE]
        spread = cov[VX, VX] + mean[VX] * (2.0 * cov[VX, SCALE] + mean[VX] * cov[SCALE, SCALE])
        return row[i] - mean[VX] * scale, spread
    j, bias = VX + i - 2, BIAS_VY + i - 3
    return row[i] - mean[j] - mean[bias], cov[j, j] + 2.0 * cov[j, bias] + cov[bias, bias]


@kernel
def listen(row: FloatArray, preview: FloatArray, kept: Estimates, spread: FloatArray) -> None:
    """Bring the noise of waypoints and signals up to date, after the prediction."""
    memory, mean, cov = kept
    count, n = memory[COUNT], preview.shape[0]
    found = points_variance(preview, spread)
    if count == 0.0 or found > _SUDDEN * memory[POINT]:
        memory[POINT] = found
    else:
        memory[POINT] += max(_SHARE, 1.0 / (count + 1.0)) * (found - memory[POINT])
    memory[POINT] = max(memory[POINT], _FLOOR_POINT * _FLOOR_POINT)
    if count > 0.0:
        for i in range(_N_SIGNALS):
            surprise, spread_of = _surprise(i, row, mean, cov)
            size = watch(memory[SIZES + i], surprise, count - 1.0)
            memory[SIZES + i] = size
            memory[NOISE + i] = variance(size) - spread_of
    # Errors measured may be those of a parabola through the waypoints: what its end and its slope
    # there take over from them is no error of the pose.
    end = 3.0 * (3.0 * n * n - 3.0 * n + 2.0) / (n * (n + 1.0) * (n + 2.0))
    gap = preview[n - 1, 0] - preview[0, 0], preview[n - 1, 1] - preview[0, 1]
    spacing = math.hypot(gap[0], gap[1]) / (n - 1.0)
    slope = 12.0 * (2.0 * n - 1.0) * (8.0 * n - 11.0)
    slope /= n * (n * n - 1.0) * (n * n - 4.0) * spacing * spacing + 1e-9
    for i, share in ((0, end), (1, slope)):
        taken = 1.5 * share * (memory[POINT] - _FLOOR_POINT * _FLOOR_POINT)
        memory[NOISE + i] -= taken
    for i in range(_N_SIGNALS):
        memory[NOISE + i] = max(memory[NOISE + i], _FLOORS[i] * _FLOORS[i])
    memory[COUNT] = count + 1.0


@kernel
def _assimilate(
    h: FloatArray, surprise: float, noise: float, far: float, cov: FloatArray, work: FloatArray
) -> bool:
    """Take in one scalar measurement; returns whether it was no outlier.

    ``h`` (N,) is its derivative, ``surprise`` its difference from the prediction that the update
    began with, ``work`` (2, N) the change of the mean since then and scratch.
    """
    size = cov.shape[0]
    change, gain = work[0], work[1]
    for k in range(size):
        gain[k] = 0.0
    for j in range(size):
        if h[j] != 0.0:
            share, source = h[j], cov[j]
            surprise -= share * change[j]
            for k in range(size):
                gain[k] += share * source[k]
    total = noise
    for j in range(size):
        total += h[j] * gain[j]
    if not abs(surprise) <= max(_GATE * math.sqrt(total), far):
        return False
    for i in range(size):
        share, target = gain[i] / total, cov[i]
        change[i] += share * surprise
        for j in range(size):
            target[j] -= share * gain[j]
    return True


@kernel
def _forget_pose(memory: FloatArray, mean: FloatArray, cov: FloatArray) -> None:
    """The errors of the measured pose are new at each look."""
    for i in range(POSE_D, NODES):
        mean[i] = 0.0
        for j in range(mean.shape[0]):
            cov[i, j] = cov[j, i] = 0.0
        cov[i, i] = memory[NOISE + i - POSE_D]


@kernel
def update(
    h: float,
    spacing: float,
    row: FloatArray,
    preview: FloatArray,
    kept: Estimates,
    work: EstimatorWork,
    gated: bool,
) -> None:
    """Correct the estimates by an observation; ``work.spread[i]`` is 1 for a waypoint taken in.

    Not ``gated``, nothing is an outlier.
    """
    memory, mean, cov = kept
    n, size = preview.shape[0], mean.shape[0]
    _forget_pose(memory, mean, cov)
    walk(mean, h, spacing, work.points, work.directions, work.jacobian, work.rows)
    change, h_row = work.rows[:2], work.rows[2]
    for j in range(size):
        change[0, j] = h_row[j] = 0.0
    far, taken = (_FAR_POINT if gated else math.inf), 0
    for i in range(n):
        c, s = math.cos(work.directions[i]), math.sin(work.directions[i])
        x, y = preview[i, 0] - work.points[i, 0], preview[i, 1] - work.points[i, 1]
        good = _assimilate(work.jacobian[i], c * y - s * x, memory[POINT], far, cov, change)
        work.spread[i] = 1.0 if good else 0.0
        taken += int(good)
    memory[LOST] = 0.0 if 2 * taken >= n else memory[LOST] + 1.0
    for i in range(2, _N_SIGNALS):
        j = VX + i - 2
        bias = SCALE if i == 2 else BIAS_VY + i - 3
        h_row[j], h_row[bias] = 1.0, 1.0
        predicted = mean[j] + mean[bias]
        if bias == SCALE:
            h_row[j], h_row[bias] = 1.0 + mean[SCALE], mean[VX]
            predicted = mean[VX] * (1.0 + mean[SCALE])
        far = math.inf
        if gated:
            far = _FAR_RATE if j == RATE else _FAR_SPEED
        _assimilate(h_row, row[i] - predicted, memory[NOISE + i], far, cov, change)
        h_row[j] = h_row[bias] = 0.0
    for j in range(size):
        mean[j] += change[0, j]


@kernel
def begin(
    settings: FloatArray,
    h: float,
    spacing: float,
    row: FloatArray,
    preview: FloatArray,
    kept: Estimates,
    work: EstimatorWork,
) -> None:
    """Take the first look: a road of the measured curvature, corrected by the waypoints."""
    memory, mean, cov = kept
    size = mean.shape[0]
    for j in range(size):
        mean[j] = row[observe.O_KAPPA] if j >= NODES else 0.0
    mean[D], mean[HEADING] = row[observe.O_D], row[observe.O_HEADING]
    mean[VX], mean[VY], mean[RATE] = row[observe.O_VX], row[observe.O_VY], row[observe.O_RATE]
    growth = settings[CURVATURE] * settings[CURVATURE] * h
    for _ in range(_LOOKS):
        for i in range(size):
            for j in range(size):
                cov[i, j] = 0.0
                if i >= NODES and j >= NODES:
                    cov[i, j] = _FIRST[2] * _FIRST[2] + growth * (min(i, j) - NODES)
        cov[D, D], cov[HEADING, HEADING] = _FIRST[0] * _FIRST[0], _FIRST[1] * _FIRST[1]
        for i in range(4):
            cov[VX + i, VX + i] = _FIRST_MOTION[i] * _FIRST_MOTION[i]
        cov[LACK_Y, LACK_Y] = cov[LACK_RATE, LACK_RATE] = 0.01
        cov[BIAS_VY, BIAS_VY] = settings[SD_VY] * settings[SD_VY]
        cov[BIAS_RATE, BIAS_RATE] = settings[SD_RATE] * settings[SD_RATE]
        cov[SCALE, SCALE] = settings[SD_SCALE] * settings[SD_SCALE]
        update(h, spacing, row, preview, kept, work, False)
    memory[BEGUN], memory[LOST] = 1.0, 0.0
