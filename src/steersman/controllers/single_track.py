"""The linear single-track model: alone, in errors along a road, and its steady turn.

Rajamani, Vehicle Dynamics and Control, 2nd ed.: sec. 2.3 for [y, beta, psi, psi'], sec. 2.5 for
the errors xi = [e1, e1', e2, e2']: lateral error of the centre of mass [m], its rate [m/s],
heading error [rad], its rate [rad/s]. Input: the single-track wheel angle delta [rad].
Disturbance: the road's curvature kappa [1/m]; the desired yaw rate is v kappa. Errors and angles
are positive to the left.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.kernels import linear_system
from steersman.kernels.preview import curvature_at, fitted_curvature
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle

# Waypoints that have one curvature without any fit.
_THREE = 3


def single_track(vehicle: Vehicle, v0: float) -> tuple[FloatArray, FloatArray]:
    """Continuous A (4, 4) and B (4, 1) of the linear single-track model at speed ``v0`` [m/s]."""
    m, inertia, a, b = vehicle.mass, vehicle.yaw_inertia, vehicle.l_f, vehicle.l_r
    c_f, c_r = vehicle.c_f, vehicle.c_r
    matrix = np.zeros((4, 4))
    matrix[0, 1] = matrix[0, 2] = v0
    matrix[1, 1] = -(c_f + c_r) / (m * v0)
    matrix[1, 3] = -1.0 - (c_f * a - c_r * b) / (m * v0 * v0)
    matrix[2, 3] = 1.0
    matrix[3, 1] = -(c_f * a - c_r * b) / inertia
    matrix[3, 3] = -(c_f * a * a + c_r * b * b) / (inertia * v0)
    control = np.array([[0.0], [c_f / (m * v0)], [0.0], [c_f * a / inertia]])
    return matrix, control


def zero_order_hold(a: FloatArray, b: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Exact discretisation for inputs held over ``dt`` [s]: exp of the augmented matrix.

    ``a`` is (n, n), ``b`` (n, m).
    """
    n, m = b.shape
    block, exact = np.zeros((n + m, n + m)), np.empty((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    work = np.empty((linear_system.EXPONENTIAL_WORK, n + m, n + m))
    linear_system.exponential(block * dt, exact, work)
    return exact[:n, :n].copy(), exact[:n, n:].copy()


class ErrorModel(NamedTuple):
    """xi' = a xi + b delta + g kappa at one speed."""

    a: FloatArray
    """(4, 4)"""
    b: FloatArray
    """(4,) effect of the wheel angle."""
    g: FloatArray
    """(4,) effect of the curvature."""


def error_model(vehicle: Vehicle, v: float) -> ErrorModel:
    """The model of a vehicle's nominal parameters at speed ``v`` > 0 [m/s]; Rajamani eq. 2.45."""
    m, inertia = vehicle.mass, vehicle.yaw_inertia
    c_f, c_r, l_f, l_r = vehicle.c_f, vehicle.c_r, vehicle.l_f, vehicle.l_r
    moment = c_f * l_f - c_r * l_r
    damping = c_f * l_f * l_f + c_r * l_r * l_r
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1.0
    a[1] = 0.0, -(c_f + c_r) / (m * v), (c_f + c_r) / m, -moment / (m * v)
    a[3] = 0.0, -moment / (inertia * v), moment / inertia, -damping / (inertia * v)
    b = np.array([0.0, c_f / m, 0.0, c_f * l_f / inertia])
    g = np.array([0.0, -moment / m - v * v, 0.0, -damping / inertia])
    return ErrorModel(a, b, g)


def discrete(model: ErrorModel, dt: float) -> ErrorModel:
    """xi(k+1) = a xi(k) + b delta(k) + g kappa(k), exact for inputs held over ``dt`` [s]."""
    a, inputs = zero_order_hold(model.a, np.array([model.b, model.g]).T, dt)
    return ErrorModel(a, inputs[:, 0].copy(), inputs[:, 1].copy())


def steady_state(model: ErrorModel) -> tuple[FloatArray, float]:
    """Errors (4,) and wheel angle of the steady turn with e1 = 0, for a curvature of 1/m.

    Both are in proportion to the curvature; only e2, minus the side-slip, is not zero.
    """
    # Rows 1 and 3 of 0 = a xi + b delta + g kappa with xi = [0, 0, e2, 0], by Cramer's rule; the
    # determinant is c_f c_r (l_f + l_r) / (m I) in the model of errors.
    a_1, a_3 = float(model.a[1, 2]), float(model.a[3, 2])
    b_1, b_3 = float(model.b[1]), float(model.b[3])
    g_1, g_3 = float(model.g[1]), float(model.g[3])
    scale = a_1 * b_3 - a_3 * b_1
    heading, angle = (b_1 * g_3 - b_3 * g_1) / scale, (a_3 * g_1 - a_1 * g_3) / scale
    return np.array([0.0, 0.0, heading, 0.0]), angle


def steady_wheel_angle(vehicle: Vehicle, v: float, kappa: float) -> float:
    """Single-track wheel angle of the steady turn, Rajamani eq. 3.15 [rad]."""
    load_f = vehicle.mass * vehicle.l_r / vehicle.wheelbase
    load_r = vehicle.mass * vehicle.l_f / vehicle.wheelbase
    understeer = load_f / vehicle.c_f - load_r / vehicle.c_r
    return math.atan(vehicle.wheelbase * kappa) + understeer * v * v * kappa


def steady_side_slip(vehicle: Vehicle, v: float, kappa: float) -> float:
    """Side-slip of the steady turn at the centre of mass, Rajamani eq. 3.20 [rad]."""
    load_r = vehicle.mass * vehicle.l_f / vehicle.wheelbase
    return vehicle.l_r * kappa - load_r * v * v * kappa / vehicle.c_r


def errors(observation: Observation) -> tuple[float, float, float, float]:
    """The state xi of an observation, without the small-angle approximation of e1'."""
    o = observation
    c, s = math.cos(o.heading_error), math.sin(o.heading_error)
    along = o.v_x * c - o.v_y * s
    # The desired yaw rate is that of the road's point beside the car, which a car inside of the
    # bend passes faster. Half the radius is as near to the centre as this is meant for.
    beside = max(1.0 - o.curvature * o.lateral_error, 0.5)
    rate = o.yaw_rate - o.curvature * along / beside
    return o.lateral_error, o.v_x * s + o.v_y * c, o.heading_error, rate


def preview_curvature(observation: Observation, distance: float, window: float = 0.0) -> float:
    """Curvature of the road ``distance`` [m] ahead [1/m].

    Linear between the curvatures at waypoints; if ``window`` [m] spans more than three of them,
    that of a least-squares parabola over arc length through all that it spans. The window is
    moved to where the preview holds it.
    """
    o = observation
    count = min(2 * round(0.5 * window / o.spacing) + 1, len(o.preview))
    if count > _THREE:
        centre = round(distance / o.spacing)
        first = min(max(centre - count // 2, 0), len(o.preview) - count)
        return fitted_curvature(o.preview, first, count, o.spacing)
    if distance <= 0.0:
        return o.curvature
    return curvature_at(o.preview, o.spacing, o.curvature, distance)
