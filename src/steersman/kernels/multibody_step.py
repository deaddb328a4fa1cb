"""Motion of the multi-body car: its integration, and the states at rest in its springs."""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.multibody import derivative_of, tyre_load
from steersman.kernels.multibody_figures import (
    A_HEIGHT,
    A_VY,
    FAST,
    FRONT,
    N_STATE,
    REAR,
    SLOWEST_WHEEL,
    WHEEL_ANGLE,
    WHEELS,
    Body,
    Figures,
    figures_of,
)
from steersman.kernels.vehicle import (
    GRAVITY,
    VX,
    VY,
    YAW_RATE,
    VehicleTable,
    move_inputs,
    wheel_demand,
    wheel_tangents,
)
from steersman.types import FloatArray

# Steps of the integration in units of the fastest time constant; Heun's rule is stable up to 2.
_STEP = 1.0
# Rate of the fastest motion of the suspension [1/s].
_FASTEST = 400.0
# Of the implicit rule for the wheels: L-stable.
_GAMMA = 1.0 - math.sqrt(0.5)


@kernel
def _solve_slip(
    body: Body, car: Figures, gains: FloatArray, q: FloatArray, h: float, k: FloatArray
) -> None:
    """Solve (1 - h J) k' = k in place, J the derivative of the fast states: spin, v_x, yaw rate.

    A wheel's force is gains[i] (radius x spin - its speed along the plane), for small slip, with
    its speed v_x + d yaw rate; v_x and yaw rate are found first.
    """
    r = body.radius
    a11, a12, a21, a22, b1, b2 = 1.0, 0.0, 0.0, 1.0, k[VX], k[YAW_RATE]
    for i in range(4):
        d, wheel = _offset(car, i), _spin_inertia(car, i)
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
        gain = h * r * gains[i] / _spin_inertia(car, i)
        along = k[VX] + _offset(car, i) * k[YAW_RATE]
        k[WHEELS + i] = (k[WHEELS + i] + gain * along) / (1.0 + r * gain)


@kernel
def _offset(car: Figures, wheel: int) -> float:
    """Place of a wheel to the right of the middle [m]."""
    track = car.front.track if wheel < 2 else car.rear.track
    return float(0.5 * track * (1.0 - 2.0 * (wheel % 2)))


@kernel
def _spin_inertia(car: Figures, wheel: int) -> float:
    """Moment of inertia that spins with a wheel [kg m^2]."""
    return car.front.spin_inertia if wheel < 2 else car.rear.spin_inertia


@kernel
def _slip_gains(body: Body, car: Figures, q: FloatArray, gains: FloatArray) -> None:
    """Longitudinal force of each wheel over its slip speed, for small slip [N s/m]."""
    for i in range(4):
        place, at = (car.front, FRONT) if i < 2 else (car.rear, REAR)
        load = tyre_load(body, place.track, q, at, 1.0 - 2.0 * (i % 2))
        along = max(q[VX] + _offset(car, i) * q[YAW_RATE], SLOWEST_WHEEL)
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
    spinning = 2.0 * (car.front.spin_inertia + car.rear.spin_inertia)
    moved = car.mass + spinning / body.radius**2
    parts = int(math.ceil(h / _STEP * max(quick, _FASTEST)))
    step = h / parts
    for _ in range(parts):
        if has_lifted(table, n, body, q):
            return
        creeps = q[VX] < body.creep
        if creeps:
            front, rear = wheel_demand(table, n, inputs[1], inputs[2], q[VX])
            gain = q[VX] + step * (front + rear) / moved
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
