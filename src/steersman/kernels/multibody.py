"""Multi-body car with 29 states: sprung mass, two axles on springs, four spinning wheels.

Axes and signs: :mod:`steersman.kernels.multibody_figures`.

Source: M. Althoff and G. Wuersching, CommonRoad: Vehicle Models (2020a), multi-body model, after
R. W. Allen et al., Vehicle dynamic stability and rollover, report DOT HS 807 956 (1992); tyres by
the magic formula with combined slip, Pacejka, Tyre and Vehicle Dynamics, 3rd ed., sec. 4.3.

Two things differ from the source: a wheel that has lifted carries nothing, instead of pulling;
and below ``Body.creep`` the car rolls without slip.
"""

from __future__ import annotations

import math

from steersman.kernels import vehicle as planar
from steersman.kernels.compiled import kernel
from steersman.kernels.multibody_figures import (
    A_HEIGHT,
    A_HEIGHT_RATE,
    A_ROLL,
    A_ROLL_RATE,
    A_VY,
    FRONT,
    HEAVE,
    HEAVE_RATE,
    JOINTS,
    PITCH,
    PITCH_RATE,
    REAR,
    ROLL,
    ROLL_RATE,
    SLOWEST_WHEEL,
    WHEEL_ANGLE,
    WHEELS,
    Axle,
    AxlePlace,
    Body,
    Figures,
    Tyre,
    figures_of,
)
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


@kernel
def _sine(c: float, e: float, b_slip: float) -> float:
    """Argument of the magic formula's sine or cosine."""
    return float(c * math.atan(b_slip - e * (b_slip - math.atan(b_slip))))


@kernel
def tyre_force(
    t: Tyre, grip: float, cornering: float, slip: float, angle: float, camber: float, load: float
) -> tuple[float, float]:
    """Longitudinal and lateral force of a tyre [N] under combined slip.

    Args:
        t: coefficients.
        grip: factor on the friction.
        cornering: pky1 of the axle.
        slip: longitudinal slip, 1 - (wheel's circumferential speed) / (speed along its plane).
        angle: slip angle [rad], positive where the wheel moves to the left of its plane.
        camber: inclination of the wheel [rad].
        load: vertical load [N].
    """
    # Pure longitudinal slip; the load cancels in B. The vertical shift is inside the sine, as in
    # the published implementation.
    mu_x = grip * t.pdx1 * (1.0 - t.pdx3 * camber * camber)
    b_slip = t.pkx1 / (t.pcx1 * mu_x) * (t.phx1 - slip)
    pure_x = mu_x * load * math.sin(_sine(t.pcx1, t.pex1, b_slip) + load * t.pvx1)
    # Pure lateral slip.
    side, lean = float((camber > 0.0) - (camber < 0.0)), abs(camber)
    mu_y = grip * t.pdy1 * (1.0 - t.pdy3 * camber * camber)
    b_slip = cornering / (t.pcy1 * mu_y) * (angle + side * (t.phy1 + t.phy3 * lean))
    pure_y = mu_y * load * math.sin(_sine(t.pcy1, t.pey1, b_slip))
    pure_y += side * load * (t.pvy1 + t.pvy3 * lean)
    # Each loses by the other slip; cos(atan(x)) = 1 / sqrt(1 + x^2).
    b = t.rbx1 / math.sqrt(1.0 + (t.rbx2 * slip) ** 2)
    loss_x = math.cos(_sine(t.rcx1, t.rex1, b * (angle + t.rhx1)))
    loss_x /= math.cos(_sine(t.rcx1, t.rex1, b * t.rhx1))
    b = t.rby1 / math.sqrt(1.0 + (t.rby2 * (angle - t.rby3)) ** 2)
    loss_y = math.cos(_sine(t.rcy1, t.rey1, b * (slip + t.rhy1)))
    loss_y /= math.cos(_sine(t.rcy1, t.rey1, b * t.rhy1))
    induced = mu_y * load * (t.rvy1 + t.rvy3 * camber) / math.sqrt(1.0 + (t.rvy4 * angle) ** 2)
    induced *= math.sin(t.rvy5 * math.atan(t.rvy6 * slip))
    return pure_x * loss_x, pure_y * loss_y + induced


@kernel
def tyre_load(body: Body, track: float, q: FloatArray, at: int, side: float) -> float:
    """Vertical load of a wheel [N]: ``side`` is 1 for the right, -1 for the left one."""
    roll = q[at + A_ROLL]
    sinks = q[at + A_HEIGHT] + body.radius * (math.cos(roll) - 1.0)
    return float(max(sinks - side * 0.5 * track * math.sin(roll), 0.0) * body.tyre_stiffness)


@kernel
def _wheel(
    body: Body,
    car: Figures,
    axle: Axle,
    place: AxlePlace,
    angle: float,
    q: FloatArray,
    at: int,
    side: float,
) -> tuple[float, float, float, float]:
    """One wheel: forces along and across its plane, vertical load and force of its spring [N]."""
    half, rate = side * 0.5 * place.track, q[YAW_RATE]
    load = tyre_load(body, place.track, q, at, side)
    ahead, across = q[VX] + half * rate, q[VY] + place.x * rate
    along = ahead * math.cos(angle) + across * math.sin(angle)
    wheel = WHEELS + (0 if at == FRONT else 2) + (0 if side > 0.0 else 1)
    slip = 1.0 - body.radius * q[wheel] / max(along, SLOWEST_WHEEL)
    across -= q[at + A_ROLL_RATE] * (body.radius - q[at + A_HEIGHT])
    lean, lean_rate = q[ROLL] - q[at + A_ROLL], q[ROLL_RATE] - q[at + A_ROLL_RATE]
    arm = body.height - body.radius
    travel = (arm + q[at + A_HEIGHT] - q[HEAVE]) / math.cos(q[ROLL]) - arm
    travel += place.x * q[PITCH] + half * lean
    speed = q[at + A_HEIGHT_RATE] - q[HEAVE_RATE] + place.x * q[PITCH_RATE] + half * lean_rate
    camber = q[ROLL] + side * (axle.camber * travel + axle.camber2 * travel * travel)
    drift = math.atan(across / ahead) - angle
    if q[VX] < body.creep:
        slip = drift = 0.0
    grip = car.grip_right if side > 0.0 else car.grip_left
    f_x, f_y = tyre_force(body.tyre, grip, place.cornering, slip, drift, camber, load)
    spring = place.rest - travel * axle.spring - speed * axle.damper
    return f_x, f_y, load, spring + side * lean * axle.torsion / place.track


@kernel
def _joint(
    body: Body, car: Figures, axle: Axle, place: AxlePlace, q: FloatArray, at: int, stretch: float
) -> tuple[float, float]:
    """Lateral force between an axle and the sprung mass [N], and the rate of its stretch [m/s]."""
    c, s = math.cos(q[ROLL]), math.sin(q[ROLL])
    height = body.height - body.radius + q[at + A_HEIGHT] - q[HEAVE]
    lean, lean_rate = q[ROLL] - q[at + A_ROLL], q[ROLL_RATE] - q[at + A_ROLL_RATE]
    arm = axle.roll_axis - body.radius
    grows = q[VY] + place.x * q[YAW_RATE] - q[at + A_VY]
    gap = height * s - stretch * c - arm * math.sin(lean)
    speed = (height * c + stretch * s) * q[ROLL_RATE] - grows * c
    speed += (q[at + A_HEIGHT_RATE] - q[HEAVE_RATE]) * s - arm * math.cos(lean) * lean_rate
    return gap * body.joint_stiffness + speed * body.joint_damping, grows


@kernel
def _axle(
    body: Body,
    car: Figures,
    axle: Axle,
    place: AxlePlace,
    q: FloatArray,
    at: int,
    torque: float,
    out: FloatArray,
) -> tuple[float, float, float, float, float, float]:
    """An axle at ``at`` in the state: fills its derivatives, those of its wheels and its joint.

    Returns the tyres' force forward and to the left and their moment about the axle's centre, the
    springs' force and roll moment, and the joint's force.
    """
    angle, first, joint = q[WHEEL_ANGLE], WHEELS, JOINTS
    if at == REAR:
        angle, first, joint = 0.0, WHEELS + 2, JOINTS + 1
    x1, y1, z1, spring1 = _wheel(body, car, axle, place, angle, q, at, 1.0)
    x2, y2, z2, spring2 = _wheel(body, car, axle, place, angle, q, at, -1.0)
    force, out[joint] = _joint(body, car, axle, place, q, at, q[joint])
    c, s, half = math.cos(angle), math.sin(angle), 0.5 * place.track
    f_x, f_y = (x1 + x2) * c - (y1 + y2) * s, (y1 + y2) * c + (x1 + x2) * s
    turning = half * ((x1 - x2) * c - (y1 - y2) * s)
    spring, leaning = spring1 + spring2, half * (spring1 - spring2)
    roll, arm = q[at + A_ROLL], axle.roll_axis - body.radius
    c, s = math.cos(q[ROLL]), math.sin(q[ROLL])
    lift, shift = half * math.cos(roll), body.radius * math.sin(roll)
    rolling = z1 * (lift + shift - body.tyre_shift * y1)
    rolling -= z2 * (lift - shift + body.tyre_shift * y2)
    rolling -= leaning + force * arm + f_y * (body.radius - q[at + A_HEIGHT])
    out[at + A_ROLL], out[at + A_ROLL_RATE] = q[at + A_ROLL_RATE], rolling / axle.inertia
    out[at + A_VY] = (f_y - force * c - spring * s) / axle.mass - q[YAW_RATE] * q[VX]
    out[at + A_HEIGHT] = q[at + A_HEIGHT_RATE]
    out[at + A_HEIGHT_RATE] = GRAVITY - (z1 + z2 + force * s - spring * c) / axle.mass
    out[first] = (0.5 * torque - body.radius * x1) / place.spin_inertia
    out[first + 1] = (0.5 * torque - body.radius * x2) / place.spin_inertia
    return f_x, f_y, turning, spring, leaning, force


@kernel
def _lever(body: Body, car: Figures, axle: Axle, q: FloatArray, at: int) -> float:
    """Arm of a joint's force about the centre of the sprung mass [m]."""
    above = body.height - q[HEAVE] - body.radius + q[at + A_HEIGHT]
    return float(above - (axle.roll_axis - body.radius) * math.cos(q[at + A_ROLL]))


@kernel
def derivative(
    body: Body,
    car: Figures,
    torque_front: float,
    torque_rear: float,
    q: FloatArray,
    out: FloatArray,
) -> None:
    """Time derivative of the state, under the torques of drive and brakes on the axles [N m].

    That of the wheel angle, which is the actuator's, is 0 here.
    """
    front, rear = car.front, car.rear
    xf, yf, nf, sf, lf, jf = _axle(body, car, body.front, front, q, FRONT, torque_front, out)
    xr, yr, nr, sr, lr, jr = _axle(body, car, body.rear, rear, q, REAR, torque_rear, out)
    v_x, v_y, rate = q[VX], q[VY], q[YAW_RATE]
    c, s = math.cos(q[ROLL]), math.sin(q[ROLL])
    turning = front.x * yf + rear.x * yr + nf + nr + car.moment
    levers = jf * _lever(body, car, body.front, q, FRONT)
    levers += jr * _lever(body, car, body.rear, q, REAR)
    rolling = lf + lr - levers / c
    pitching = front.x * sf + rear.x * sr + (xf + xr) * (body.height - q[HEAVE])
    side = (jf + jr) * c + (sf + sr) * s + car.side
    ratio_roll = body.cross_inertia / body.roll_inertia
    ratio_yaw = body.cross_inertia / car.yaw_inertia
    both = 1.0 - ratio_roll * ratio_yaw
    c_psi, s_psi = math.cos(q[PSI]), math.sin(q[PSI])
    out[planar.X] = v_x * c_psi - v_y * s_psi
    out[planar.Y] = v_x * s_psi + v_y * c_psi
    out[PSI] = rate
    out[VX] = (xf + xr - car.drag * v_x * abs(v_x)) / car.mass + rate * v_y
    out[VY] = side / car.sprung - rate * v_x
    out[YAW_RATE] = (turning + ratio_roll * rolling) / (car.yaw_inertia * both)
    out[WHEEL_ANGLE] = 0.0
    out[ROLL] = q[ROLL_RATE]
    out[ROLL_RATE] = (rolling + ratio_yaw * turning) / (body.roll_inertia * both)
    out[PITCH], out[PITCH_RATE] = q[PITCH_RATE], pitching / body.pitch_inertia
    out[HEAVE] = q[HEAVE_RATE]
    out[HEAVE_RATE] = GRAVITY - ((sf + sr) * c - (jf + jr) * s) / car.sprung


@kernel
def derivative_of(
    table: VehicleTable, n: int, body: Body, q: FloatArray, pedals: FloatArray, out: FloatArray
) -> None:
    """Time derivative of the state under actuator positions: steering, throttle, brake.

    The wheel angle in the state is set to that of the steering.
    """
    q[WHEEL_ANGLE] = math.atan(wheel_tangents(table, n, pedals[0], abs(q[VX]))[2])
    front, rear = wheel_demand(table, n, pedals[1], pedals[2], q[VX])
    car = figures_of(body, table.rows[n])
    derivative(body, car, body.radius * front, body.radius * rear, q, out)
