"""Arithmetic of the delay-aware MPC: motion during the delay, the plan, the delay itself.

Notation of docs/controllers.md. Deviations from the steady turn: xi = [e1, e1', e2, e2'] of the
errors, u of the wheel angle.
"""

from __future__ import annotations

import math

from steersman.kernels.actuator import slew
from steersman.kernels.compiled import kernel
from steersman.kernels.grip import axle_forces
from steersman.kernels.preview import curvature_at
from steersman.kernels.vehicle import (
    INERTIA,
    L_F,
    L_R,
    MASS,
    STEER_DOWN,
    STEER_UP,
    VehicleTable,
    wheel_tangents,
)
from steersman.types import FloatArray

# Columns of a motion: errors, side velocity, yaw rate, steering, distance driven.
E1, E2, VY, RATE, STEER, WAY = range(6)
N_MOTION = 6

# Longest substep of the prediction [s]; stable from 1 m/s for any road car.
_SUBSTEP = 0.005
# The road's point beside the car is undefined at the centre of its curvature.
_NEAREST = 0.2


@kernel
def wheel_angle(table: VehicleTable, steer: float, v: float) -> float:
    """Single-track wheel angle of a normalised steering at a speed [rad]."""
    return math.atan(wheel_tangents(table, 0, steer, v)[2])


@kernel
def _slope(
    table: VehicleTable,
    v: float,
    kappa: float,
    disturbance: FloatArray,
    grips: FloatArray,
    motion: FloatArray,
    out: FloatArray,
) -> None:
    """Time derivative of a motion, but for the steering: brush tyres, constant speed."""
    row = table.rows[0]
    e1, e2, v_y, rate = motion[E1], motion[E2], motion[VY], motion[RATE]
    delta = wheel_angle(table, motion[STEER], v)
    slip_f, slip_r = delta - (v_y + row[L_F] * rate) / v, (row[L_R] * rate - v_y) / v
    front, rear = axle_forces(row, grips, slip_f, slip_r)
    c, s = math.cos(e2), math.sin(e2)
    along = (v * c - v_y * s) / max(1.0 - kappa * e1, _NEAREST)
    out[E1] = v * s + v_y * c
    out[E2] = rate - kappa * along
    out[VY] = (front + rear) / row[MASS] - v * rate + disturbance[0]
    out[RATE] = (row[L_F] * front - row[L_R] * rear) / row[INERTIA] + disturbance[1]
    out[WAY] = along


@kernel
def hold(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: VehicleTable,
    v: float,
    preview: FloatArray,
    spacing: float,
    beside: float,
    disturbance: FloatArray,
    grips: FloatArray,
    command: float,
    duration: float,
    motion: FloatArray,
    work: FloatArray,
) -> None:
    """Move ``motion`` on by ``duration`` [s] while ``command`` acts on the steering.

    Midpoint rule; the steering slews exactly. ``disturbance`` (2,) are the side [m/s^2] and yaw
    acceleration [rad/s^2] that the model lacks, ``grips`` (2,) the axles' largest side forces [N],
    ``work`` (2, N_MOTION) is scratch.
    """
    if duration <= 0.0:
        return
    row = table.rows[0]
    count = int(math.ceil(duration / _SUBSTEP - 1e-9))
    h = duration / count
    k, q = work[0], work[1]
    for _ in range(count):
        kappa = curvature_at(preview, spacing, beside, motion[WAY])
        _slope(table, v, kappa, disturbance, grips, motion, k)
        for i in range(N_MOTION):
            q[i] = motion[i] + 0.5 * h * k[i]
        q[STEER] = slew(motion[STEER], command, row[STEER_UP], row[STEER_DOWN], 0.5 * h)
        _slope(table, v, kappa, disturbance, grips, q, k)
        for i in range(N_MOTION):
            if i != STEER:
                motion[i] += h * k[i]
        motion[STEER] = slew(q[STEER], command, row[STEER_UP], row[STEER_DOWN], 0.5 * h)


@kernel
def through_delay(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: VehicleTable,
    v: float,
    preview: FloatArray,
    spacing: float,
    beside: float,
    disturbance: FloatArray,
    grips: FloatArray,
    commands: FloatArray,
    delay: float,
    dt: float,
    motion: FloatArray,
    work: FloatArray,
) -> None:
    """Move ``motion`` on by the delay, under the commands given already, newest first."""
    whole = int(delay / dt + 1e-9)
    part = delay - whole * dt
    command = commands[min(whole, commands.shape[0] - 1)]
    hold(table, v, preview, spacing, beside, disturbance, grips, command, part, motion, work)
    for i in range(whole - 1, -1, -1):
        hold(table, v, preview, spacing, beside, disturbance, grips, commands[i], dt, motion, work)


@kernel
def over_last_period(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: VehicleTable,
    v: float,
    preview: FloatArray,
    spacing: float,
    disturbance: FloatArray,
    grips: FloatArray,
    commands: FloatArray,
    delay: float,
    dt: float,
    motion: FloatArray,
    work: FloatArray,
) -> None:
    """Move the motion of one period ago to the present; only VY, RATE and STEER mean something."""
    whole = int(delay / dt + 1e-9)
    part = delay - whole * dt
    last = commands.shape[0] - 1
    older, newer = commands[min(whole + 1, last)], commands[min(whole, last)]
    hold(table, v, preview, spacing, 0.0, disturbance, grips, older, part, motion, work)
    hold(table, v, preview, spacing, 0.0, disturbance, grips, newer, dt - part, motion, work)


@kernel
def road_ahead(
    preview: FloatArray, spacing: float, beside: float, start: float, step: float, out: FloatArray
) -> None:
    """Curvature in the middle of each stretch of ``step`` [m] from ``start`` on."""
    for i in range(out.shape[0]):
        out[i] = curvature_at(preview, spacing, beside, start + (i + 0.5) * step)


@kernel
def road_at(
    preview: FloatArray,
    spacing: float,
    beside: float,
    start: float,
    speeds: FloatArray,
    dt: float,
    out: FloatArray,
) -> None:
    """Curvature in the middle of each period's way from ``start`` [m] on, at changing speed."""
    for i in range(out.shape[0]):
        step = speeds[i] * dt
        out[i] = curvature_at(preview, spacing, beside, start + 0.5 * step)
        start += step


@kernel
def most_turned(road: FloatArray, v: float, rate: float) -> float:
    """Largest side acceleration of steady turns [m/s^2]: of the yaw rate, of the road's curvature.

    ``road`` are curvatures [1/m], ``v`` the speed [m/s], ``rate`` the yaw rate [rad/s].
    """
    most = abs(v * rate)
    for kappa in road:
        most = max(most, v * v * abs(kappa))
    return most


@kernel
def free_plan(  # noqa: PLR0917 - numba takes no keyword-only arguments
    a: FloatArray,
    b: FloatArray,
    heading: float,
    gain: FloatArray,
    ahead: FloatArray,
    road: FloatArray,
    xi: FloatArray,
    before: float,
    out: FloatArray,
    work: FloatArray,
) -> None:
    """The plan that no limit bounds: deviations u of the wheel angle, (N,).

    change(i) = -gain [xi(i), u(i-1)] - sum over j of ahead(j) (road(i+j) - road(i+j+1)); ``road``
    holds N + 1 curvatures, beyond the last it stays. ``xi`` (4,) and ``before``: state and last u.
    """
    n = out.shape[0]
    x, after = work[0], work[1]
    for i in range(4):
        x[i] = xi[i]
    u = before
    for i in range(n):
        change = -gain[4] * u
        for j in range(4):
            change -= gain[j] * x[j]
        for j in range(n - i):
            change -= ahead[j] * (road[i + j] - road[i + j + 1])
        u += change
        out[i] = u
        for k in range(4):
            after[k] = b[k] * u
            for j in range(4):
                after[k] += a[k, j] * x[j]
        after[2] += heading * (road[i] - road[i + 1])
        for k in range(4):
            x[k] = after[k]


@kernel
def within(plan: FloatArray, steady: FloatArray, before: float, most: float, step: float) -> bool:
    """Whether wheel angles ``plan`` + ``steady`` keep largest angle and largest step [rad]."""
    last = before
    for i in range(plan.shape[0]):
        angle = plan[i] + steady[i]
        if not (abs(angle) <= most and abs(angle - last) <= step):
            return False
        last = angle
    return True


@kernel
def clip(plan: FloatArray, steady: FloatArray, before: float, most: float, step: float) -> None:
    """Force ``plan`` into the limits, angle by angle."""
    last = before
    for i in range(plan.shape[0]):
        angle = min(max(plan[i] + steady[i], last - step), last + step)
        last = min(max(angle, -most), most)
        plan[i] = last - steady[i]


@kernel
def score_delays(
    row: FloatArray,
    commands: FloatArray,
    dt: float,
    resolution: float,
    before: float,
    now: float,
    keep: float,
    scores: FloatArray,
) -> int:
    """Judge delays of 0, 1, 2, ... times ``resolution`` [s] by the last period's steering.

    ``scores`` (n,) are sums of squared differences between the steering that each delay predicts
    and the one measured, older ones fading by ``keep`` a period. ``before`` and ``now`` are the
    steering measured at both ends of the period, ``commands`` newest first. Returns the best.
    """
    best, last = 0, commands.shape[0] - 1
    up, down = row[STEER_UP], row[STEER_DOWN]
    for i in range(scores.shape[0]):
        delay = i * resolution
        whole = int(delay / dt + 1e-9)
        part = delay - whole * dt
        steer = slew(before, commands[min(whole + 1, last)], up, down, part)
        steer = slew(steer, commands[min(whole, last)], up, down, dt - part)
        scores[i] = keep * scores[i] + (steer - now) ** 2
        if scores[i] < scores[best]:
            best = i
    return best
