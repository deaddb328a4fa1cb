"""The delay-aware MPC against regulators, solvers and simulations that know nothing of it."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from steersman.config import resolve
from steersman.controllers import mpc_delay_plan
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_delay import MpcDelay
from steersman.controllers.mpc_delay_plan import (
    PlanProblem,
    Weights,
    build_model,
    build_tables,
)
from steersman.controllers.single_track import discrete, error_model
from steersman.metrics.driving import rms_lateral_error
from steersman.paths.analytic import Circle, FigureEight, Straight
from steersman.plants.simulator import SimulatorConfig
from steersman.speed import ConstantSpeed
from steersman.types import FloatArray, Status
from steersman.vehicles import Bmw320i

from ..loops import CAR, DT, Posed, beside, drive, observe
from .test_lqr import riccati_iteration
from .test_mpc import least_distance

N, V = 20, 10.0
WEIGHTS = Weights(1.0, 0.02, 0.3, 0.05, 0.4, 5.0)
PLAIN = MpcDelay(delay=0.0, disturbance_time=None)


def problem(seed: int = 0, size: float = 1.0, most: float = 0.5, step: float = 0.1) -> PlanProblem:
    """Any state, any road, a little off."""
    rng = np.random.default_rng(seed)
    model = build_model(CAR, DT, N, WEIGHTS, V)
    xi = size * rng.normal(size=4) * [0.2, 0.2, 0.05, 0.1]
    road = 0.02 * np.sin(0.3 * np.arange(N + 1) + rng.uniform(0.0, 6.0))
    return PlanProblem(model, road, xi, float(model.steady[1, 0]), 0.003, most, step)


def cost(p: PlanProblem, plan: FloatArray, before: float) -> float:
    """The cost as documented, simulated step by step, with the end by a long free run."""
    model = discrete(error_model(CAR, V), DT)
    heading = p.model.steady[0, 0]
    xi, u, total = p.xi, before, 0.0
    for i in range(4000):
        stage = np.append(xi**2, u * u)
        if i > 0:
            total += float(np.array(WEIGHTS[:5]) @ stage)
        change = plan[i] - u if i < N else -float(p.model.gain @ np.append(xi, u))
        u += change
        total += WEIGHTS.change * change * change
        xi = model.a @ xi + model.b * u
        if i < N:
            xi[2] += heading * (p.road[i] - p.road[i + 1])
    return total


@pytest.mark.parametrize("seed", range(5))
def test_the_free_plan_is_the_least_of_the_condensed_cost(seed: int) -> None:
    p = problem(seed)
    hessian, linear = mpc_delay_plan.condensed(p, WEIGHTS, 0.01)
    plan = mpc_delay_plan.free_plan(p, 0.01)
    assert plan == pytest.approx(-np.linalg.solve(hessian, linear), abs=1e-9)


def test_the_condensed_cost_is_the_documented_one() -> None:
    p, rng = problem(), np.random.default_rng(1)
    hessian, linear = mpc_delay_plan.condensed(p, WEIGHTS, 0.01)
    plans = rng.normal(0.0, 0.1, (6, N))
    ours = [u @ hessian @ u + 2.0 * linear @ u for u in plans]
    real = [cost(p, u, 0.01) for u in plans]
    assert np.diff(ours) == pytest.approx(np.diff(real), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("most", "step"), [(0.02, 1.0), (1.0, 0.004), (0.03, 0.01)])
def test_with_active_limits_it_is_the_reference_solvers_plan(most: float, step: float) -> None:
    eye, active = np.eye(N), 0
    changes = eye - np.eye(N, k=-1)
    for seed in range(5):
        p, last = problem(seed, most=most, step=step), 0.01
        steady = p.angle_per_kappa * p.road[:-1] + p.angle_offset
        before = last - steady[0]
        hessian, linear = mpc_delay_plan.condensed(p, WEIGHTS, before)
        moves = changes @ steady - last * eye[0]
        rows = np.vstack([eye, -eye, changes, -changes])
        limits = np.concatenate([most - steady, most + steady, step - moves, step + moves])
        expected = least_distance(hessian, linear, rows, limits)
        plan = mpc_delay_plan.limited_plan(p, WEIGHTS, before, steady, last)
        assert plan == pytest.approx(expected, abs=1e-6)
        active += bool(abs(expected - mpc_delay_plan.free_plan(p, before)).max() > 1e-3)
    assert active == 5


@pytest.mark.parametrize("periods", [0, 1, 4])
def test_is_the_regulator_of_the_car_with_its_delay(periods: int) -> None:
    """States: errors, commands on their way, the last deviation; gain by value iteration."""
    controller = PLAIN.model_copy(update={"delay": periods * DT})
    model, n = discrete(error_model(CAR, V), DT), 5 + periods
    # The command that acts now is the oldest one, or without delay the one decided now.
    a, b = np.zeros((n, n)), np.zeros(n)
    a[:4, :4] = model.a
    chain = list(range(4, 4 + periods))  # oldest first
    for here, following in pairwise(chain):
        a[here, following] = 1.0
    a[n - 1, n - 1] = b[n - 1] = 1.0
    if periods:
        a[:4, 4] = model.b
        a[chain[-1], n - 1] = b[chain[-1]] = 1.0
    else:
        a[:4, n - 1], b[:4] = model.b, model.b
    w, q = controller.weights(), np.zeros((n, n))
    q[range(4), range(4)] = w[:4]
    # The price of an angle counts when it has acted, whichever command that is.
    q[4 if periods else n - 1, 4 if periods else n - 1] += w.angle
    gain = riccati_iteration(a, b, q, w.change)
    e1, heading, side, rate = 1e-3, 2e-4, 3e-3, -1e-3
    path, v = Straight(), V
    car = beside(path, 9.0, d=e1, heading=heading, velocity=(v, side), yaw_rate=rate, steer=0.0)
    decision, _ = controller.step(controller.init(CAR, DT), observe(path, car, 9.0))
    state = np.zeros(n)
    state[:4] = e1, v * math.sin(heading) + side * math.cos(heading), heading, rate
    expected = CAR.steer_for_wheel_angle(float(-gain @ state), v)
    assert decision.steer == pytest.approx(expected, rel=2e-3)


def test_a_delay_of_nothing_is_no_delay() -> None:
    runs = [
        drive(PLAIN.model_copy(update={"delay": delay}), Posed(), duration=5.0)
        for delay in (0.0, 1e-12)
    ]
    assert runs[0]["steer_command"] == pytest.approx(runs[1]["steer_command"], abs=1e-9)


def eight(controller: MpcDelay, delay: float) -> float:
    """RMS lateral error on the figure-eight at 8 m/s [m]; infinite if the car left it."""
    plant = SimulatorConfig(steering_delay=delay)
    episode = drive(
        controller, FigureEight(), speed=ConstantSpeed(speed=8.0), plant=plant, duration=20.0
    )
    return rms_lateral_error(episode) if episode.completed else math.inf


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.13, 0.2])
def test_a_known_delay_costs_little(delay: float) -> None:
    assert eight(MpcDelay(delay=delay), delay) < 0.003


@pytest.mark.parametrize("delay", [0.05, 0.13, 0.2])
def test_an_unknown_delay_is_found(delay: float) -> None:
    """Where steering moves slowly, no better than to a period; in whole periods, exactly."""
    whole = math.isclose(delay % DT, 0.0, abs_tol=1e-9) or math.isclose(delay % DT, DT)
    known = eight(MpcDelay(delay=delay), delay)
    assert eight(MpcDelay(), delay) < (1.05 * known if whole else 0.003)


def test_a_wrong_delay_is_what_the_others_suffer_from() -> None:
    assert eight(MpcDelay(delay=0.0), 0.2) > 0.1


WRONG = CAR.replace(mass=1.3 * CAR.mass, c_f=0.7 * CAR.c_f, c_r=1.2 * CAR.c_r)


@pytest.mark.parametrize("estimated", [True, False])
def test_no_steady_error_with_wrong_parameters(estimated: bool) -> None:
    """Only the estimate of what the model lacks does that."""
    controller = MpcDelay(disturbance_time=0.3 if estimated else None)
    speed = ConstantSpeed(speed=10.0)
    episode = drive(controller, Circle(), speed=speed, nominal=WRONG, duration=20.0)
    late = abs(episode["lateral_error"][-40:]).max()
    assert late < 1e-4 if estimated else late > 5e-3


def test_steering_rate_is_kept() -> None:
    """A slow servo is asked for nothing that it cannot do, so that it follows its command."""
    bmw, path = Bmw320i(), Posed()
    controller = MpcDelay(delay=0.0, q_lateral=50.0)
    state = controller.init(bmw, DT)
    state_0, angles = state, []
    for d in (1.0, 1.0, -1.0, -1.0, 1.0):
        car = beside(path, 5.0, d=d, steer=0.0)
        decision, state = controller.step(state, observe(path, car, 5.0))
        assert decision.status is Status.SOLVED
        angles.append(state.angle)
    largest = bmw.steer_rate_up * bmw.max_wheel_angle * DT
    assert abs(np.diff(angles, prepend=state_0.angle)).max() == pytest.approx(largest, rel=1e-6)


def test_a_solver_that_fails_leaves_the_clipped_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mpc_delay_plan, "limited_plan", lambda *_: None)
    bmw, path = Bmw320i(), Posed()
    state = MpcDelay().init(bmw, DT)
    decision, state = MpcDelay().step(state, observe(path, beside(path, 5.0, d=1.4), 5.0))
    assert decision.status is Status.FALLBACK
    largest = bmw.steer_rate_up * bmw.max_wheel_angle * DT
    assert state.angle == pytest.approx(-largest)


def test_tables_between_two_speeds() -> None:
    tables = build_tables(CAR, DT, N, WEIGHTS)
    for v in (1.0, 7.5, 7.73, 40.0):
        for ours, exact in zip(tables.at(v), build_model(CAR, DT, N, WEIGHTS, v), strict=True):
            assert ours == pytest.approx(exact, rel=0.02, abs=0.02 * abs(exact).max())


@pytest.mark.parametrize("v", [3.0, 8.0, 20.0])
def test_holds_the_circle(v: float) -> None:
    episode = drive(MpcDelay(), Circle(), speed=ConstantSpeed(speed=v), duration=20.0)
    assert episode.completed
    assert abs(episode["lateral_error"][-40:]).max() < 1e-3


def test_the_delay_is_driven_through_at_its_mean_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Accelerating by 2 m/s^2, a car is 0.2 m/s faster in the middle of a delay of 0.2 s."""
    from steersman.controllers import delay_mpc

    speeds: list[float] = []
    through = delay_mpc.kernel.through_delay

    def noted(table: Any, speed: float, *rest: Any) -> Any:
        speeds.append(speed)
        return through(table, speed, *rest)

    monkeypatch.setattr(delay_mpc.kernel, "through_delay", noted)
    controller, path = MpcDelay(delay=0.2), Posed()
    state = controller.init(CAR, DT)
    for k in range(100):
        v, s = 10.0 + 2.0 * DT * k, 5.0 + 10.0 * DT * k + (DT * k) ** 2
        car = beside(path, s, velocity=(v, 0.0), time=DT * k)
        _, state = controller.step(state, observe(path, car, s))
    assert speeds[-1] - v == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("around", ["estimated", "grip_speed", "time_gap"])
def test_a_redesign_builds_models_where_the_car_drives_alone(around: str) -> None:
    """As an agent that sets weights twice a second needs it, whatever is around the MPC."""
    field = "controller" if around == "estimated" else "inner"
    inner = {"kind": "mpc_delay", "r": 0.0123 + 0.001 * len(around)}  # tables of no other test
    controller = resolve("controller", {"kind": around, field: inner})
    assert isinstance(controller, ControllerComponent)
    state = controller.redesign(CAR, DT)
    controller.step(state, observe(Straight(), beside(Straight(), 50.0), 50.0))
    tables = getattr(state, "controller" if around == "estimated" else "inner").tables
    assert sum(model is not None for model in tables._models) <= 2
