"""The planar model against the single-track model of CommonRoad, where the two coincide.

CommonRoad's model (Althoff and Wuersching, CommonRoad: Vehicle Models, 2020) has a linear tyre,
one wheel per axle and no drag. So the car here gets much grip (linear tyre), no drag, no engine
map and no softening of slip at low speed.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st

from steersman.kernels import vehicle as kernel
from steersman.types import FloatArray
from steersman.vehicles import Bmw320i, Vehicle

REFERENCE = parameters_vehicle2()
COASTING = Bmw320i().replace(drag_area=0.0, map_acceleration=[[0.0] * 7] * 6)
SECONDS = 3.0


def reference(speed: float, wheel: float) -> FloatArray:
    """Rows of x, y, wheel angle, speed, yaw, yaw rate, side-slip after each 0.05 s.

    The classical Runge-Kutta rule with steps of 1 ms; the steering ends on one of them.
    """
    x, rows = np.array([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0]), []
    turning, h = round(abs(wheel) / 0.4 / 1e-3), 1e-3
    for i in range(round(SECONDS / h)):
        u = [math.copysign(0.4, wheel) if i < turning else 0.0, 0.0]
        k1 = _slope(x, u)
        k2 = _slope(x + 0.5 * h * k1, u)
        k3 = _slope(x + 0.5 * h * k2, u)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + _slope(x + h * k3, u))
        if i % 50 == 49:
            rows.append(x)
    return np.array(rows)


def _slope(x: FloatArray, u: list[float]) -> FloatArray:
    return np.array(vehicle_dynamics_st(x, u, REFERENCE))


def planar(car: Vehicle, speed: float, wheel: float) -> FloatArray:
    table = car.table._replace(rows=car.row()[None, :])
    table.rows[0, kernel.SLIP_SPEED] = 1e-3
    state, work = np.zeros(kernel.N_STATE), np.zeros((3, kernel.N_MOTION))
    state[kernel.VX] = speed
    command = np.array([wheel / car.max_wheel_angle, 0.0, 0.0])
    rows = []
    for _ in range(60):
        kernel.advance(table, 0, state, command, 0.01, 5, work)
        v_x, v_y = state[kernel.VX], state[kernel.VY]
        rows.append(
            [
                *(state[kernel.X], state[kernel.Y], state[kernel.WHEEL], math.hypot(v_x, v_y)),
                *(state[kernel.PSI], state[kernel.YAW_RATE], math.atan2(v_y, v_x)),
            ]
        )
    return np.array(rows)


def differences(car: Vehicle, speed: float, wheel: float) -> FloatArray:
    """Largest difference of each column, relative to the column's largest value."""
    expected, found = reference(speed, wheel), planar(car, speed, wheel)
    relative: FloatArray = np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)
    return relative


def test_parameters_are_those_of_commonroad() -> None:
    car, tyre = Bmw320i(), REFERENCE.tire
    assert car.mass == pytest.approx(REFERENCE.m, rel=1e-4)
    assert car.yaw_inertia == pytest.approx(REFERENCE.I_z, rel=1e-4)
    assert (car.l_f, car.l_r) == pytest.approx((REFERENCE.a, REFERENCE.b), abs=1e-4)
    assert car.height == pytest.approx(REFERENCE.h_s, abs=1e-4)
    assert car.friction == pytest.approx(tyre.p_dy1)
    assert car.max_wheel_angle == pytest.approx(REFERENCE.steering.max)
    assert car.steer_rate_up * car.max_wheel_angle == pytest.approx(REFERENCE.steering.v_max)
    # C_S = p_ky1 / p_dy1; an axle's stiffness is mu C_S F_z.
    load = car.mass * kernel.GRAVITY * car.l_r / car.wheelbase
    assert car.c_f == pytest.approx(-tyre.p_ky1 * load, rel=1e-4)


@pytest.mark.parametrize("speed", [8.0, 15.0, 25.0])
@pytest.mark.parametrize("wheel", [0.004, -0.008])
def test_trajectories_agree_in_the_linear_range(speed: float, wheel: float) -> None:
    linear = COASTING.replace(friction=200.0, height=1e-3)
    relative = differences(linear, speed, wheel)
    # Position, wheel angle, speed and yaw; yaw rate; side-slip.
    assert relative[:5].max() < 2e-3
    assert relative[5] < 3e-3
    assert relative[6] < 8e-3


def test_trajectories_stay_close_with_real_grip_and_load_transfer() -> None:
    # 1.4 m/s^2 of the tyres' 10.3: saturation takes a few per cent of the stiffness.
    relative = differences(COASTING, 15.0, 0.016)
    assert relative[:5].max() < 0.01
    assert relative[5] < 0.04
    assert relative[6] < 0.1
