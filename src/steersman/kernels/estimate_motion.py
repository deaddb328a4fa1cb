"""The estimator's prediction: car and road after a period, and the covariance with them.

Single track with linear tyres: Rajamani, Vehicle Dynamics and Control, 2nd ed., sec. 2.3; motion
along a road: sec. 2.5. Extended Kalman filter: Sarkka, Bayesian Filtering and Smoothing, 2013,
sec. 5.2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.kernels import vehicle as car
from steersman.kernels.compiled import kernel
from steersman.kernels.road_walk import (
    AX,
    BIAS_RATE,
    BIAS_VY,
    HEADING,
    LACK_RATE,
    LACK_Y,
    N_MOVED,
    NODES,
    OFFSET,
    RATE,
    SCALE,
    VX,
    VY,
    D,
    node_curvature,
)
from steersman.kernels.vehicle import VehicleTable, wheel_tangents
from steersman.types import FloatArray

# The car is taken to stand below this speed: tyres then say nothing of its motion [m/s].
STANDING = 1.0
# The road's point beside the car is undefined at the centre of its curvature.
_NEAREST = 0.2
# Lowest effect that the wheel angle may have: beyond full lock the tangent says little.
_NODES_AT_CAR = 4
# Growth of the variance in a second: lateral error [m^2], heading error, place along the road,
# velocities, acceleration; what the single track lacks; biases.
_GROWTH = (4e-6, 2e-7, 5e-4, 2e-3, 9.0, 8e-3, 2e-3)
_LACK = (2.0, 1.0)
"""Stationary deviations of the accelerations that the single track lacks [m/s^2], [rad/s^2]."""
_LACK_TIME = 1.0
"""Time in which they fade [s]."""
_BIAS_GROWTH = (1e-5, 1e-7, 1e-6)
"""Growth of the variances of the biases of v_y, of the yaw rate and of the scale of v_x."""


class Gain(NamedTuple):
    """Motion of v_y and yaw rate over a period: x(k+1) = phi x(k) + gamma (accelerations)."""

    phi_11: float
    phi_12: float
    phi_21: float
    phi_22: float
    gamma_11: float
    gamma_12: float
    gamma_21: float
    gamma_22: float


@kernel
def single_track(row: FloatArray, v: float, h: float) -> Gain:
    """Two steps of ``h`` [s] of the linear single track at ``v`` > 0 [m/s].

    Each is (I - A h + A^2 h^2 / 2)^-1, of order 2; it does not overshoot however slow the car is.
    """
    m, inertia, l_f, l_r = row[car.MASS], row[car.INERTIA], row[car.L_F], row[car.L_R]
    c_f, c_r = row[car.C_F], row[car.C_R]
    moment = l_f * c_f - l_r * c_r
    a, b = -h * (c_f + c_r) / (m * v), -h * (moment / (m * v) + v)
    c, d = -h * moment / (inertia * v), -h * (l_f * l_f * c_f + l_r * l_r * c_r) / (inertia * v)
    p, q = 1.0 - a + 0.5 * (a * a + b * c), -b + 0.5 * b * (a + d)
    r, s = -c + 0.5 * c * (a + d), 1.0 - d + 0.5 * (b * c + d * d)
    det = p * s - q * r
    p, q, r, s = s / det, -q / det, -r / det, p / det
    # gamma = phi (I - A h / 2) h
    g, i = h * (p * (1.0 - 0.5 * a) - 0.5 * q * c), h * (q * (1.0 - 0.5 * d) - 0.5 * p * b)
    j, k = h * (r * (1.0 - 0.5 * a) - 0.5 * s * c), h * (s * (1.0 - 0.5 * d) - 0.5 * r * b)
    return Gain(
        p * p + q * r, p * q + q * s, r * p + s * r, r * q + s * s,
        p * g + q * j + g, p * i + q * k + i, r * g + s * j + j, r * i + s * k + k,
    )  # fmt: skip


@kernel
def predict(
    table: VehicleTable,
    n: int,
    steer: float,
    dt: float,
    h: float,
    mean: FloatArray,
    cov: FloatArray,
    work: FloatArray,
) -> None:
    """Mean (N,) and covariance (N, N) after ``dt`` [s] with the mean steering ``steer``.

    ``work`` (at least N_MOVED, at least N) is scratch. Nodes are ``h`` [m] apart.
    """
    change = work[:N_MOVED]
    _move(table, n, steer, dt, h, mean, change)
    _spread(dt, abs(mean[VX]), change, cov, work[N_MOVED:])


@kernel
def _move(
    table: VehicleTable,
    n: int,
    steer: float,
    dt: float,
    h: float,
    mean: FloatArray,
    f: FloatArray,
) -> None:
    """Move the mean on; ``f`` (N_MOVED, N) becomes the Jacobian of the columns that move."""
    row = table.rows[n]
    for i in range(N_MOVED):
        for j in range(f.shape[1]):
            f[i, j] = 1.0 if i == j else 0.0
    v_x, v_y, rate = mean[VX], mean[VY], mean[RATE]
    keep = math.exp(-dt / _LACK_TIME)
    if v_x > STANDING:
        gain = single_track(row, v_x, 0.5 * dt)
        angle = math.atan(wheel_tangents(table, n, steer, v_x)[2])
        side = row[car.C_F] * angle / row[car.MASS] + mean[LACK_Y]
        turning = row[car.L_F] * row[car.C_F] * angle / row[car.INERTIA] + mean[LACK_RATE]
        mean[VY] = gain.phi_11 * v_y + gain.phi_12 * rate
        mean[VY] += gain.gamma_11 * side + gain.gamma_12 * turning
        mean[RATE] = gain.phi_21 * v_y + gain.phi_22 * rate
        mean[RATE] += gain.gamma_21 * side + gain.gamma_22 * turning
        f[VY, VY], f[VY, RATE], f[RATE, VY], f[RATE, RATE] = gain[:4]
        f[VY, LACK_Y], f[VY, LACK_RATE], f[RATE, LACK_Y], f[RATE, LACK_RATE] = gain[4:]
    f[VX, AX] = dt
    f[LACK_Y, LACK_Y] = f[LACK_RATE, LACK_RATE] = keep
    mean[LACK_Y] *= keep
    mean[LACK_RATE] *= keep
    mean[VX] += dt * mean[AX]
    v_x, v_y, rate = v_x + 0.5 * dt * mean[AX], 0.5 * (v_y + mean[VY]), 0.5 * (rate + mean[RATE])
    kappa = node_curvature(mean, h, mean[OFFSET])
    beside = max(1.0 - kappa * mean[D], _NEAREST)
    e, along = mean[HEADING], v_x
    for _ in range(2):  # the second time with the heading in the middle of the period
        along = (v_x * math.cos(e) - v_y * math.sin(e)) / beside
        kappa = node_curvature(mean, h, mean[OFFSET] + 0.5 * dt * along)
        e = mean[HEADING] + 0.5 * dt * (rate - kappa * along)
    c, s = math.cos(e), math.sin(e)
    bent = (kappa - node_curvature(mean, h, mean[OFFSET] - 0.5)) / (0.5 + 0.5 * dt * abs(along))
    cell = min(max(int((mean[OFFSET] + 0.5 * dt * along) / h), 0), mean.shape[0] - NODES - 2)
    w = min(max((mean[OFFSET] + 0.5 * dt * along) / h - cell, 0.0), 1.0)
    for j in range(f.shape[1]):
        g_x = (0.5 * dt if j == AX else 0.0) + (1.0 if j == VX else 0.0)
        g_y = 0.5 * (f[VY, j] + (1.0 if j == VY else 0.0))
        g_rate = 0.5 * (f[RATE, j] + (1.0 if j == RATE else 0.0))
        g_e = 0.5 * dt * g_rate + (1.0 if j == HEADING else 0.0)
        g_along = (c * g_x - s * g_y) / beside + (kappa * along if j == D else 0.0)
        f[D, j] += dt * (s * g_x + c * g_y + (v_x * c - v_y * s) * g_e)
        f[HEADING, j] += dt * (g_rate - kappa * g_along)
        f[OFFSET, j] += dt * g_along
    f[HEADING, OFFSET] -= dt * along * bent
    f[HEADING, NODES + cell] -= dt * along * (1.0 - w)
    f[HEADING, NODES + cell + 1] -= dt * along * w
    mean[D] += dt * (v_x * s + v_y * c)
    mean[HEADING] += dt * (rate - kappa * along)
    mean[OFFSET] += dt * along


@kernel
def _propagate(f: FloatArray, cov: FloatArray, work: FloatArray) -> None:
    """The covariance becomes F P F'."""
    size, reach = cov.shape[0], min(NODES + _NODES_AT_CAR, cov.shape[0])
    for i in range(N_MOVED):
        out = work[i]
        for k in range(size):
            out[k] = 0.0
        for j in range(reach):
            if f[i, j] != 0.0:
                share, source = f[i, j], cov[j]
                for k in range(size):
                    out[k] += share * source[k]
    for i in range(N_MOVED):
        for k in range(i + 1):
            total = 0.0
            for j in range(reach):
                total += f[k, j] * work[i, j]
            cov[i, k] = cov[k, i] = total
        for k in range(N_MOVED, size):
            cov[i, k] = cov[k, i] = work[i, k]


@kernel
def _spread(dt: float, v: float, f: FloatArray, cov: FloatArray, work: FloatArray) -> None:
    """The covariance becomes F P F' + Q; only the first N_MOVED rows of F are not the identity."""
    _propagate(f, cov, work)
    moving = min(v / 5.0, 1.0) * dt
    for i in range(3):
        cov[i, i] += _GROWTH[i] * moving
    cov[VX, VX] += _GROWTH[3] * dt
    cov[AX, AX] += _GROWTH[4] * dt
    cov[VY, VY] += _GROWTH[5] * dt
    cov[RATE, RATE] += _GROWTH[6] * dt
    cov[LACK_Y, LACK_Y] += 2.0 * dt / _LACK_TIME * _LACK[0] * _LACK[0]
    cov[LACK_RATE, LACK_RATE] += 2.0 * dt / _LACK_TIME * _LACK[1] * _LACK[1]
    cov[BIAS_VY, BIAS_VY] += _BIAS_GROWTH[0] * moving
    cov[BIAS_RATE, BIAS_RATE] += _BIAS_GROWTH[1] * moving
    cov[SCALE, SCALE] += _BIAS_GROWTH[2] * moving
