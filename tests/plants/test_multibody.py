"""The multi-body plant against the package of its authors, and its own properties."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from vehiclemodels.init_mb import init_mb
from vehiclemodels.utils.acceleration_constraints import acceleration_constraints
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters

from steersman.controllers.lqr import Lqr
from steersman.kernels import multibody as equations
from steersman.kernels import multibody_figures as kernel
from steersman.paths.analytic import Circle
from steersman.plants.multibody import MultiBody
from steersman.rollout import RunConfig, attempt
from steersman.types import Command, FloatArray, Pose
from steersman.vehicles import Bmw320i, CarlaModel3, Vehicle

REFERENCE = {number: setup_vehicle_parameters(vehicle_id=number) for number in (1, 2, 3)}
# Where the package has each of our states: yaw comes after speed there.
THEIRS = [0, 1, 4, 3, 10, 5, 2, *range(6, 10), *range(11, 29)]
START = Pose(0.0, 0.0, 0.0)


def body_of(p: Any) -> kernel.Body:
    tyre = {name: getattr(p.tire, f"{name[0]}_{name[1:]}") for name in kernel.Tyre._fields}
    axles = [
        kernel.Axle(mass, inertia, track, spring, damper, torsion, axis, camber, float(camber2))
        for mass, inertia, track, spring, damper, torsion, axis, camber, camber2 in (
            (p.m_uf, p.I_uf, p.T_f, p.K_sf, p.K_sdf, p.K_tsf, p.h_raf, p.D_f, p.E_f),
            (p.m_ur, p.I_ur, p.T_r, p.K_sr, p.K_sdr, p.K_tsr, p.h_rar, p.D_r, p.E_r),
        )
    ]
    return kernel.Body(
        *(
            p.I_Phi_s,
            p.I_y_s,
            p.I_xz_s,
            p.K_ras,
            p.K_rad,
            p.K_zt,
            p.K_lt,
            p.R_w,
            p.I_y_w,
            p.h_s,
            0.1,
        ),
        *axles,
        kernel.Tyre(**{name: float(value) for name, value in tyre.items()}),
    )


def vehicle_of(p: Any) -> Vehicle:
    """A coasting vehicle with a parameter set's figures."""
    load = p.m * 9.81 / (p.a + p.b)
    return Bmw320i().replace(
        mass=p.m,
        yaw_inertia=p.I_z,
        l_f=p.a,
        l_r=p.b,
        height=p.h_s,
        c_f=-p.tire.p_ky1 * load * p.b,
        c_r=-p.tire.p_ky1 * load * p.a,
        friction=p.tire.p_dy1,
        drag_area=0.0,
        rotating_mass=0.0,
        max_wheel_angle=p.steering.max,
        steer_rate_up=0.4 / p.steering.max,
        steer_rate_down=0.4 / p.steering.max,
        map_acceleration=[[0.0] * 7] * 6,
    )


def drawn(p: Any, rng: np.random.Generator) -> FloatArray:
    """A state of the package's that is disturbed everywhere, with all wheels on the ground."""
    speed, beta = rng.uniform(2.0, 40.0), rng.uniform(-0.1, 0.1)
    core = [*rng.normal(0.0, 50.0, 2), rng.uniform(-0.3, 0.3), speed, rng.uniform(-3.0, 3.0)]
    x = np.array(init_mb([*core, rng.uniform(-0.5, 0.5), beta], p), dtype=float)
    x[[6, 8, 11, 13, 18, 27, 28]] += rng.normal(0.0, 0.01, 7)
    x[[7, 9, 10, 12, 14, 15, 17, 19, 20, 22]] += rng.normal(0.0, 0.1, 10)
    x[[16, 21]] *= rng.uniform(0.9, 1.4, 2)
    x[23:27] *= rng.uniform(0.8, 1.2, 4)
    return x


def ours(p: Any, accel: float) -> Callable[[FloatArray], FloatArray]:
    """The kernel's derivative, in the package's order, for its input of an acceleration."""
    body = body_of(p)
    car = kernel.figures_of(body, vehicle_of(p).table.rows[0])
    # Vehicle 2's masses add up to its mass but for 6e-5 kg.
    rest = 0.5 * p.m_s * 9.81 / (p.a + p.b)
    front, rear = car.front._replace(rest=rest * p.b), car.rear._replace(rest=rest * p.a)
    car = car._replace(sprung=p.m_s, front=front, rear=rear)
    share = p.T_se if accel > 0.0 else p.T_sb

    def slope(x: FloatArray) -> FloatArray:
        torque = p.m * p.R_w * acceleration_constraints(x[3], accel, p.longitudinal)
        q, out, back = x[THEIRS].copy(), np.zeros(29), np.zeros(29)
        equations.derivative(body, car, share * torque, (1.0 - share) * torque, q, out)
        back[THEIRS] = out
        return back

    return slope


def theirs(p: Any, accel: float) -> Callable[[FloatArray], FloatArray]:
    def slope(x: FloatArray) -> FloatArray:
        return np.array(vehicle_dynamics_mb(list(x), [0.0, accel], p))

    return slope


def runge_kutta(slope: Callable[[FloatArray], FloatArray], x: FloatArray, h: float) -> FloatArray:
    k1 = slope(x)
    k2 = slope(x + 0.5 * h * k1)
    k3 = slope(x + 0.5 * h * k2)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(x + h * k3))


@pytest.mark.parametrize("number", REFERENCE)
def test_derivatives_and_steps_are_those_of_the_package(number: int) -> None:
    p, rng = REFERENCE[number], np.random.default_rng(number)
    body, compared = body_of(p), 0
    while compared < 100:
        x, accel = drawn(p, rng), rng.uniform(-10.0, 10.0)
        q = x[THEIRS].copy()
        loads = [
            equations.tyre_load(body, track, q, at, side)
            for at, track in ((kernel.FRONT, p.T_f), (kernel.REAR, p.T_r))
            for side in (1.0, -1.0)
        ]
        if min(loads) < 100.0:
            continue  # a lifted wheel pulls at the road there
        compared += 1
        mine, other = ours(p, accel), theirs(p, accel)
        expected = other(x)
        np.testing.assert_allclose(mine(x), expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            runge_kutta(mine, x, 1e-3), runge_kutta(other, x, 1e-3), rtol=1e-9, atol=1e-9
        )


def test_a_drive_is_that_of_the_package() -> None:
    """A second of a lane change at 15 m/s: the rule for the steps adds less than 1e-3."""
    p = REFERENCE[2]
    axles = MultiBody()
    front, rear = (
        axle.model_copy(update={"track": track})
        for axle, track in ((axles.front, p.T_f), (axles.rear, p.T_r))
    )
    plant = MultiBody(front=front, rear=rear, creep=0.1).make(vehicle_of(p))
    plant.reset(START, 15.0, 0.0)
    x = np.array(init_mb([0.0, 0.0, 0.0, 15.0, 0.0, 0.0, 0.0], p), dtype=float)
    for target in [0.04] * 2 + [-0.04] * 4 + [0.0] * 14:
        state = plant.step(Command(target / p.steering.max, 0.0, 0.0))
        for _ in range(100):
            rate = float(np.clip((target - x[2]) / 5e-4, -0.4, 0.4))

            def slope(at: FloatArray, rate: float = rate) -> FloatArray:
                return np.array(vehicle_dynamics_mb(list(at), [rate, 0.0], p))

            x = runge_kutta(slope, x, 5e-4)
    found = (state.x, state.y, state.psi, state.v_x, state.v_y, state.yaw_rate)
    np.testing.assert_allclose(found, x[[0, 1, 4, 3, 10, 5]], rtol=0.0, atol=1e-3)


def test_the_defaults_are_the_published_bmw() -> None:
    found, expected = MultiBody(creep=0.1).body(vehicle_of(REFERENCE[2])), body_of(REFERENCE[2])
    tracks = {"track": 0.0}
    axles = {"front": expected.front._replace(**tracks), "rear": expected.rear._replace(**tracks)}
    assert found == expected._replace(**axles)


@pytest.mark.parametrize("car", [Bmw320i(), CarlaModel3()])
@pytest.mark.parametrize(("speed", "curvature"), [(5.0, 0.05), (12.0, -1 / 60), (25.0, 0.005)])
def test_it_starts_in_its_own_steady_turn(car: Vehicle, speed: float, curvature: float) -> None:
    plant = MultiBody().make(car)
    first = state = plant.reset(START, speed, curvature)
    for _ in range(40):
        state = plant.step(Command(first.steer, first.throttle, first.brake))
    assert state.yaw_rate == pytest.approx(speed * curvature, abs=1e-6)
    assert (state.v_x, state.v_y) == pytest.approx((first.v_x, first.v_y), abs=1e-6)


def test_it_stands_starts_and_stops() -> None:
    plant = MultiBody().make(CarlaModel3())
    plant.reset(START, 0.0, 0.0)
    for _ in range(20):
        state = plant.step(Command(0.3, 0.0, 0.0))
    assert (state.v_x, state.yaw_rate) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert state.x == pytest.approx(0.0, abs=1e-3)  # turned wheels settle by less than that
    for _ in range(60):
        state = plant.step(Command(0.0, 0.5, 0.0))
    assert state.v_x > 4.0
    for _ in range(60):
        state = plant.step(Command(0.0, 0.0, 0.6))
    assert abs(state.v_x) < 1e-3
    assert np.isfinite(state).all()


def test_a_car_whose_wheels_lift_rolls_over() -> None:
    plant = MultiBody().make(CarlaModel3().replace(height=1.2))
    plant.reset(START, 20.0, 0.0)
    for _ in range(40):
        state = plant.step(Command(0.3, 0.3, 0.0))
    assert plant.rolled_over()
    assert np.isfinite(state).all()


@pytest.mark.parametrize("dt", [0.02, 0.033, 0.05])
def test_every_command_s_loop_drives_it(dt: float) -> None:
    plant = MultiBody(dt=dt, steering_delay=0.02)
    config = RunConfig(
        plant=plant, vehicle=Bmw320i(), controller=Lqr(), path=Circle(), duration=4.0
    )
    tried = attempt(config)
    assert tried.outcome == "finished"
    assert tried.episode.dt == dt


def test_figures_of_the_vehicle_may_change_while_it_drives() -> None:
    plants = [MultiBody().make(Bmw320i()) for _ in range(2)]
    for plant in plants:
        plant.reset(START, 15.0, 0.0)
    for k in range(20):
        if k == 10:
            plants[1].table.rows[0] = Bmw320i().replace(friction=0.2).row()
        states = [plant.step(Command(0.1, 0.3, 0.0)) for plant in plants]
        assert (states[0] == states[1]) == (k < 10)
    assert abs(states[1].a_y) < 0.25 * 9.81 < states[0].a_y
