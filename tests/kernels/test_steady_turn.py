"""Steady turns: closed forms, existence, and that the simulated car settles in them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from steersman.kernels import vehicle as kernel
from steersman.kernels.steady_turn import steady_turn
from steersman.types import FloatArray
from steersman.vehicles import Bmw320i, CarlaMkz2020, CarlaModel3, CarlaModel3V1, Vehicle

CAR = CarlaModel3()
FIRST = CarlaModel3V1()
CARS = {car.kind: car for car in (CAR, FIRST, CarlaMkz2020(), Bmw320i())}


def steady(car: Vehicle, speed: float, curvature: float) -> FloatArray:
    state = np.zeros(kernel.N_STATE)
    assert steady_turn(car.table, 0, state, speed, curvature)
    return state


def slip(state: FloatArray) -> float:
    return math.atan2(state[kernel.VY], state[kernel.VX])


def held_throttle(speed: float, car: Vehicle = CAR) -> float:
    return float(steady(car, speed, 0.02)[kernel.THROTTLE])


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
@pytest.mark.parametrize("soft", [1.0, 0.7])
@pytest.mark.parametrize(("speed", "curvature"), [(12.0, 0.004), (20.0, 0.002), (20.0, -0.002)])
def test_closed_forms_at_small_slip(
    car: Vehicle, soft: float, speed: float, curvature: float
) -> None:
    # A softer front axle understeers; much grip keeps the tyres in their linear range.
    car = car.replace(c_f=soft * car.c_f, friction=30.0)
    state = steady(car, speed, curvature)
    assert state[kernel.YAW_RATE] == speed * curvature
    base, m = car.wheelbase, car.mass
    # Rajamani, Vehicle Dynamics and Control, 2nd ed., eqs. 3.15 and 3.21.
    kinematic, dynamic = car.l_r * curvature, m * car.l_f * speed**2 * curvature / (car.c_r * base)
    largest = max(abs(kinematic), abs(dynamic))
    assert slip(state) == pytest.approx(kinematic - dynamic, abs=0.02 * largest)
    k_us = m / base * (car.l_r / car.c_f - car.l_f / car.c_r)
    wheel = base * curvature + k_us * speed**2 * curvature
    assert state[kernel.WHEEL] == pytest.approx(wheel, rel=0.02)


@pytest.mark.parametrize("car", CARS.values(), ids=CARS)
def test_every_turn_within_the_grip_is_found(car: Vehicle) -> None:
    # Straight ahead too: the rear-driven BMW's braked rear axle once had no slope to follow.
    for speed in np.arange(0.0, 45.0, 1.5):
        for curvature in (-0.1, -0.02, -0.005, 0.0, 0.005, 0.02, 0.1):
            if speed**2 * abs(curvature) < 0.6 * car.friction * kernel.GRAVITY / 1.5:
                state = steady(car, speed, curvature)
                assert np.isfinite(state).all()
                assert math.hypot(*state[kernel.VX : kernel.YAW_RATE]) == pytest.approx(speed)


@pytest.mark.parametrize("curvature", [0.02, -0.02, 0.06])
def test_turn_is_an_equilibrium(curvature: float) -> None:
    for speed in (2.0, 5.0, 9.9, 14.0):
        state = steady(CAR, speed, curvature)
        out = np.zeros(kernel.N_MOTION)
        pedals = state[kernel.THROTTLE], state[kernel.BRAKE]
        axles, moved = kernel.tyres(CAR.table.rows[0]), state[: kernel.N_MOTION]
        kernel.derivative(CAR.table, 0, axles, moved, state[kernel.STEER], *pedals, out)
        assert out[kernel.VX :] == pytest.approx(np.zeros(5), abs=1e-8)
        python = np.zeros(kernel.N_STATE)
        assert steady_turn.py_func(CAR.table, 0, python, speed, curvature)
        assert python == pytest.approx(state, abs=1e-10)


def test_impossible_turn_is_kinematic() -> None:
    state = np.zeros(kernel.N_STATE)
    assert not steady_turn(CAR.table, 0, state, 30.0, 0.1)
    assert np.isfinite(state).all()
    assert abs(state[kernel.STEER]) <= 1.0
    assert slip(state) == pytest.approx(math.atan(CAR.l_r * 0.1))
    assert state[kernel.YAW_RATE] == pytest.approx(3.0)


@pytest.mark.parametrize("speed", [6.0, 12.0, 18.0])
def test_disturbed_car_settles_in_the_turn(speed: float) -> None:
    expected = steady(CAR, speed, 0.02)
    state = expected.copy()
    state[kernel.VY] += 0.4
    state[kernel.YAW_RATE] -= 0.1
    command = expected[[kernel.STEER, kernel.THROTTLE, kernel.BRAKE]]
    work = np.zeros((3, kernel.N_MOTION))
    kernel.advance(CAR.table, 0, state, command, 0.01, 12000, work)
    for column in (kernel.VX, kernel.VY, kernel.YAW_RATE, kernel.AX, kernel.AY):
        assert state[column] == pytest.approx(expected[column], abs=2e-3)


# The 50 m circle: speeds at which a PhysX 5 car with CARLA's figures settles, and its side-slip.
@pytest.mark.parametrize(
    ("throttle", "speed", "side_slip"),
    [(0.4, 8.59, None), (0.6, 19.5, -1.15), (0.8, 29.3, -6.04)],
)
def test_speed_and_slip_on_the_circle_are_those_of_physx(
    throttle: float, speed: float, side_slip: float | None
) -> None:
    found = brentq(lambda v: held_throttle(v) - throttle, speed - 1.0, speed + 1.0)
    assert found == pytest.approx(speed, rel=0.02)
    if side_slip is not None:
        assert math.degrees(slip(steady(CAR, found, 0.02))) == pytest.approx(side_slip, abs=1.0)


@pytest.mark.parametrize(
    ("speed", "wheel", "side_slip"),
    [(9.9, 3.46, 1.28), (18.7, 3.47, -0.9), (22.2, 3.50, -2.2), (24.2, 3.53, -3.1)],
)
def test_wheel_angle_and_slip_at_a_speed_are_those_of_physx(
    speed: float, wheel: float, side_slip: float
) -> None:
    turn = steady(CAR, speed, 0.02)
    assert math.degrees(turn[kernel.WHEEL]) == pytest.approx(wheel, abs=0.08)
    assert math.degrees(slip(turn)) == pytest.approx(side_slip, abs=0.55)


def test_the_first_stages_car_on_the_circle() -> None:
    for throttle, speed in ((0.4, 8.4), (0.6, 18.3), (0.8, 26.0)):
        found = brentq(lambda v, t=throttle: held_throttle(v, FIRST) - t, speed - 2.0, speed + 2.0)
        assert found == pytest.approx(speed, abs=0.3)
    # It explained the published agent's heading errors by side-slip: 0.92 and 2.12 degrees.
    assert -math.degrees(slip(steady(FIRST, 18.3, 0.02))) == pytest.approx(2.15, abs=0.05)
    assert math.degrees(slip(steady(FIRST, 9.9, 0.02))) == pytest.approx(0.92, abs=0.1)


def test_the_first_stages_car_rolls_over_before_it_settles() -> None:
    lifting = brentq(
        lambda v: steady(FIRST, v, 0.02)[kernel.LOAD_AY] - FIRST.roll_over_acceleration, 25.0, 29.0
    )
    # sqrt(14.87 m/s^2 x 50 m); a little more, because the car points inwards.
    assert lifting == pytest.approx(27.3, abs=0.2)
    assert held_throttle(lifting, FIRST) < 0.9
