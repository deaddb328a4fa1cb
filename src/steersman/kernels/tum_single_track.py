"""Single-track car with Pacejka's tyres at static load and combined slip, as TUM-CONTROL has it.

Source: B. Zarrouki et al., TUM-CONTROL (github.com/TUMFTM/TUM-CONTROL), its simulation model;
rolling resistance after M. Gerdts, The single track model, 2003.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.kernels import vehicle as planar
from steersman.kernels.compiled import kernel
from steersman.kernels.vehicle import (
    GRAVITY,
    PSI,
    VX,
    VY,
    YAW_RATE,
    VehicleTable,
    wheel_demand,
    wheel_tangents,
)
from steersman.types import FloatArray

N_STATE = 6
# Longitudinal force takes at most this share of the combined limit.
_MOST_ALONG = 0.98
# Below this speed rolling resistance fades, so that it never drives a car backwards [m/s].
_ROLL_SPEED = 0.2


class SingleTrackTyres(NamedTuple):
    """Tyres of an axle each, and rolling resistance."""

    shape_front: float
    shape_rear: float
    curvature_front: float
    curvature_rear: float
    peak_front: float
    """Largest lateral force over friction and load [-]."""
    peak_rear: float
    """The same at the rear [-]."""
    rolling: float
    """Rolling resistance over load, at standstill [-]."""
    rolling1: float
    """Its growth with speed / (100 km/h) [-]."""
    rolling4: float
    """Its growth with the fourth power of that [-]."""


@kernel
def lateral_force(
    stiffness: float, shape: float, peak: float, curvature: float, angle: float, along: float
) -> float:
    """Lateral force of an axle [N], less under the share ``along`` of its longitudinal force."""
    b = stiffness / (shape * peak) * angle
    pure = peak * math.sin(shape * math.atan(b - curvature * (b - math.atan(b))))
    share = min(max(along, -_MOST_ALONG), _MOST_ALONG)
    return pure * math.sqrt(1.0 - share * share)


@kernel
def derivative(
    table: VehicleTable,
    n: int,
    t: SingleTrackTyres,
    q: FloatArray,
    inputs: FloatArray,
    out: FloatArray,
) -> None:
    """Time derivative of x, y, psi, v_x, v_y and yaw rate under the actuators' positions."""
    row = table.rows[n]
    v_x, v_y, rate = q[VX], q[VY], q[YAW_RATE]
    l_f, l_r, mass = row[planar.L_F], row[planar.L_R], row[planar.MASS]
    front, rear = wheel_demand(table, n, inputs[1], inputs[2], v_x)
    load_f = mass * GRAVITY * l_r / (l_f + l_r)
    load_r = mass * GRAVITY * l_f / (l_f + l_r)
    v = 3.6 * math.sqrt(v_x * v_x + v_y * v_y) / 100.0
    rolling = t.rolling + t.rolling1 * v + t.rolling4 * v**4
    rolling *= min(max(v_x / _ROLL_SPEED, -1.0), 1.0)
    x_f, x_r = front - rolling * load_f, rear - rolling * load_r
    # A slow car's slip angles are softened: the explicit integration needs it.
    speed = max(v_x, row[planar.SLIP_SPEED])
    delta = math.atan(wheel_tangents(table, n, inputs[0], abs(v_x))[2])
    angle_f = delta - math.atan((v_y + l_f * rate) / speed)
    angle_r = math.atan((l_r * rate - v_y) / speed)
    mu = row[planar.MU] * 0.5 * (row[planar.GRIP_LEFT] + row[planar.GRIP_RIGHT])
    y_f = lateral_force(
        row[planar.C_F],
        t.shape_front,
        t.peak_front * mu * load_f,
        t.curvature_front,
        angle_f,
        x_f / (load_f * math.sqrt(1.0 + t.shape_front**2)),
    )
    y_r = lateral_force(
        row[planar.C_R],
        t.shape_rear,
        t.peak_rear * mu * load_r,
        t.curvature_rear,
        angle_r,
        x_r / (load_r * math.sqrt(1.0 + t.shape_rear**2)),
    )
    c, s = math.cos(delta), math.sin(delta)
    across = y_f * c + x_f * s
    along = x_r - y_f * s + x_f * c - row[planar.DRAG] * v_x * abs(v_x)
    turning = l_f * across - l_r * y_r + row[planar.YAW_MOMENT]
    c, s = math.cos(q[PSI]), math.sin(q[PSI])
    out[planar.X] = v_x * c - v_y * s
    out[planar.Y] = v_x * s + v_y * c
    out[PSI] = rate
    out[VX] = along / mass + v_y * rate
    out[VY] = (y_r + across + row[planar.SIDE_FORCE]) / mass - v_x * rate
    out[YAW_RATE] = turning / row[planar.INERTIA]
