"""The steady turn: which steering, side-slip and throttle belong to a curvature and a speed.

Source of steady cornering: Rajamani, Vehicle Dynamics and Control, 2nd ed., sec. 3.3; here solved
for the whole four-wheel model.
"""

from __future__ import annotations

import math

import numpy as np

from steersman.kernels.compiled import allocating, kernel
from steersman.kernels.vehicle import (
    AX,
    AY,
    BRAKE,
    L_F,
    L_R,
    LOAD_AX,
    LOAD_AY,
    N_MOTION,
    STEER,
    THROTTLE,
    VX,
    VY,
    WHEEL,
    YAW_RATE,
    VehicleTable,
    derivative,
    map_acceleration,
    steer_for_wheel,
    tyres,
    wheel_tangents,
)
from steersman.types import FloatArray

# Below this speed a steady turn is kinematic [m/s].
_CREEP = 1.0


@kernel
def _turn_residual(
    table: VehicleTable, n: int, q: FloatArray, unknown: FloatArray, out: FloatArray
) -> None:
    """Accelerations left over in a turn with v_y, steering and throttle ``unknown``."""
    speed2 = q[VX] * q[VX] + q[VY] * q[VY]
    beta = unknown[0]
    speed = math.sqrt(speed2)
    q[VX], q[VY] = speed * math.cos(beta), speed * math.sin(beta)
    # In a steady turn the acceleration is centripetal, so its frame components follow beta.
    q[LOAD_AX], q[LOAD_AY] = -q[VY] * q[YAW_RATE], q[VX] * q[YAW_RATE]
    drive, brake = max(unknown[2], 0.0), max(-unknown[2], 0.0)
    derivative(table, n, tyres(table.rows[n]), q, unknown[1], drive, brake, out)


@kernel
def _holding_throttle(table: VehicleTable, speed: float) -> float:
    """Throttle that holds a speed on a straight, by bisection; the nearer end if none does."""
    low, high = table.map_throttle[0], table.map_throttle[-1]
    for _ in range(20):
        middle = 0.5 * (low + high)
        if map_acceleration(table, middle, speed) < 0.0:
            low = middle
        else:
            high = middle
    return float(0.5 * (low + high))


@kernel
def _determinant(a: FloatArray) -> float:
    """Of a matrix of order 3."""
    first = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    second = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    third = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    return float(a[0, 0] * first + a[0, 1] * second + a[0, 2] * third)


@kernel
def _correct(jac: FloatArray, rhs: FloatArray, unknown: FloatArray) -> bool:
    """One bounded step of Newton's on (3,) ``unknown``; False where ``jac`` is singular.

    By Cramer's rule: numba compiles numpy's solver for longer than the whole vehicle.
    """
    whole = _determinant(jac)
    if abs(whole) < 1e-12:
        return False
    for j in range(3):
        for i in range(3):  # rhs takes the place of column j, and back
            jac[i, j], rhs[i] = rhs[i], jac[i, j]
        step = _determinant(jac) / whole
        for i in range(3):
            jac[i, j], rhs[i] = rhs[i], jac[i, j]
        unknown[j] -= min(max(step, -0.2), 0.2)
    return True


@allocating
def steady_turn(
    table: VehicleTable, n: int, state: FloatArray, speed: float, curvature: float
) -> bool:
    """Set velocities and actuators of ``state`` to the steady turn of that curvature and speed.

    Newton's method on side-slip, steering and throttle. Pose is left alone: the caller turns the
    yaw by minus the side-slip. Returns whether the turn exists; if not, the wheels follow the
    curvature kinematically and speed is not held.
    """
    row = table.rows[n]
    unknown, base, moved = np.zeros(3), np.zeros(N_MOTION), np.zeros(N_MOTION)
    jac, rhs, q = np.zeros((3, 3)), np.zeros(3), np.zeros(N_MOTION)
    kinematic = math.atan((row[L_F] + row[L_R]) * curvature)
    unknown[0] = math.atan(row[L_R] * curvature)
    unknown[1] = steer_for_wheel(table, n, kinematic, speed)
    unknown[2] = _holding_throttle(table, speed)
    found = speed < _CREEP
    for _ in range(0 if found else 40):
        q[VX], q[VY], q[YAW_RATE] = speed, 0.0, speed * curvature
        _turn_residual(table, n, q, unknown, base)
        for i in range(3):
            rhs[i] = base[VX + i]
        if abs(rhs[0]) + abs(rhs[1]) + abs(rhs[2]) < 1e-10:
            found = True
            break
        for j in range(3):
            kept, eps = unknown[j], 1e-6
            unknown[j] = kept + eps
            q[VX], q[VY], q[YAW_RATE] = speed, 0.0, speed * curvature
            _turn_residual(table, n, q, unknown, moved)
            unknown[j] = kept
            for i in range(3):
                jac[i, j] = (moved[VX + i] - base[VX + i]) / eps
        if not _correct(jac, rhs, unknown):
            break
    if abs(unknown[1]) > 1.0 or abs(unknown[2]) > 1.0 or abs(unknown[0]) > 1.0:
        found = False
    if not found:
        unknown[0] = math.atan(row[L_R] * curvature)
        unknown[1] = min(max(steer_for_wheel(table, n, kinematic, speed), -1.0), 1.0)
        unknown[2] = 0.0
    beta = unknown[0]
    state[VX], state[VY] = speed * math.cos(beta), speed * math.sin(beta)
    state[YAW_RATE] = speed * curvature
    state[LOAD_AX], state[LOAD_AY] = -state[VY] * state[YAW_RATE], state[VX] * state[YAW_RATE]
    state[AX], state[AY] = state[LOAD_AX], state[LOAD_AY]
    state[STEER] = unknown[1]
    state[THROTTLE], state[BRAKE] = max(unknown[2], 0.0), max(-unknown[2], 0.0)
    state[WHEEL] = math.atan(wheel_tangents(table, n, unknown[1], state[VX])[2])
    return found
