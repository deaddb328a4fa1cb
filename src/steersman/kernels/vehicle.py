"""Planar four-wheel vehicle: forces, actuators, integration, steady turns. ISO 8855 signs.

State row (columns below): global position and yaw of the centre of mass, velocities in the
vehicle's frame, load-transfer accelerations, actuator positions, and, as outputs of the last
step, accelerations and the single-track wheel angle. Wheels do not spin up: each carries the
longitudinal force of engine and brakes, at most what its grip allows. Source: planar rigid body and
steady cornering, Rajamani, Vehicle Dynamics and Control, 2nd ed., ch. 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.kernels import tyre
from steersman.kernels.actuator import slew, slew_lagged
from steersman.kernels.compiled import inlined, kernel
from steersman.types import FloatArray

GRAVITY = 9.81

# Columns of a state row.
X, Y, PSI, VX, VY, YAW_RATE, LOAD_AX, LOAD_AY = range(8)
STEER, THROTTLE, BRAKE, AX, AY, WHEEL = range(8, 14)
N_STATE = 14
N_MOTION = 8
# Columns of a command row.
CMD_STEER, CMD_THROTTLE, CMD_BRAKE = range(3)
# Columns of a parameter row; units in steersman.vehicles.
(
    MASS,
    INERTIA,
    L_F,
    L_R,
    TRACK,
    ROLL_ARM,
    C_F,
    C_R,
    MU,
    DRAG,
    DRIVE_FRONT,
    BRAKE_FORCE,
    BRAKE_FRONT,
    MAX_STEER,
    ACKERMANN,
    STEER_UP,
    STEER_DOWN,
    PEDAL_UP,
    PEDAL_DOWN,
    MAP_MASS,
    MAP_DRAG,
    LOAD_LAG,
    FADE_SPEED,
    SLIP_SPEED,
    STEER_BIAS,
    SIDE_FORCE,
    YAW_MOMENT,
    STEER_LAG,
    LOAD_LIMIT,
    ROTATING,
    GRIP_LEFT,
    GRIP_RIGHT,
) = range(32)
N_PARAMS = 32

# Below this speed resistance fades, so that it never drives a standing car backwards [m/s].
_ROLL_SPEED = 0.2


class VehicleTable(NamedTuple):
    """Parameters of N vehicles and the maps they share."""

    rows: FloatArray
    """(N, N_PARAMS) parameters."""
    steer_speed: FloatArray
    """Speeds of the steering curve [m/s]."""
    steer_factor: FloatArray
    """Share of the full wheel angle that is available at those speeds [-]."""
    map_throttle: FloatArray
    """Throttle positions of the longitudinal map [-]."""
    map_speed: FloatArray
    """Speeds of the longitudinal map [m/s]."""
    map_accel: FloatArray
    """Net acceleration on a straight, (throttles, speeds) [m/s^2]."""


@inlined
def interpolate(grid: FloatArray, values: FloatArray, at: float) -> float:
    """Piecewise linear, held constant beyond the ends."""
    if at <= grid[0]:
        return float(values[0])
    for i in range(1, grid.shape[0]):
        if at < grid[i]:
            w = (at - grid[i - 1]) / (grid[i] - grid[i - 1])
            return float(values[i - 1] + w * (values[i] - values[i - 1]))
    return float(values[-1])


@inlined
def wheel_tangents(
    table: VehicleTable, n: int, steer: float, speed: float
) -> tuple[float, float, float]:
    """Tangents of the left, right and single-track front wheel angles.

    Inner wheel = steer x largest angle x curve(speed); cot(outer) = cot(inner) + Ackermann.
    Misaligned steering adds its bias to ``steer``.
    """
    row = table.rows[n]
    steer += row[STEER_BIAS]
    factor = interpolate(table.steer_speed, table.steer_factor, speed)
    inner = math.tan(abs(steer) * row[MAX_STEER] * factor)
    outer = inner / (1.0 + row[ACKERMANN] * inner)
    middle = inner / (1.0 + 0.5 * row[ACKERMANN] * inner)
    if steer >= 0.0:
        return inner, outer, middle
    return -outer, -inner, -middle


@kernel
def steer_for_wheel(table: VehicleTable, n: int, wheel_angle: float, speed: float) -> float:
    """Normalised steering that gives the single-track wheel angle [rad]; not clipped."""
    row = table.rows[n]
    factor = interpolate(table.steer_speed, table.steer_factor, speed)
    middle = math.tan(min(abs(wheel_angle), 1.5))
    inner = middle / max(1.0 - 0.5 * row[ACKERMANN] * middle, 1e-9)
    steer = math.copysign(math.atan(inner) / (row[MAX_STEER] * factor), wheel_angle)
    return float(steer - row[STEER_BIAS])


@inlined
def map_acceleration(table: VehicleTable, throttle: float, speed: float) -> float:
    """Net acceleration on a straight for a throttle position and speed, bilinear [m/s^2]."""
    t, v, a = table.map_throttle, table.map_speed, table.map_accel
    i = 1
    while i < t.shape[0] - 1 and throttle >= t[i]:
        i += 1
    wt = min(max((throttle - t[i - 1]) / (t[i] - t[i - 1]), 0.0), 1.0)
    j = 1
    while j < v.shape[0] - 1 and speed >= v[j]:
        j += 1
    wv = min(max((speed - v[j - 1]) / (v[j] - v[j - 1]), 0.0), 1.0)
    low = a[i - 1, j - 1] + wv * (a[i - 1, j] - a[i - 1, j - 1])
    high = a[i, j - 1] + wv * (a[i, j] - a[i, j - 1])
    return float(low + wt * (high - low))


@inlined
def wheel_demand(
    table: VehicleTable, n: int, throttle: float, brake: float, v_x: float
) -> tuple[float, float]:
    """Longitudinal force at the front and at the rear axle at constant speed [N].

    The map is a net acceleration, of body and rotating masses; its vehicle's drag is given back
    here and taken by the body.
    """
    row = table.rows[n]
    speed = abs(v_x)
    held = min(speed, table.map_speed[-1])
    moved = row[MAP_MASS] + row[ROTATING]
    force = moved * map_acceleration(table, throttle, held) + row[MAP_DRAG] * held * held
    if speed > row[FADE_SPEED] and force > 0.0:
        force *= row[FADE_SPEED] / speed
    fade = v_x / math.sqrt(v_x * v_x + _ROLL_SPEED * _ROLL_SPEED)
    if force < 0.0:
        force *= fade
    braking = -row[BRAKE_FORCE] * brake * fade
    front = force * row[DRIVE_FRONT] + braking * row[BRAKE_FRONT]
    return front, force + braking - front


@inlined
def wheel_loads(row: FloatArray, a_x: float, a_y: float) -> tuple[float, float, float, float]:
    """Vertical loads, front left, front right, rear left, rear right [N]; lifted wheels carry 0.

    Roll moments are shared by the axles in proportion to their static loads.
    """
    base = row[L_F] + row[L_R]
    shift = row[MASS] * a_x * row[ROLL_ARM] / base
    weight = row[MASS] * GRAVITY
    front = min(max(weight * row[L_R] / base - shift, 0.0), weight)
    rear = weight - front
    lean = min(max(a_y * row[ROLL_ARM] / (GRAVITY * row[TRACK]), -0.5), 0.5)
    return front * (0.5 - lean), front * (0.5 + lean), rear * (0.5 - lean), rear * (0.5 + lean)


@inlined
def tyres(row: FloatArray) -> tuple[tyre.AxleTyres, tyre.AxleTyres]:
    """Tyres of the front and of the rear axle."""
    base, limit = row[L_F] + row[L_R], row[LOAD_LIMIT]
    front, rear = row[MASS] * GRAVITY * row[L_R], row[MASS] * GRAVITY * row[L_F]
    return (
        tyre.axle_tyres(row[C_F] * base / front, 0.5 * front / base, limit),
        tyre.axle_tyres(row[C_R] * base / rear, 0.5 * rear / base, limit),
    )


@inlined
def derivative(
    table: VehicleTable,
    n: int,
    axles: tuple[tyre.AxleTyres, tyre.AxleTyres],
    q: FloatArray,
    steer: float,
    throttle: float,
    brake: float,
    out: FloatArray,
) -> tuple[float, float]:
    """Time derivative of N_MOTION state columns, with :func:`tyres`; returns a_x, a_y [m/s^2]."""
    row, v_x, v_y, rate = table.rows[n], q[VX], q[VY], q[YAW_RATE]
    left, right, _ = wheel_tangents(table, n, steer, abs(v_x))
    demand_f, demand_r = wheel_demand(table, n, throttle, brake, v_x)
    # Rotating masses take their share while the speed changes: first that of the lagged
    # acceleration, from which the one that is sought differs little.
    turned = row[ROTATING] * (q[LOAD_AX] + v_y * rate)
    demand_f -= turned * row[DRIVE_FRONT]
    demand_r -= turned * (1.0 - row[DRIVE_FRONT])
    fl, fr, rl, rr = wheel_loads(row, q[LOAD_AX], q[LOAD_AY])
    c1, c2 = tyre.tyre_stiffness(axles[0], fl), tyre.tyre_stiffness(axles[0], fr)
    c3, c4 = tyre.tyre_stiffness(axles[1], rl), tyre.tyre_stiffness(axles[1], rr)
    mu, half, soft = row[MU], 0.5 * row[TRACK], row[SLIP_SPEED]
    y_f, y_r = v_y + row[L_F] * rate, v_y - row[L_R] * rate
    x_l, x_r = v_x - half * rate, v_x + half * rate
    mu_l, mu_r = mu * row[GRIP_LEFT], mu * row[GRIP_RIGHT]
    demand1, demand2 = tyre.split_axle(demand_f, mu_l * fl, mu_r * fr)
    demand3, demand4 = tyre.split_axle(demand_r, mu_l * rl, mu_r * rr)
    fx1, fy1 = tyre.wheel_force(c1, mu_l * fl, demand1, left, x_l, y_f, soft)
    fx2, fy2 = tyre.wheel_force(c2, mu_r * fr, demand2, right, x_r, y_f, soft)
    fx3, fy3 = tyre.wheel_force(c3, mu_l * rl, demand3, 0.0, x_l, y_r, soft)
    fx4, fy4 = tyre.wheel_force(c4, mu_r * rr, demand4, 0.0, x_r, y_r, soft)
    drag = row[DRAG] * v_x * abs(v_x)
    along, across = fx1 + fx2 + fx3 + fx4, fy1 + fy2 + fy3 + fy4
    if row[ROTATING] > 0.0:
        share = row[ROTATING] / (row[MASS] + row[ROTATING])
        along -= share * (along - drag - row[MASS] * q[LOAD_AX])
        grip = mu_l * (fl + rl) + mu_r * (fr + rr)
        most = math.sqrt(max(grip * grip - across * across, 0.0))
        along = min(max(along, -most), most)
    a_x = (along - drag) / row[MASS]
    a_y = (across + row[SIDE_FORCE]) / row[MASS]
    turning = row[L_F] * (fy1 + fy2) - row[L_R] * (fy3 + fy4) + half * (fx2 + fx4 - fx1 - fx3)
    turning += row[YAW_MOMENT]
    c, s = math.cos(q[PSI]), math.sin(q[PSI])
    out[X] = c * v_x - s * v_y
    out[Y] = s * v_x + c * v_y
    out[PSI] = rate
    out[VX] = a_x + v_y * rate
    out[VY] = a_y - v_x * rate
    out[YAW_RATE] = turning / row[INERTIA]
    out[LOAD_AX] = (a_x - q[LOAD_AX]) / row[LOAD_LAG]
    out[LOAD_AY] = (a_y - q[LOAD_AY]) / row[LOAD_LAG]
    return a_x, a_y


@inlined
def move_inputs(row: FloatArray, inputs: FloatArray, command: FloatArray, h: float) -> None:
    """Move steering, throttle and brake towards a command for ``h`` [s], in place."""
    up, down, lag = row[STEER_UP], row[STEER_DOWN], row[STEER_LAG]
    inputs[0] = slew_lagged(inputs[0], command[CMD_STEER], up, down, lag, h)
    inputs[1] = slew(inputs[1], command[CMD_THROTTLE], row[PEDAL_UP], row[PEDAL_DOWN], h)
    inputs[2] = slew(inputs[2], command[CMD_BRAKE], row[PEDAL_UP], row[PEDAL_DOWN], h)


@kernel
def advance(
    table: VehicleTable,
    n: int,
    state: FloatArray,
    command: FloatArray,
    h: float,
    substeps: int,
    work: FloatArray,
) -> None:
    """Hold ``command`` for ``substeps`` steps of ``h`` [s], in place.

    Explicit midpoint rule (order 2), with the rate-limited actuators moved exactly.
    ``work`` is scratch of shape (3, N_MOTION).
    """
    row, axles = table.rows[n], tyres(table.rows[n])
    k1, k2, q = work[0], work[1], work[2]
    inputs = state[STEER : BRAKE + 1]
    a_x, a_y = state[AX], state[AY]
    for _ in range(substeps):
        derivative(table, n, axles, state, inputs[0], inputs[1], inputs[2], k1)
        for i in range(N_MOTION):
            q[i] = state[i] + 0.5 * h * k1[i]
        for half in range(2):
            move_inputs(row, inputs, command, 0.5 * h)
            if half == 0:
                a_x, a_y = derivative(table, n, axles, q, inputs[0], inputs[1], inputs[2], k2)
        for i in range(N_MOTION):
            state[i] += h * k2[i]
    # Accelerations are those in the middle of the last substep.
    state[AX], state[AY] = a_x, a_y
    state[WHEEL] = math.atan(wheel_tangents(table, n, inputs[0], abs(state[VX]))[2])


@kernel
def rolls_over(row: FloatArray, load_a_y: float) -> bool:
    """Whether both inner wheels have lifted: |a_y| >= g track / (2 roll arm)."""
    return bool(abs(load_a_y) * 2.0 * row[ROLL_ARM] >= GRAVITY * row[TRACK])
