"""Error dynamics, their discrete regulator and its feed-forward against other derivations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from steersman.controllers import single_track as em
from steersman.controllers.lqr import Lqr, gain_at
from steersman.controllers.riccati import regulators, riccati
from steersman.controllers.single_track import single_track, steady_side_slip, steady_wheel_angle
from steersman.paths.analytic import Circle, Straight
from steersman.speed import ConstantSpeed
from steersman.types import FloatArray
from steersman.vehicles import CarlaModel3V1

from ..loops import CAR, DT, beside, drive, observe

SPEEDS = [1.0, 5.0, 12.0, 30.0]


def riccati_iteration(a: FloatArray, b: FloatArray, q: FloatArray, r: float) -> FloatArray:
    """The gain by value iteration: the cost of ever longer horizons, until it stands still."""
    p, b = q.copy(), b[:, None]
    for _ in range(20_000):
        gain = (b.T @ p @ a) / (r + b.T @ p @ b)
        after = q + a.T @ p @ (a - b @ gain)
        if abs(after - p).max() < 1e-13 * abs(p).max():
            break
        p = 0.5 * (after + after.T)
    result: FloatArray = gain[0]
    return result


def lqr_gain(a: FloatArray, b: FloatArray, q: FloatArray, r: float) -> FloatArray:
    found: FloatArray = regulators(a[None], b[None], q, r)[0]
    return found


def test_systems_are_solved_as_by_schur_vectors() -> None:
    models = [em.discrete(em.error_model(CAR, v), DT) for v in SPEEDS]
    for r in (1e-2, 3.0, 1e3):
        q = np.diag([100.0 / r, 0.0, 1e-2 * r, 1.0])
        for one in models:
            ours = riccati(one.a, one.b, q, r)
            theirs = solve_discrete_are(one.a, one.b[:, None], q, np.array([[r]]))
            assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-9 * abs(theirs).max())
    with pytest.raises(np.linalg.LinAlgError):  # grows, and nothing acts on it
        riccati(2.0 * np.eye(4), np.zeros(4), np.eye(4), 1.0)


@pytest.mark.parametrize("v", SPEEDS)
def test_gain_is_that_of_the_riccati_iteration(v: float) -> None:
    model = em.discrete(em.error_model(CAR, v), DT)
    q = np.diag([1.0, 0.02, 2.0, 0.05])
    gain = lqr_gain(model.a, model.b, q, 3.0)
    assert gain == pytest.approx(riccati_iteration(model.a, model.b, q, 3.0), rel=1e-6)


# control.dlqr of python-control 0.10.2, for the model of carla_model3_v1,
# Q = diag(1, 0.02, 2, 0.05) and R = 3.
DLQR = {
    5.0: (0.51728334, 0.03110363, 1.27284193, 0.06430101),
    12.0: (0.46737335, 0.06101863, 1.4547784, 0.11882154),
    30.0: (0.42071802, 0.09527009, 1.82150149, 0.160213),
}


@pytest.mark.parametrize("v", DLQR)
def test_gain_is_that_of_python_control(v: float) -> None:
    model = em.discrete(em.error_model(CarlaModel3V1(), v), DT)
    gain = lqr_gain(model.a, model.b, np.diag([1.0, 0.02, 2.0, 0.05]), 3.0)
    assert tuple(gain) == pytest.approx(DLQR[v], rel=1e-6)


@pytest.mark.parametrize("v", SPEEDS)
def test_gain_of_the_schedule_is_that_speeds(v: float) -> None:
    controller = Lqr(q_lateral=2.0, q_lateral_rate=0.1, q_heading=0.3, q_yaw_rate=0.2, r=4.0)
    model = em.discrete(em.error_model(CAR, v), DT)
    expected = lqr_gain(model.a, model.b, np.diag([2.0, 0.1, 0.3, 0.2]), 4.0)
    assert gain_at(controller.init(CAR, DT).gains, v) == pytest.approx(tuple(expected))


def test_any_other_gain_costs_more() -> None:
    model, rng = em.discrete(em.error_model(CAR, 10.0), DT), np.random.default_rng(0)
    q, r = np.diag([1.0, 0.01, 1.0, 0.01]), 5.0
    best = lqr_gain(model.a, model.b, q, r)

    def cost(gain: FloatArray) -> float:
        x, total = np.array([1.0, 0.2, -0.1, 0.3]), 0.0
        for _ in range(600):
            u = -gain @ x
            total += x @ q @ x + r * u * u
            x = model.a @ x + model.b * u
        return float(total)

    for _ in range(20):
        assert cost(best * (1.0 + 0.1 * rng.normal(size=4))) > cost(best)


@pytest.mark.parametrize("v", SPEEDS)
def test_error_model_is_the_single_track_seen_from_a_straight_road(v: float) -> None:
    """e1' = v_y + v e2, so [y, beta, psi, rate] and [e1, e1', e2, e2'] are one linear map apart."""
    a, b = single_track(CAR, v)
    to = np.array([[1, 0, 0, 0], [0, v, v, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    model = em.error_model(CAR, v)
    assert to @ a @ np.linalg.inv(to) == pytest.approx(model.a, abs=1e-9)
    assert (to @ b)[:, 0] == pytest.approx(model.b)


@pytest.mark.parametrize("v", SPEEDS)
def test_steady_state_is_rajamanis(v: float) -> None:
    xi, angle = em.steady_state(em.error_model(CAR, v))
    small = 1e-6
    assert angle == pytest.approx(steady_wheel_angle(CAR, v, small) / small, rel=1e-9)
    assert xi == pytest.approx([0.0, 0.0, -steady_side_slip(CAR, v, 1.0), 0.0])
    discrete = em.discrete(em.error_model(CAR, v), DT)
    assert discrete.a @ xi + discrete.b * angle + discrete.g == pytest.approx(xi, abs=1e-9)


def test_errors_are_the_rates_of_the_errors() -> None:
    """e1' and e2' of an observation against differences along the motion."""
    path, h = Circle(radius=30.0), 1e-5
    car = beside(path, 9.0, d=0.4, heading=0.1, velocity=(8.0, 0.5), yaw_rate=0.4)
    c, s = math.cos(car.psi), math.sin(car.psi)
    moved = car._replace(
        x=car.x + h * (8.0 * c - 0.5 * s), y=car.y + h * (8.0 * s + 0.5 * c), psi=car.psi + h * 0.4
    )
    before, after = (em.errors(observe(path, state, 9.0)) for state in (car, moved))
    assert before[1] == pytest.approx((after[0] - before[0]) / h, abs=1e-4)
    assert before[3] == pytest.approx((after[2] - before[2]) / h, abs=1e-4)


@pytest.mark.parametrize("v", SPEEDS)
def test_closed_loop_is_stable_between_the_speeds_of_the_schedule(v: float) -> None:
    gains = Lqr().init(CAR, DT).gains
    for speed in (v, v + 0.23):
        model = em.discrete(em.error_model(CAR, speed), DT)
        loop = model.a - np.outer(model.b, gain_at(gains, speed))
        assert abs(np.linalg.eigvals(loop)).max() < 1.0


@pytest.mark.parametrize("v", [3.0, 8.0, 12.0])
def test_holds_the_circle(v: float) -> None:
    episode = drive(Lqr(), Circle(), speed=ConstantSpeed(speed=v), duration=20.0)
    assert episode.completed
    assert abs(episode["lateral_error"]).max() < 0.01


def test_comes_back_to_a_straight_as_its_model_does() -> None:
    """A small error on the plant decays as on the linear model with the same gains."""
    v = 10.0
    controller = Lqr(preview_time=0.0)
    state = controller.init(CAR, DT)
    observation = observe(Straight(), beside(Straight(), 5.0, d=0.01, velocity=(v, 0.0)), 5.0)
    gain = gain_at(state.gains, v)
    steer = controller.step(state, observation)[0].steer
    assert steer == pytest.approx(CAR.steer_for_wheel_angle(-gain[0] * 0.01, v))
