"""Multi-body car with 29 states: sprung mass, two axles on springs, four spinning wheels.

Axes: x forward, y left, z down; yaw and yaw rate positive to the left, roll positive with the
left side down, pitch positive with the nose up. That is the mirror image of the axes of SAE, in
which the equations are usually given. Of an axle's two wheels the first is the right one.

Source: M. Althoff and G. Wuersching, CommonRoad: Vehicle Models (2020a), multi-body model, after
R. W. Allen et al., Vehicle dynamic stability and rollover, report DOT HS 807 956 (1992); tyres by
the magic formula with combined slip, Pacejka, Tyre and Vehicle Dynamics, 3rd ed., sec. 4.3.

Two things differ from the source: a wheel that has lifted carries nothing, instead of pulling;
and below a speed of the caller's the car rolls without slip.
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
    move_inputs,
    wheel_demand,
    wheel_tangents,
)
from steersman.types import FloatArray

# State beyond x, y, psi, v_x, v_y and yaw rate: wheel angle; roll, pitch and heave of the sprung
# mass with their rates; of each axle roll and its rate, v_y, height and its rate; wheel speeds,
# front right, front left, rear right, rear left; stretch of each axle's joint.
(WHEEL_ANGLE, ROLL, ROLL_RATE, PITCH, PITCH_RATE, HEAVE, HEAVE_RATE) = range(6, 13)
FRONT, REAR, WHEELS, JOINTS = 13, 18, 23, 27
N_STATE = 29
# States that the slip of the wheels changes within milliseconds.
FAST = (VX, YAW_RATE, WHEELS, WHEELS + 1, WHEELS + 2, WHEELS + 3)
# Columns of an axle, from FRONT or REAR on.
A_ROLL, A_ROLL_RATE, A_VY, A_HEIGHT, A_HEIGHT_RATE = range(5)
# A wheel that moves more slowly along its plane counts as moving so fast [m/s].
_SLOWEST_WHEEL = 0.1
# Steps of the integration in units of the fastest time constant; Heun's rule is stable up to 2.
_STEP = 1.0
# Rate of the fastest motion of the suspension [1/s].
_FASTEST = 400.0
# Of the implicit rule for the wheels: L-stable.
_GAMMA = 1.0 - math.sqrt(0.5)


class Tyre(NamedTuple):
    """Coefficients of the magic formula, with Pacejka's names; all in SI units."""

    pcx1: float
    pdx1: float
    pdx3: float
    pex1: float
    pkx1: float
    phx1: float
    pvx1: float
    rbx1: float
    rbx2: float
    rcx1: float
    rex1: float
    rhx1: float
    pcy1: float
    pdy1: float
    pdy3: float
    pey1: float
    phy1: float
    phy3: float
    pvy1: float
    pvy3: float
    rby1: float
    rby2: float
    rby3: float
    rcy1: float
    rey1: float
    rhy1: float
    rvy1: float
    rvy3: float
    rvy4: float
    rvy5: float
    rvy6: float


class Axle(NamedTuple):
    """The suspension of an axle."""

    mass: float
    """Unsprung mass [kg]."""
    inertia: float
    """Moment of inertia about the x axis [kg m^2]."""
    track: float
    """Distance between its wheels [m]; 0: the vehicle's."""
    spring: float
    """Stiffness at each wheel [N/m]."""
    damper: float
    """Damping at each wheel [N s/m]."""
    torsion: float
    """Additional roll stiffness [N m/rad]; negative: less than that of the springs."""
    roll_axis: float
    """Height of the roll axis above ground [m]."""
    camber: float
    """Camber per travel of the spring [rad/m]."""
    camber2: float
    """Camber per squared travel [rad/m^2]."""


class Body(NamedTuple):
    """What a planar vehicle's figures do not hold: suspension, wheels and tyres."""

    roll_inertia: float
    """Of the sprung mass about its x axis [kg m^2]."""
    pitch_inertia: float
    """Of the sprung mass about its y axis [kg m^2]."""
    cross_inertia: float
    """Product of inertia x z of the sprung mass [kg m^2]."""
    joint_stiffness: float
    """Lateral, between an axle and the sprung mass [N/m]."""
    joint_damping: float
    """Lateral, between an axle and the sprung mass [N s/m]."""
    tyre_stiffness: float
    """Vertical, of a tyre [N/m]."""
    tyre_shift: float
    """Lateral shift of a tyre's contact per lateral force [m/N]."""
    radius: float
    """Of a wheel [m]."""
    wheel_inertia: float
    """Of a wheel about its axis [kg m^2]."""
    creep: float
    """Speed below which the car rolls without slip [m/s]."""
    front: Axle
    rear: Axle
    tyre: Tyre


class Place(NamedTuple):
    """An axle's figures that a planar vehicle's hold, too."""

    x: float
    """Place ahead of the centre of mass [m]; negative: behind."""
    track: float
    """Distance between its wheels [m]."""
    rest: float
    """Force of each of its springs at rest [N]."""
    cornering: float
    """Slope of lateral force over slip angle and load, pky1, negative [1/rad]."""


class Figures(NamedTuple):
    """The car's figures that a planar vehicle's hold, too; they may change while it drives."""

    mass: float
    """All of it [kg]."""
    sprung: float
    """Sprung mass [kg]."""
    yaw_inertia: float
    """Of the car about its z axis [kg m^2]."""
    height: float
    """Centre of the sprung mass above ground [m]."""
    grip: float
    """Friction over that for which the tyre's coefficients hold [-]."""
    drag: float
    """Drag force per squared speed [N s^2/m^2]."""
    side: float
    """Lateral force of the wind [N]."""
    moment: float
    """Yaw moment of the wind [N m]."""
    front: Place
    rear: Place


@kernel
def figures_of(body: Body, row: FloatArray) -> Figures:
    """Figures of a vehicle's row; what its mass is more than the axles' is sprung mass."""
    mass, l_f, l_r = row[planar.MASS], row[planar.L_F], row[planar.L_R]
    front, rear = body.front, body.rear
    sprung, base, weight = mass - front.mass - rear.mass, l_f + l_r, mass * GRAVITY
    track_f = front.track if front.track > 0.0 else row[planar.TRACK]
    track_r = rear.track if rear.track > 0.0 else row[planar.TRACK]
    rest = 0.5 * sprung * GRAVITY / base
    return Figures(
        mass,
        sprung,
        row[planar.INERTIA],
        row[planar.HEIGHT],
        row[planar.MU] / body.tyre.pdy1,
        row[planar.DRAG],
        row[planar.SIDE_FORCE],
        row[planar.YAW_MOMENT],
        Place(l_f, track_f, rest * l_r, -row[planar.C_F] * base / (weight * l_r)),
        Place(-l_r, track_r, rest * l_f, -row[planar.C_R] * base / (weight * l_f)),
    )


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
    place: Place,
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
    slip = 1.0 - body.radius * q[wheel] / max(along, _SLOWEST_WHEEL)
    across -= q[at + A_ROLL_RATE] * (body.radius - q[at + A_HEIGHT])
    lean, lean_rate = q[ROLL] - q[at + A_ROLL], q[ROLL_RATE] - q[at + A_ROLL_RATE]
    arm = car.height - body.radius
    travel = (arm + q[at + A_HEIGHT] - q[HEAVE]) / math.cos(q[ROLL]) - arm
    travel += place.x * q[PITCH] + half * lean
    speed = q[at + A_HEIGHT_RATE] - q[HEAVE_RATE] + place.x * q[PITCH_RATE] + half * lean_rate
    camber = q[ROLL] + side * (axle.camber * travel + axle.camber2 * travel * travel)
    drift = math.atan(across / ahead) - angle
    if q[VX] < body.creep:
        slip = drift = 0.0
    f_x, f_y = tyre_force(body.tyre, car.grip, place.cornering, slip, drift, camber, load)
    spring = place.rest - travel * axle.spring - speed * axle.damper
    return f_x, f_y, load, spring + side * lean * axle.torsion / place.track


@kernel
def _joint(
    body: Body, car: Figures, axle: Axle, place: Place, q: FloatArray, at: int, stretch: float
) -> tuple[float, float]:
    """Lateral force between an axle and the sprung mass [N], and the rate of its stretch [m/s]."""
    c, s = math.cos(q[ROLL]), math.sin(q[ROLL])
    height = car.height - body.radius + q[at + A_HEIGHT] - q[HEAVE]
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
    place: Place,
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
    out[first] = (0.5 * torque - body.radius * x1) / body.wheel_inertia
    out[first + 1] = (0.5 * torque - body.radius * x2) / body.wheel_inertia
    return f_x, f_y, turning, spring, leaning, force


@kernel
def _lever(body: Body, car: Figures, axle: Axle, q: FloatArray, at: int) -> float:
    """Arm of a joint's force about the centre of the sprung mass [m]."""
    above = car.height - q[HEAVE] - body.radius + q[at + A_HEIGHT]
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
    pitching = front.x * sf + rear.x * sr + (xf + xr) * (car.height - q[HEAVE])
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


@kernel
def _solve_slip(
    body: Body, car: Figures, gains: FloatArray, q: FloatArray, h: float, k: FloatArray
) -> None:
    """Solve (1 - h J) k' = k in place, J the derivative of the fast states: spin, v_x, yaw rate.

    A wheel's force is gains[i] (radius x spin - its speed along the plane), for small slip, with
    its speed v_x + d yaw rate; v_x and yaw rate are found first.
    """
    r, wheel = body.radius, body.wheel_inertia
    a11, a12, a21, a22, b1, b2 = 1.0, 0.0, 0.0, 1.0, k[VX], k[YAW_RATE]
    for i in range(4):
        d = _offset(car, i)
        damped = 1.0 + h * r * r * gains[i] / wheel
        # Force by the change of v_x + d yaw rate, and by what the spin gets from outside.
        slows = h * gains[i] / damped
        pushes = slows * r * k[WHEELS + i]
        a11 += slows / car.mass
        a12 += slows * d / car.mass
        a21 += slows * d / car.yaw_inertia
        a22 += slows * d * d / car.yaw_inertia
        b1 += pushes / car.mass
        b2 += pushes * d / car.yaw_inertia
    both = a11 * a22 - a12 * a21
    k[VX], k[YAW_RATE] = (b1 * a22 - b2 * a12) / both, (b2 * a11 - b1 * a21) / both
    for i in range(4):
        gain = h * r * gains[i] / wheel
        along = k[VX] + _offset(car, i) * k[YAW_RATE]
        k[WHEELS + i] = (k[WHEELS + i] + gain * along) / (1.0 + r * gain)


@kernel
def _offset(car: Figures, wheel: int) -> float:
    """Place of a wheel to the right of the middle [m]."""
    track = car.front.track if wheel < 2 else car.rear.track
    return float(0.5 * track * (1.0 - 2.0 * (wheel % 2)))


@kernel
def _slip_gains(body: Body, car: Figures, q: FloatArray, gains: FloatArray) -> None:
    """Longitudinal force of each wheel over its slip speed, for small slip [N s/m]."""
    for i in range(4):
        place, at = (car.front, FRONT) if i < 2 else (car.rear, REAR)
        load = tyre_load(body, place.track, q, at, 1.0 - 2.0 * (i % 2))
        along = max(q[VX] + _offset(car, i) * q[YAW_RATE], _SLOWEST_WHEEL)
        gains[i] = body.tyre.pkx1 * load / along


@kernel
def rosenbrock(
    table: VehicleTable,
    n: int,
    body: Body,
    q: FloatArray,
    inputs: FloatArray,
    command: FloatArray,
    h: float,
    work: FloatArray,
) -> None:
    """One step of order 2, in place, while the actuators move towards ``command``.

    The W-method ROS2 (Verwer et al., SIAM J. Sci. Comput. 20, 1999, eq. 1.5): implicit in the
    wheels' spin alone, whose slip decays within a millisecond, by an approximate derivative;
    Heun's rule for all else.

    Args:
        table: figures of the vehicles.
        n: the vehicle.
        body: its suspension, wheels and tyres.
        q: its state.
        inputs: positions of steering, throttle and brake.
        command: where they are to go.
        h: step [s].
        work: scratch of shape (4, N_STATE).
    """
    first, at, second, gains = work[0], work[1], work[2], work[3]
    car = figures_of(body, table.rows[n])
    _slip_gains(body, car, q, gains)
    derivative_of(table, n, body, q, inputs, first)
    _solve_slip(body, car, gains, q, _GAMMA * h, first)
    for i in range(N_STATE):
        at[i] = q[i] + h * first[i]
    move_inputs(table.rows[n], inputs, command, h)
    derivative_of(table, n, body, at, inputs, second)
    for i in FAST:
        second[i] -= 2.0 * first[i]
    _solve_slip(body, car, gains, q, _GAMMA * h, second)
    for i in FAST:
        second[i] += 2.0 * first[i]
    for i in range(N_STATE):
        q[i] += 0.5 * h * (first[i] + second[i])
    for i in range(WHEELS, WHEELS + 4):
        q[i] = max(q[i], 0.0)
    q[WHEEL_ANGLE] = at[WHEEL_ANGLE]


@kernel
def _roll_freely(body: Body, car: Figures, q: FloatArray, gain: float) -> None:
    """Without slip: the velocities of a slow car follow from its speed and wheel angle."""
    q[VX] = max(gain, 0.0)
    q[YAW_RATE] = q[VX] * math.tan(q[WHEEL_ANGLE]) / (car.front.x - car.rear.x)
    q[VY] = -car.rear.x * q[YAW_RATE]
    q[FRONT + A_VY] = q[VY] + car.front.x * q[YAW_RATE]
    q[REAR + A_VY] = 0.0
    for i in range(WHEELS, WHEELS + 4):
        q[i] = q[VX] / body.radius


@kernel
def has_lifted(table: VehicleTable, n: int, body: Body, q: FloatArray) -> bool:
    """Whether both wheels of one side carry nothing."""
    car = figures_of(body, table.rows[n])
    lifted = False
    for i in range(2):
        side = 1.0 - 2.0 * i
        load = tyre_load(body, car.front.track, q, FRONT, side)
        load += tyre_load(body, car.rear.track, q, REAR, side)
        lifted = lifted or load <= 0.0
    return lifted


@kernel
def advance(
    table: VehicleTable,
    n: int,
    body: Body,
    q: FloatArray,
    inputs: FloatArray,
    command: FloatArray,
    h: float,
    work: FloatArray,
) -> None:
    """Move the car and its actuators for ``h`` [s] towards ``command``, in place.

    A slow car needs shorter steps, as its slip angles decay faster. Below ``body.creep`` it rolls
    without slip. Where both wheels of a side have lifted it stops: what follows is not modelled.
    """
    car = figures_of(body, table.rows[n])
    grip = -0.5 * car.mass * GRAVITY * min(car.front.cornering, car.rear.cornering)
    quick = grip * body.radius**2 / min(body.front.inertia, body.rear.inertia)
    quick = max(quick, 2.0 * body.tyre.pkx1 * GRAVITY) / max(q[VX], body.creep)
    parts = int(math.ceil(h / _STEP * max(quick, _FASTEST)))
    step = h / parts
    for _ in range(parts):
        if has_lifted(table, n, body, q):
            return
        creeps = q[VX] < body.creep
        if creeps:
            front, rear = wheel_demand(table, n, inputs[1], inputs[2], q[VX])
            gain = q[VX] + step * (front + rear) / car.mass
            _roll_freely(body, car, q, q[VX])
        rosenbrock(table, n, body, q, inputs, command, step, work)
        if creeps:
            _roll_freely(body, car, q, gain)


@kernel
def settle(table: VehicleTable, n: int, body: Body, inputs: FloatArray, q: FloatArray) -> None:
    """Put a car at rest in its springs: axles move with the body, wheels roll without slip.

    From the first six states and the actuator positions; all others are filled.
    """
    car = figures_of(body, table.rows[n])
    for i in range(WHEEL_ANGLE, N_STATE):
        q[i] = 0.0
    q[WHEEL_ANGLE] = math.atan(wheel_tangents(table, n, inputs[0], abs(q[VX]))[2])
    q[FRONT + A_VY] = q[VY] + car.front.x * q[YAW_RATE]
    q[REAR + A_VY] = q[VY] + car.rear.x * q[YAW_RATE]
    q[FRONT + A_HEIGHT] = (2.0 * car.front.rest + body.front.mass * GRAVITY) / (
        2.0 * body.tyre_stiffness
    )
    q[REAR + A_HEIGHT] = (2.0 * car.rear.rest + body.rear.mass * GRAVITY) / (
        2.0 * body.tyre_stiffness
    )
    c, s = math.cos(q[WHEEL_ANGLE]), math.sin(q[WHEEL_ANGLE])
    half_f, half_r = 0.5 * car.front.track * q[YAW_RATE], 0.5 * car.rear.track * q[YAW_RATE]
    for i in range(2):
        side = 1.0 - 2.0 * i
        along = (q[VX] + side * half_f) * c + q[FRONT + A_VY] * s
        q[WHEELS + i] = max(along, 0.0) / body.radius
        q[WHEELS + 2 + i] = max(q[VX] + side * half_r, 0.0) / body.radius
