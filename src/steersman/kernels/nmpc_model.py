"""The nonlinear MPC's car over a control period, with its derivatives.

Errors along the road and a single track as in ``kernels.mpc_delay``; wheel angle, speed and the
road's curvature are held over the period. The wheel angle is that of a front tyre without a limit
(``grip.angle_for_linear`` has the real one): its force is linear up to the grip, so that
Gauss-Newton steps neither overshoot nor stall where the tyre slides. The rear is a brush tyre.
The steady turn is Rajamani's (Vehicle Dynamics and Control, 2nd ed., sec. 3.3) with these tyres.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.grip import force_slope, slip_for_force
from steersman.kernels.tyre import side_force
from steersman.kernels.vehicle import C_F, C_R, INERTIA, L_F, L_R, MASS
from steersman.types import FloatArray

# States of a plan: lateral error [m], heading error [rad], side velocity [m/s], yaw rate [rad/s].
N_STATES = 4
# Rows of scratch that ``move`` needs.
N_WORK = 16
# Slower cars are taken for so fast, where the integration is stable [m/s].
SLOWEST = 2.0
# Longest step of the integration [s].
_SUBSTEP = 0.0125
# The road's point beside the car is undefined at the centre of its curvature.
_NEAREST = 0.2
# A sliding tyre counts as a little stiff, lest a plan sees no way back [share of its stiffness].
_LEAST_SLOPE = 0.05
# A steady turn takes at most this share of an axle's grip: beyond it there is none.
_MOST_GRIP = 0.98


@kernel
def steady_turn(
    row: FloatArray, v: float, kappa: float, lacks: FloatArray, grips: FloatArray
) -> tuple[float, float]:
    """Heading error and wheel angle [rad] of the steady turn on the path of curvature ``kappa``.

    ``lacks`` are the accelerations that the model lacks, (2,) [m/s^2], [rad/s^2]; ``grips`` the
    largest side forces of both axles (2,) [N].
    """
    l_f, l_r, rate = row[L_F], row[L_R], v * kappa
    force, moment = row[MASS] * (v * rate - lacks[0]), row[INERTIA] * lacks[1]
    most_f, most_r = _MOST_GRIP * grips[0], _MOST_GRIP * grips[1]
    front = min(max((l_r * force - moment) / (l_f + l_r), -most_f), most_f)
    rear = min(max((l_f * force + moment) / (l_f + l_r), -most_r), most_r)
    v_y = l_r * rate - v * slip_for_force(row[C_R], rear, grips[1])
    return -math.atan(v_y / v), front / row[C_F] + (v_y + l_f * rate) / v


@kernel
def _slope(  # noqa: PLR0917 - numba takes no keyword-only arguments
    row: FloatArray,
    v: float,
    kappa: float,
    lacks: FloatArray,
    grips: FloatArray,
    delta: float,
    z: FloatArray,
    out: FloatArray,
    by_state: FloatArray,
    by_angle: FloatArray,
) -> None:
    """Time derivative of the states ``z``, and its derivatives by states (4, 4) and angle (4,)."""
    e1, e2, v_y, rate = z[0], z[1], z[2], z[3]
    c, s = math.cos(e2), math.sin(e2)
    beside = 1.0 - kappa * e1
    near = max(beside, _NEAREST)
    along = (v * c - v_y * s) / near
    across = v * s + v_y * c
    slip_f, slip_r = delta - (v_y + row[L_F] * rate) / v, (row[L_R] * rate - v_y) / v
    front, rear = row[C_F] * slip_f, -side_force(row[C_R], slip_r, grips[1])
    front = min(max(front, -grips[0]), grips[0])
    k_f, k_r = row[C_F], max(force_slope(row[C_R], slip_r, grips[1]), _LEAST_SLOPE * row[C_R])
    m, inertia, l_f, l_r = row[MASS], row[INERTIA], row[L_F], row[L_R]
    out[0] = across
    out[1] = rate - kappa * along
    out[2] = (front + rear) / m - v * rate + lacks[0]
    out[3] = (l_f * front - l_r * rear) / inertia + lacks[1]
    by_state[:, :] = 0.0
    by_state[0, 1], by_state[0, 2] = v * c - v_y * s, c
    by_state[1, 0] = -kappa * kappa * along / near if beside > _NEAREST else 0.0
    by_state[1, 1], by_state[1, 2], by_state[1, 3] = kappa * across / near, kappa * s / near, 1.0
    by_state[2, 2] = -(k_f + k_r) / (m * v)
    by_state[2, 3] = (l_r * k_r - l_f * k_f) / (m * v) - v
    by_state[3, 2] = (l_r * k_r - l_f * k_f) / (inertia * v)
    by_state[3, 3] = -(l_f * l_f * k_f + l_r * l_r * k_r) / (inertia * v)
    by_angle[0] = by_angle[1] = 0.0
    by_angle[2], by_angle[3] = k_f / m, l_f * k_f / inertia


@kernel
def _product(a: FloatArray, b: FloatArray, scale: float, out: FloatArray) -> None:
    """Out = 1 + scale a b, for (4, 4)."""
    for i in range(N_STATES):
        for j in range(N_STATES):
            total = 0.0
            for k in range(N_STATES):
                total += a[i, k] * b[k, j]
            out[i, j] = scale * total + (1.0 if i == j else 0.0)


@kernel
def _follow(step: FloatArray, more: FloatArray, a: FloatArray, b: FloatArray) -> None:
    """A = step a and b = step b + more, in place; ``step`` and ``a`` are (4, 4)."""
    for j in range(N_STATES):
        x0, x1, x2, x3 = a[0, j], a[1, j], a[2, j], a[3, j]
        for i in range(N_STATES):
            a[i, j] = step[i, 0] * x0 + step[i, 1] * x1 + step[i, 2] * x2 + step[i, 3] * x3
    x0, x1, x2, x3 = b[0], b[1], b[2], b[3]
    for i in range(N_STATES):
        b[i] = more[i] + step[i, 0] * x0 + step[i, 1] * x1 + step[i, 2] * x2 + step[i, 3] * x3


@kernel
def move(  # noqa: PLR0917 - numba takes no keyword-only arguments
    row: FloatArray,
    v: float,
    kappa: float,
    lacks: FloatArray,
    grips: FloatArray,
    angle: float,
    dt: float,
    z: FloatArray,
    a: FloatArray,
    b: FloatArray,
    work: FloatArray,
) -> None:
    """Move states ``z`` on by ``dt`` [s], in place; ``a`` (4, 4) and ``b`` (4,) become derivatives.

    ``a`` is that of the states afterwards by those before, ``b`` that by the wheel angle: of the
    midpoint rule, exactly. ``work`` is scratch of shape (N_WORK, 4).
    """
    slope, middle, by_angle, more = work[0], work[1], work[2], work[3]
    early, late, step = work[4:8], work[8:12], work[12:16]
    count = int(math.ceil(dt / _SUBSTEP - 1e-9))
    h = dt / count
    for i in range(N_STATES):
        b[i] = 0.0
        for j in range(N_STATES):
            a[i, j] = 1.0 if i == j else 0.0
    for _ in range(count):
        _slope(row, v, kappa, lacks, grips, angle, z, slope, early, by_angle)
        for i in range(N_STATES):
            middle[i] = z[i] + 0.5 * h * slope[i]
            more[i] = 0.5 * h * by_angle[i]
            for j in range(N_STATES):
                early[i, j] = 0.5 * h * early[i, j] + (1.0 if i == j else 0.0)
        _slope(row, v, kappa, lacks, grips, angle, middle, slope, late, by_angle)
        _product(late, early, h, step)
        for i in range(N_STATES):
            z[i] += h * slope[i]
            total = by_angle[i]
            for k in range(N_STATES):
                total += late[i, k] * more[k]
            middle[i] = h * total
        _follow(step, middle, a, b)


@kernel
def errors(
    v: float, kappa: float, heading: float, z: FloatArray, xi: FloatArray, by_state: FloatArray
) -> None:
    """Errors less the steady turn's, xi = [e1, e1', e2, e2'] (4,), and their derivatives (4, 4)."""
    c, s = math.cos(z[1]), math.sin(z[1])
    beside = 1.0 - kappa * z[0]
    near = max(beside, _NEAREST)
    along = (v * c - z[2] * s) / near
    across = v * s + z[2] * c
    xi[0], xi[1], xi[2], xi[3] = z[0], across, z[1] - heading, z[3] - kappa * along
    by_state[:, :] = 0.0
    by_state[0, 0] = by_state[2, 1] = by_state[3, 3] = 1.0
    by_state[1, 1], by_state[1, 2] = v * c - z[2] * s, c
    by_state[3, 0] = -kappa * kappa * along / near if beside > _NEAREST else 0.0
    by_state[3, 1], by_state[3, 2] = kappa * across / near, kappa * s / near
