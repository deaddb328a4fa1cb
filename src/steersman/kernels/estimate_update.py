"""The estimator's update: an observation corrects car, road and biases.

Independent measurements follow each other, each a scalar (Sarkka, Bayesian Filtering and Smoothing,
2013, sec. 4.3 and 5.2). docs/equations/estimated.md has the equations.
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
    OFFSET,
    POSE_D,
    RATE,
    SCALE,
    VX,
    VY,
    D,
    walk,
)
from steersman.kernels.sensor_noise import SHARE, parabola_share, points_variance
from steersman.types import FloatArray

# Columns of what is kept beside mean and covariance: whether there was an observation; the time
# that the estimates hold for; time and sum of the numbers of the last observation; the steering now
# and the last command; steps without a plausible road; number of observations; variance of a
# waypoint's errors and of the signals' noise; of each signal its last value, what the estimates
# then were, and by how much more than predicted it changed.
BEGUN, NOW, TIME, SEEN, STEER, COMMAND, LOST, COUNT, POINT, NOISE = range(10)
# Signals whose noise is watched: lateral error, heading error, v_x, v_y, yaw rate.
N_SIGNALS = 5
LAST, EXPECTED, CHANGE, VARIANCE = range(NOISE + N_SIGNALS, NOISE + 5 * N_SIGNALS, N_SIGNALS)
N_MEMORY = NOISE + 5 * N_SIGNALS
# Columns of the settings.
CURVATURE, SD_VY, SD_RATE, SD_SCALE, EXACT = range(5)
N_SETTINGS = 5
# Errors of measurements never vanish: SDs of waypoints [m]; lateral [m] and heading error [rad],
# v_x, v_y [m/s], yaw rate [rad/s].
_FLOOR_POINT = 1e-3
_FLOORS = (1e-3, 2e-4, 5e-3, 5e-3, 1e-3)
# What signals are taken to have at first, in the same units; found wrong within a second.
_FIRST_NOISE = (0.05, 0.01, 0.1, 0.1, 0.02)
# A signal that changes by more is an outlier, and no noise.
_MOST = (1.0, 0.3, 3.0, 3.0, 0.5)
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
def _signal(i: int, mean: FloatArray) -> float:
    """What the estimates let expect of signal ``i``."""
    if i == observe.O_D:
        return float(mean[D])
    if i == observe.O_HEADING:
        return float(mean[HEADING])
    if i == observe.O_VX:
        return float(mean[VX] * (1.0 + mean[SCALE]))
    return float(mean[VX + i - 2] + mean[BIAS_VY + i - 3])


@kernel
def listen(
    spacing: float, row: FloatArray, preview: FloatArray, kept: Estimates, spread: FloatArray
) -> None:
    """Bring the noise of waypoints and signals up to date, after the prediction."""
    memory, mean, _ = kept
    count = memory[COUNT]
    found = points_variance(preview, spread)
    if count == 0.0 or found > _SUDDEN * memory[POINT]:
        memory[POINT] = found
    else:
        memory[POINT] += max(SHARE, 1.0 / (count + 1.0)) * (found - memory[POINT])
    memory[POINT] = max(memory[POINT], _FLOOR_POINT * _FLOOR_POINT)
    shares = parabola_share(preview.shape[0], spacing)
    for i in range(N_SIGNALS):
        # A change beyond the predicted one holds the noise of both its ends: minus the product of
        # two that follow each other estimates the variance. An error of the prediction lasts, and
        # makes it smaller.
        change = (row[i] - memory[LAST + i]) - (_signal(i, mean) - memory[EXPECTED + i])
        if i == observe.O_HEADING:
            change = wrap_angle(change)
        change = min(max(change, -_MOST[i]), _MOST[i])
        if count > 1.0:
            product = -change * memory[CHANGE + i]
            memory[VARIANCE + i] += max(SHARE, 1.0 / count) * (product - memory[VARIANCE + i])
        found = memory[VARIANCE + i]
        if i < len(shares):  # twice what the waypoints make is none of the pose
            found -= 2.0 * shares[i] * (memory[POINT] - _FLOOR_POINT * _FLOOR_POINT)
        memory[NOISE + i] = max(found, _FLOORS[i] * _FLOORS[i])
        memory[NOISE + i] += _FIRST_NOISE[i] * _FIRST_NOISE[i] / (count + 1.0) ** 1.5
        memory[LAST + i], memory[CHANGE + i] = row[i], (change if count > 0.0 else 0.0)
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
    # An error along the road shifts what is known of it; taken as large as the one across.
    cov[OFFSET, OFFSET] += memory[NOISE] - _FLOORS[0] * _FLOORS[0]


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
    for i in range(2, N_SIGNALS):
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
    for i in range(N_SIGNALS):
        memory[EXPECTED + i] = _signal(i, mean)


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
        cov[LACK_Y, LACK_Y], cov[LACK_RATE, LACK_RATE] = 4.0, 1.0
        cov[BIAS_VY, BIAS_VY] = settings[SD_VY] * settings[SD_VY]
        cov[BIAS_RATE, BIAS_RATE] = settings[SD_RATE] * settings[SD_RATE]
        cov[SCALE, SCALE] = settings[SD_SCALE] * settings[SD_SCALE]
        update(h, spacing, row, preview, kept, work, False)
    memory[BEGUN], memory[LOST] = 1.0, 0.0
