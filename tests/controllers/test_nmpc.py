"""The nonlinear MPC against finite differences, the linear MPC, and slippery roads."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import steersman as sm
from steersman.controllers import nmpc_plan
from steersman.controllers.mpc_delay import MpcDelay
from steersman.controllers.nmpc import Nmpc
from steersman.controllers.nmpc_plan import Limits, Nlp, improved, iterated, linearised
from steersman.disturbances import SensorBias
from steersman.kernels import grip
from steersman.kernels import vehicle as car
from steersman.kernels.grip_demand import axle_share
from steersman.kernels.nmpc_model import N_WORK, move, steady_turn
from steersman.paths.analytic import Circle, FigureEight, Straight
from steersman.plants.simulator import SimulatorConfig
from steersman.speed import ConstantSpeed
from steersman.types import FloatArray, Status
from steersman.vehicles import Bmw320i, CarlaModel3, Vehicle, VwT7

from ..loops import CAR, DT, Posed, beside, drive, observe

N = 12
ROW = CAR.table.rows[0]
PLAIN = {"delay": 0.0, "disturbance_time": None, "estimate_friction": False}


def problem(grips: tuple[float, float] = (9e3, 6e3), v: float = 15.0) -> Nlp:
    """A car that slides a little on a bending road."""
    road = 0.02 * np.sin(0.2 * np.arange(N + 1))
    terminal = np.diag([3.0, 0.2, 2.0, 0.1, 1.0])
    terminal[0, 4] = terminal[4, 0] = 0.4
    return Nlp(
        row=ROW,
        speeds=np.linspace(v, v + 1.0, N + 1),
        road=road,
        headings=-0.1 * road,
        steady=3.0 * road[:-1],
        lacks=np.array([0.3, -0.2]),
        grips=np.array(grips),
        weight=np.diag([1.0, 0.02, 0.3, 0.05, 0.4]),
        price=5.0,
        terminal=terminal,
        start=np.array([0.2, 0.03, -0.4, 0.1]),
        before=0.01,
        most=0.6,
        dt=DT,
    )


def test_the_gradient_is_the_one_of_finite_differences() -> None:
    """Where the rear tyres grip; the front ones have their force as the input anyway."""
    nlp, h = problem(grips=(9e3, 2e4)), 1e-6
    plan = nlp.steady + 0.01 * np.random.default_rng(0).normal(size=N)
    step = linearised(nlp, plan)
    moved = [h * row for row in np.eye(N)]
    costs = [(linearised(nlp, plan + e).cost, linearised(nlp, plan - e).cost) for e in moved]
    numeric = [(up - down) / (2.0 * h) for up, down in costs]
    assert step.linear == pytest.approx(numeric, rel=1e-5, abs=1e-7)
    assert np.linalg.eigvalsh(step.hessian).min() > 0.0
    assert np.array_equal(step.hessian, step.hessian.T)


@pytest.mark.parametrize("kappa", [0.0, 0.005, -0.012, 0.017])
@pytest.mark.parametrize("lacks", [(0.0, 0.0), (-0.5, 0.2)])
def test_the_steady_turn_stays_as_it_is(kappa: float, lacks: tuple[float, float]) -> None:
    """Also near the grip, up to 0.9 of the rear axle's: no term of the cost pulls it away."""
    v, grips, lack = 20.0, np.array([9e3, 6e3]), np.array(lacks)
    heading, angle = steady_turn(ROW, v, kappa, lack, grips)
    z = np.array([0.0, heading, -v * math.tan(heading), v * kappa])
    held, rest = z.copy(), (np.empty((4, 4)), np.empty(4), np.empty((N_WORK, 4)))
    move(ROW, v, kappa * v / math.hypot(v, z[2]), lack, grips, angle, 1e-3, held, *rest)
    assert held[1:] == pytest.approx(z[1:], abs=5e-5)
    assert held[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("estimator", [None, "kalman"])
def test_a_turn_near_the_grip_is_held_from_its_first_moment(estimator: str | None) -> None:
    """At 0.68 of it the plan once steered towards the heading error of tyres without a limit."""
    found = sm.drive(
        "tuned/nmpc",
        path="circle",
        speed={"kind": "constant_speed", "speed": 31.6},
        estimator=estimator,
        duration=4.0,
    )
    assert np.abs(found["lateral_error"]).max() < 0.02


@pytest.mark.parametrize("vehicle", [CarlaModel3(), Bmw320i()])
@pytest.mark.parametrize("kind", ["nmpc", "mpc_delay"])
@pytest.mark.parametrize(("seed", "radius"), [(3, 40.0), (5, 60.0)])
def test_four_fifths_of_the_grip_are_held(
    kind: str, vehicle: Vehicle, seed: int, radius: float
) -> None:
    """Linear tyres in the plan lost the second car, for which nothing is tuned; 20 steps both."""
    found = sm.drive(
        f"estimated/tuned/{kind}",
        path={
            "kind": "harmonic_road",
            "seed": seed,
            "distance": 20.0 * radius,
            "min_radius": radius,
            "shortest": 40.0 + radius,
        },
        speed={
            "kind": "profile",
            "a_lat_max": 0.8 * vehicle.friction * 9.81,
            "deceleration": 3.0,
            "acceleration": 2.5,
        },
        vehicle=vehicle,
        duration=60.0,
    )
    assert found.completed, found.end


def test_a_turn_needs_the_share_of_grip_that_its_forces_are() -> None:
    for side in (-9.0, 0.5, 12.0):
        grips = np.array(grip.axle_grips(ROW, CAR.friction, 0.0, 0.0))
        share = axle_share(ROW, 0.0, 0.0, CAR.mass * abs(side)) / CAR.friction
        assert grip.turn_share(ROW, grips, side) == pytest.approx(share, rel=1e-6)


def test_iterations_find_the_least_cost() -> None:
    nlp, limits = problem(), Limits(0.0, 10.0)
    plan, solved = iterated(nlp, limits, np.zeros(0), 30)
    best, rng = linearised(nlp, plan).cost, np.random.default_rng(1)
    assert solved
    for size in (1e-2, 1e-3):
        for _ in range(20):
            assert linearised(nlp, plan + size * rng.normal(size=N)).cost > best - 1e-9


def test_limits_are_kept_where_they_bind() -> None:
    nlp, limits = problem(grips=(3e3, 3e3)), Limits(0.0, 0.01)
    step = linearised(nlp, nlp.steady)
    plan = improved(step, limits)
    assert plan is not None
    changes = np.diff(plan, prepend=0.0)
    assert abs(changes).max() == pytest.approx(0.01, rel=1e-6)
    ramp = 0.01 * np.arange(1, N + 1)
    assert (plan <= np.maximum(step.high, -ramp) + 1e-9).all()
    assert (plan >= np.minimum(step.low, ramp) - 1e-9).all()


@pytest.mark.parametrize("v", [3.0, 12.0, 25.0])
def test_with_grip_and_small_errors_it_is_the_linear_plan(v: float) -> None:
    """Both minimise one cost; they differ by how they integrate and by squares of the errors."""
    path, scale = Straight(), 1e-3
    state = beside(path, 5.0, d=scale, heading=0.3 * scale, velocity=(v, scale), yaw_rate=scale)
    seen = observe(path, state, 5.0)
    nonlinear, linear = Nmpc(**PLAIN, iterations=3), MpcDelay(**PLAIN)
    ours, theirs = (c.step(c.init(CAR, DT), seen)[0].steer for c in (nonlinear, linear))
    assert ours == pytest.approx(theirs, rel=0.02)


def test_the_inverse_tyre_is_the_inverse() -> None:
    for limit in (2e3, 1e4, 1e9):
        for angle in (-0.03, 0.0, 0.01, 0.05):
            real = grip.angle_for_linear(ROW, limit, 0.01, angle)
            share = abs(ROW[car.C_F] * (angle - 0.01)) / limit
            expected = angle if share < 1.0 else 0.01 + math.copysign(limit / ROW[car.C_F], angle)
            assert grip.linear_for_angle(ROW, limit, 0.01, real) == pytest.approx(
                expected, rel=1e-3
            )


def on_circle(controller: Any, speed: float, **options: Any) -> tuple[FloatArray, Any]:
    """Lateral errors on a path, a circle of 50 m [m], and the controller's state at the end."""
    states: list[Any] = []

    class Watched(type(controller)):  # type: ignore[misc] # the class is the parameter
        kind = ""

        def decide(self, state: Any, observation: Any) -> Any:
            states.append(super().decide(state, observation))
            return states[-1]

    path = options.pop("path", Circle())
    episode = drive(
        Watched(**controller.model_dump()), path, speed=ConstantSpeed(speed=speed), **options
    )
    assert episode.completed, episode.end
    return episode["lateral_error"], states[-1][2]


@pytest.mark.parametrize("kind", [Nmpc, MpcDelay])
@pytest.mark.parametrize("share", [0.6, 0.85])
def test_holds_a_slippery_circle_and_finds_its_friction(kind: Any, share: float) -> None:
    friction = 0.5
    slippery = CAR.replace(friction=friction)
    speed = math.sqrt(share * friction * 9.81 * 50.0)
    errors, state = on_circle(kind(), speed, vehicle=slippery, nominal=CAR, duration=15.0)
    assert abs(errors).max() < 0.25
    assert abs(errors[-60:]).max() < 0.01
    if share > 0.8:
        assert state.motion.friction == pytest.approx(friction, rel=0.3)


@pytest.mark.parametrize("nominal", [1.0, 3.0])
@pytest.mark.parametrize("kind", [CarlaModel3, Bmw320i, VwT7])
def test_a_slide_is_told_from_a_wrong_stiffness_whatever_grip_the_car_should_have(
    kind: Any, nominal: float
) -> None:
    """An axle with 0.4 of its weight for a force, at slips from where the brush tyre slides on.

    Half or one and a half of a stiffness at a small slip is no want of grip.
    """
    row = kind().replace(friction=nominal).row()
    frictions, v = np.linspace(0.1, nominal, 32), 12.0
    grips = np.array(grip.axle_grips(row, 0.4, v, 0.0))
    stiffness = np.array([row[car.C_F], row[car.C_R]])

    def scores(slips: FloatArray, forces: FloatArray) -> tuple[FloatArray, int]:
        found = np.zeros(32)
        best = grip.score_frictions(row, frictions, v, 0.0, slips, forces, np.zeros(2), 0.0, found)
        return found, best

    for times in (1.0, 2.0, 5.0):
        slips = times * 3.0 * grips / stiffness
        found, best = scores(slips, -grips)
        assert found[-1] > found[best] + 1.5
        assert frictions[best] < 0.6
    for wrong in (0.5, 1.5):
        slips = 0.1 * grips / stiffness
        found, best = scores(slips, -wrong * stiffness * slips)
        assert found[-1] < found[best] + 1.5


@pytest.mark.parametrize("nominal", [CAR.replace(c_f=1.3 * CAR.c_f, c_r=1.3 * CAR.c_r), CAR])
def test_a_soft_or_exact_car_keeps_its_nominal_friction(nominal: Any) -> None:
    _, state = on_circle(Nmpc(), 15.0, nominal=nominal, duration=8.0)
    assert state.motion.friction == nominal.friction


@pytest.mark.parametrize("kind", [Nmpc, MpcDelay])
@pytest.mark.parametrize("bias", [-0.02, 0.02])
def test_a_wrong_steering_angle_is_not_taken_for_ice(kind: Any, bias: float) -> None:
    """It moves the front axle's slip by a constant, where less grip shows at large slips only."""
    biased = CAR.replace(steer_bias=bias)
    eight = {"path": FigureEight(), "vehicle": biased, "nominal": CAR, "duration": 20.0}
    errors, state = on_circle(kind(), 12.0, **eight)
    assert state.motion.friction > 0.5 * CAR.friction
    assert abs(errors).max() < 0.04


@pytest.mark.parametrize("kind", [Nmpc, MpcDelay])
def test_a_wrong_side_velocity_is_not_taken_for_ice(kind: Any) -> None:
    """At low speed an error of 0.15 m/s moves the slips by as much as a slide on ice does."""
    wrong = (SensorBias(v_y=0.15),)
    _, state = on_circle(kind(), 4.0, disturbances=wrong, duration=8.0)
    assert state.motion.friction > 0.5 * CAR.friction


@pytest.mark.parametrize("delay", [0.1, 0.2])
def test_a_delay_costs_little(delay: float) -> None:
    plant = SimulatorConfig(steering_delay=delay)
    episode = drive(
        Nmpc(delay=delay), FigureEight(), speed=ConstantSpeed(speed=8.0), plant=plant, duration=20.0
    )
    assert episode.completed
    assert abs(episode["lateral_error"]).max() < 0.02


def test_a_solver_that_fails_goes_on_with_the_last_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nmpc_plan, "improved", lambda *_: None)
    path, controller = Posed(), Nmpc()
    seen = observe(path, beside(path, 5.0, d=0.1), 5.0)
    decision, state = controller.step(controller.init(CAR, DT), seen)
    assert decision.status is Status.FALLBACK
    assert state.plan == pytest.approx(np.zeros(controller.horizon), abs=0.05)
