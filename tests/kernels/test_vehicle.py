"""The vehicle's parts: steering law, longitudinal map, tyres and wheel loads."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.kernels import tyre
from steersman.kernels import vehicle as kernel
from steersman.types import FloatArray
from steersman.vehicles import Bmw320i, CarlaMkz2020, CarlaModel3, CarlaModel3V1, Vehicle

CAR = CarlaModel3V1()
TABLE = CAR.table
WEIGHT = CAR.mass * kernel.GRAVITY
PHYSX = CAR.replace(roll_arm=0.18, stiffness_load_limit=3.0, rotating_mass=632.0)

steers = st.floats(-1.0, 1.0)
speeds = st.floats(0.0, 60.0)
forces = st.floats(-3e4, 3e4)


# ------------------------------------------------------------------------------- steering


def test_full_lock() -> None:
    left, right, _ = kernel.wheel_tangents(TABLE, 0, 1.0, 0.0)
    assert math.degrees(math.atan(left)) == pytest.approx(70.0)
    assert math.degrees(math.atan(right)) == pytest.approx(47.4, abs=0.05)
    for speed, factor in ((20.0, 0.9), (60.0, 0.8), (90.0, 0.75), (120.0, 0.7), (200.0, 0.7)):
        left, _, _ = kernel.wheel_tangents(TABLE, 0, 1.0, speed / 3.6)
        assert math.degrees(math.atan(left)) == pytest.approx(70.0 * factor)


@given(steers.filter(lambda u: abs(u) > 1e-3), speeds)
def test_ackermann(steer: float, speed: float) -> None:
    left, right, middle = kernel.wheel_tangents(TABLE, 0, steer, speed)
    inner, outer = (left, right) if steer > 0.0 else (-right, -left)
    # Measured: 1.667 m track over 3.005 m wheelbase.
    assert 1.0 / outer - 1.0 / inner == pytest.approx(0.5548, abs=2e-4)
    assert 1.0 / abs(middle) == pytest.approx(0.5 * (1.0 / outer + 1.0 / inner))


@given(steers, speeds)
def test_steering_law_is_inverted_and_odd(steer: float, speed: float) -> None:
    left, right, middle = kernel.wheel_tangents(TABLE, 0, steer, speed)
    assert kernel.wheel_tangents(TABLE, 0, -steer, speed) == (-right, -left, -middle)
    back = kernel.steer_for_wheel(TABLE, 0, math.atan(middle), speed)
    assert back == pytest.approx(steer, abs=1e-12)
    args = (TABLE, 0, steer, speed)
    assert kernel.wheel_tangents(*args) == pytest.approx(
        kernel.wheel_tangents.py_func(*args), abs=1e-12
    )
    assert back == pytest.approx(
        kernel.steer_for_wheel.py_func(TABLE, 0, math.atan(middle), speed), abs=1e-12
    )


def test_parallel_wheels() -> None:
    left, right, middle = kernel.wheel_tangents(Bmw320i().table, 0, 0.5, 10.0)
    assert left == right == middle == pytest.approx(math.tan(0.5 * 1.066))


# ------------------------------------------------------------------------- longitudinal map


@given(st.floats(-0.5, 1.5), st.floats(0.0, 80.0))
def test_map_is_bilinear_and_held_at_its_edges(throttle: float, speed: float) -> None:
    found = kernel.map_acceleration(TABLE, throttle, speed)
    assert found == pytest.approx(kernel.map_acceleration.py_func(TABLE, throttle, speed))
    t = min(max(throttle, 0.0), 1.0)
    columns = [np.interp(speed, TABLE.map_speed, row) for row in TABLE.map_accel]
    assert found == pytest.approx(float(np.interp(t, TABLE.map_throttle, columns)), abs=1e-9)


def test_beyond_the_map_drive_power_is_constant() -> None:
    # The map's force is held at its last speed; the drive fades so that its power stays.
    power = []
    for speed in (38.7, 45.0, 60.0):
        front, rear = kernel.wheel_demand(TABLE, 0, 1.0, 0.0, speed)
        power.append((front + rear) * speed)
    assert power == pytest.approx([power[0]] * 3)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-30.0, 30.0))
def test_brakes_and_engine_drag_oppose_the_motion(
    throttle: float, brake: float, v_x: float
) -> None:
    args = (TABLE, 0, throttle, brake, v_x)
    assert kernel.wheel_demand(*args) == pytest.approx(kernel.wheel_demand.py_func(*args))
    driven = sum(kernel.wheel_demand(TABLE, 0, throttle, 0.0, v_x))
    braked = sum(kernel.wheel_demand(*args)) - driven
    assert braked * v_x <= 0.0
    assert sum(kernel.wheel_demand(TABLE, 0, 0.0, 0.0, v_x)) * v_x <= 0.0
    assert abs(braked) <= CAR.brake_force * brake + 1e-9


# ----------------------------------------------------------------------------------- tyres


def test_side_force_starts_with_the_stiffness() -> None:
    slope = tyre.side_force(5e4, 1e-6, 8e3) / 1e-6
    assert slope == pytest.approx(-5e4, rel=1e-4)


@given(st.floats(1e3, 1e5), st.floats(-2.0, 2.0), st.floats(10.0, 4e4))
def test_side_force_is_odd_and_limited(stiffness: float, slip: float, limit: float) -> None:
    force = tyre.side_force(stiffness, slip, limit)
    assert force == tyre.side_force.py_func(stiffness, slip, limit)
    assert force == -tyre.side_force(stiffness, -slip, limit)
    assert abs(force) <= limit * (1.0 + 1e-12)
    assert force * slip <= 0.0
    sliding = 3.0 * limit / stiffness
    assert tyre.side_force(stiffness, 1.001 * sliding, limit) == -limit


def test_side_force_grows_up_to_sliding() -> None:
    slips = np.linspace(0.0, 3.0 * 8e3 / 5e4, 400)
    forces = [-tyre.side_force(5e4, s, 8e3) for s in slips]
    assert (np.diff(forces) > 0.0).all()
    assert forces[-1] == pytest.approx(8e3)


@given(st.floats(0.0, 3e4), forces, st.floats(-3.0, 3.0), st.floats(-40, 40), st.floats(-40, 40))
def test_no_wheel_exceeds_its_grip(
    grip: float, demand: float, tangent: float, v_x: float, v_y: float
) -> None:
    args = (6e4, grip, demand, tangent, v_x, v_y, 1.0)
    f_x, f_y = tyre.wheel_force(*args)
    assert math.hypot(f_x, f_y) <= grip * (1.0 + 1e-9) + 1e-9
    assert (f_x, f_y) == pytest.approx(tyre.wheel_force.py_func(*args), abs=1e-9)


def test_longitudinal_force_takes_from_the_side_force() -> None:
    # Sliding sideways at full slip: the friction ellipse (here a circle) is used up.
    f_x, f_y = tyre.wheel_force(6e4, 5e3, 3e3, 0.0, 1.0, -30.0, 1.0)
    assert (f_x, f_y) == pytest.approx((3e3, 4e3))


@given(forces, st.floats(0.0, 2e4), st.floats(0.0, 2e4))
def test_axle_split_passes_on_everything(demand: float, left: float, right: float) -> None:
    one, two = tyre.split_axle(demand, left, right)
    assert (one, two) == tyre.split_axle.py_func(demand, left, right)
    assert one + two == pytest.approx(demand, abs=1e-9)
    if abs(demand) <= min(left, right):
        assert one == two
    # Symmetric: whichever side has less grip.
    assert tyre.split_axle(demand, right, left) == (two, one)


def test_axle_split_relieves_the_lifted_wheel() -> None:
    assert tyre.split_axle(4e3, 0.0, 2e4) == (0.0, 4e3)


# ----------------------------------------------------------------------------------- loads


@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_loads_sum_to_the_weight(a_x: float, a_y: float) -> None:
    loads = kernel.wheel_loads(TABLE.rows[0], a_x, a_y)
    assert loads == pytest.approx(kernel.wheel_loads.py_func(TABLE.rows[0], a_x, a_y))
    assert sum(loads) == pytest.approx(WEIGHT)
    assert min(loads) >= 0.0


@given(st.floats(-6.0, 6.0), st.floats(-14.0, 14.0))
def test_load_transfer(a_x: float, a_y: float) -> None:
    fl, fr, rl, rr = kernel.wheel_loads(TABLE.rows[0], a_x, a_y)
    pitch = CAR.mass * a_x * CAR.height / CAR.wheelbase
    assert fl + fr == pytest.approx(WEIGHT * CAR.l_r / CAR.wheelbase - pitch)
    assert rl + rr == pytest.approx(WEIGHT * CAR.l_f / CAR.wheelbase + pitch)
    roll = CAR.mass * a_y * CAR.height / CAR.track_width
    assert fr + rr - fl - rl == pytest.approx(2.0 * roll, abs=1e-6)


def test_rolls_over_when_the_inner_wheels_lift() -> None:
    limit = CAR.roll_over_acceleration
    assert limit == pytest.approx(14.87, abs=0.005)
    row = TABLE.rows[0]
    for side in (-1.0, 1.0):
        assert not kernel.rolls_over(row, side * 0.999 * limit)
        assert kernel.rolls_over(row, side * 1.001 * limit)
        assert kernel.rolls_over.py_func(row, side * 1.001 * limit)
        fl, fr, _, _ = kernel.wheel_loads(row, 0.0, side * 1.001 * limit)
        assert min(fl, fr) == 0.0


@given(
    st.sampled_from(
        [CAR.table, CarlaModel3().table, CarlaMkz2020().table, Bmw320i().table, PHYSX.table]
    ),
    st.tuples(*[st.floats(-1.0, 1.0)] * 6),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_derivative_equals_python_and_stays_within_the_grip(
    table: kernel.VehicleTable, unit: tuple[float, ...], throttle: float, brake: float
) -> None:
    q, out, other = np.zeros((3, kernel.N_MOTION))
    q[kernel.VX :] = np.array((40.0, 15.0, 3.0, 20.0, 20.0)) * unit[:5]
    axles = kernel.tyres(table.rows[0])
    found = kernel.derivative(table, 0, axles, q, unit[5], throttle, brake, out)
    assert found == pytest.approx(
        kernel.derivative.py_func(table, 0, axles, q, unit[5], throttle, brake, other), abs=1e-10
    )
    np.testing.assert_allclose(out, other, rtol=1e-12, atol=1e-10)
    row = table.rows[0]
    drag = row[kernel.DRAG] * q[kernel.VX] * abs(q[kernel.VX]) / row[kernel.MASS]
    tyres = math.hypot(found[0] + drag, found[1])
    assert tyres <= row[kernel.MU] * kernel.GRAVITY * (1.0 + 1e-9)


# ----------------------------------------------------- roll arm, load law, rotating masses, drag


def drive(
    car: Vehicle, speed: float, command: tuple[float, float, float], steps: int
) -> FloatArray:
    """States (steps + 1, N_STATE) from straight motion at a speed, every 0.01 s."""
    states, work = np.zeros((steps + 1, kernel.N_STATE)), np.zeros((3, kernel.N_MOTION))
    states[0, kernel.VX], states[0, kernel.STEER :][:3] = speed, command
    for k in range(steps):
        states[k + 1] = states[k]
        kernel.advance(car.table, 0, states[k + 1], np.array(command), 0.01, 1, work)
    return states


def test_wheels_lift_by_the_roll_arm_not_the_height() -> None:
    assert PHYSX.roll_over_acceleration == pytest.approx(9.81 * 1.667 / (2.0 * 0.18))
    for height in (0.4, 0.8):
        assert PHYSX.replace(height=height).roll_over_acceleration == PHYSX.roll_over_acceleration
        assert CAR.replace(height=height).roll_over_acceleration == pytest.approx(
            9.81 * 1.667 / (2.0 * height)
        )
    row = PHYSX.table.rows[0]
    assert not kernel.rolls_over(row, 0.999 * PHYSX.roll_over_acceleration)
    assert kernel.rolls_over(row, -1.001 * PHYSX.roll_over_acceleration)


def test_without_an_arm_no_load_moves() -> None:
    car = CAR.replace(roll_arm=0.0)
    assert car.roll_over_acceleration == math.inf
    assert not kernel.rolls_over(car.table.rows[0], 1e6)
    loads = kernel.wheel_loads(car.table.rows[0], 8.0, 30.0)
    assert loads == pytest.approx(kernel.wheel_loads(CAR.table.rows[0], 0.0, 0.0))


def wheel_stiffness(load: float, limit: float) -> float:
    """Of a wheel with 12 per load that carries 4 kN at rest."""
    return tyre.tyre_stiffness(tyre.axle_tyres(12.0, 4e3, limit), load)


def test_stiffness_over_load() -> None:
    loads = np.linspace(0.0, 4.0, 41) * 4e3
    physx = np.array([wheel_stiffness(f, 3.0) for f in loads])
    # PhysX: 20 F_rest S(F_z / F_rest), S(x) = x - x^2/3 + x^3/27, up to three static loads.
    share = np.minimum(loads / 4e3, 3.0)
    law = share - share**2 / 3.0 + share**3 / 27.0
    assert physx == pytest.approx(12.0 * 4e3 * law / (1.0 - 1.0 / 3.0 + 1.0 / 27.0))
    assert (np.diff(physx) >= -1e-9).all()
    assert (np.diff(physx[loads < 12e3]) > 0.0).all()
    for limit in (0.0, 1.5, 3.0):
        assert wheel_stiffness(4e3, limit) == pytest.approx(12.0 * 4e3)
        slow = tyre.tyre_stiffness.py_func(tyre.axle_tyres.py_func(12.0, 4e3, limit), 5e3)
        assert slow == pytest.approx(wheel_stiffness(5e3, limit))
    assert wheel_stiffness(5e3, 0.0) == 12.0 * 5e3


def test_load_transfer_softens_an_axle_by_the_load_law_only() -> None:
    # In proportion to load, what the inner wheel loses the outer one gains.
    def axle(limit: float) -> float:
        return sum(wheel_stiffness(f, limit) for f in (1e3, 7e3))

    assert axle(0.0) == pytest.approx(2 * 12.0 * 4e3)
    assert axle(3.0) < 0.95 * 2 * 12.0 * 4e3


@pytest.mark.parametrize("car", [CAR, PHYSX], ids=["still", "rotating"])
@pytest.mark.parametrize("throttle", [0.0, 0.5, 1.0])
def test_the_map_is_the_acceleration_on_a_straight(car: Vehicle, throttle: float) -> None:
    states = drive(car, 12.0, (0.0, throttle, 0.0), 100)
    speeds = states[:, kernel.VX]
    found = np.diff(speeds) / 0.01
    middle = 0.5 * (speeds[1:] + speeds[:-1])
    wanted = [kernel.map_acceleration(car.table, throttle, v) for v in middle]
    assert found[50:] == pytest.approx(np.array(wanted)[50:], abs=2e-3)


def test_rotating_masses_keep_the_energy() -> None:
    # Coasting with nothing but drag: what it takes comes out of body and rotating masses.
    car = PHYSX.replace(
        map_acceleration=[[0.0] * 7] * 6, map_drag_area=0.0, drag_area=4.0, brake_force=0.0
    )
    v = drive(car, 30.0, (0.0, 0.0, 0.0), 400)[:, kernel.VX]
    energy = 0.5 * (car.mass + car.rotating_mass) * v**2
    power = 0.5 * 1.2 * 4.0 * v**3
    assert -np.diff(energy) == pytest.approx(0.01 * 0.5 * (power[1:] + power[:-1]), rel=1e-3)


def test_rotating_masses_lengthen_braking() -> None:
    coasting = {"map_acceleration": [[0.0] * 7] * 6, "map_drag_area": None, "drag_area": 0.0}
    for car in (CAR.replace(**coasting), PHYSX.replace(**coasting)):
        v = drive(car, 20.0, (0.0, 0.0, 0.5), 100)[:, kernel.VX]
        deceleration = 0.5 * car.brake_force / (car.mass + car.rotating_mass)
        assert v[50] - v[100] == pytest.approx(0.5 * deceleration, rel=1e-3)


def test_in_a_steady_turn_all_the_drive_force_goes_to_the_tyres() -> None:
    # On a curve at constant speed rotating masses take nothing, on a straight a quarter.
    for car, moved in ((CAR, CAR.mass), (PHYSX, PHYSX.mass + PHYSX.rotating_mass)):
        front, rear = kernel.wheel_demand(car.table, 0, 0.6, 0.0, 15.0)
        drag = 0.5 * 1.2 * car.drag_area * 15.0**2
        wanted = moved * kernel.map_acceleration(car.table, 0.6, 15.0) + drag
        assert front + rear == pytest.approx(wanted)


@pytest.mark.parametrize("throttle", [0.0, 0.6])
def test_drag_slows_a_car_with_open_and_closed_throttle(throttle: float) -> None:
    # Once the drag was given back by the map whatever it was: 0 and 30 m^2 coasted alike.
    slow, mine, fast = (
        drive(CAR.replace(drag_area=area), 27.8, (0.0, throttle, 0.0), 2)[-1, kernel.VX]
        for area in (3.0, CAR.drag_area, 0.0)
    )
    assert slow < mine < fast
    taken = 0.5 * 1.2 * (3.0 - CAR.drag_area) * 27.8**2 / CAR.mass * 0.02
    assert mine - slow == pytest.approx(taken, rel=0.02)


def test_a_map_of_ones_own_has_ones_own_drag() -> None:
    own = {"map_acceleration": CAR.map_acceleration, "drag_area": 2.0}
    assert Vehicle(**own).map_drag_area is None
    assert Vehicle(drag_area=2.0).map_drag_area == CAR.drag_area
    assert Vehicle(**own, map_drag_area=1.0).map_drag_area == 1.0


def test_interpolate() -> None:
    grid, values = np.array([0.0, 1.0, 3.0]), np.array([2.0, 4.0, 0.0])
    for at in np.linspace(-1.0, 4.0, 41):
        expected = np.interp(at, grid, values)
        assert kernel.interpolate(grid, values, at) == pytest.approx(expected)
        assert kernel.interpolate.py_func(grid, values, at) == pytest.approx(expected)
