"""The linear MPC: model, prediction, optimisation, and what happens when the solver fails."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_triangular
from scipy.optimize import nnls
from scipy.signal import cont2discrete

from steersman.controllers.condensed_qp import MpcProblem, build_problem, predict
from steersman.controllers.model_error import ModelError
from steersman.controllers.mpc_pid import MpcPid
from steersman.controllers.pid import PidGains, PidState
from steersman.controllers.single_track import single_track, zero_order_hold
from steersman.paths.analytic import Circle, Straight
from steersman.types import FloatArray, Observation, Status

from ..loops import CAR, DT, beside, drive, observe

N = 20
LIMITS: dict[str, dict[str, Any]] = {
    "angle": {},
    "rate": {"rate_limit": True},
    "corridor": {"corridor": 0.1},
    "rate and corridor": {"rate_limit": True, "corridor": 0.1},
}


def problem(r: float = 0.05, **limits: Any) -> MpcProblem:
    return build_problem(CAR, DT, v0=30 / 3.6, horizon=N, q=1.0, p=2.0, r=r, **limits)


def scene(d: float, kappa: float = 0.0, v: float = 8.0, slip: float = 0.0) -> Observation:
    s = 2.0 * np.arange(15)
    points = np.stack([s, 0.5 * kappa * s * s - d], axis=1)
    return Observation(0.0, d, 0.0, v, slip * v, v * kappa, 0.0, kappa, points, 2.0)


def scenes(count: int = 20, largest: float = 3.0) -> list[Observation]:
    rng = np.random.default_rng(0)
    span = np.array([largest, 0.1, 0.0, 0.05])
    draws = rng.uniform(-1.0, 1.0, (count, 4)) * span
    return [scene(d, kappa, rng.uniform(3.0, 15.0), slip) for d, kappa, _, slip in draws]


@pytest.mark.parametrize("v", [0.3, 8.0, 90.0])
def test_zero_order_hold_is_scipys(v: float) -> None:
    a, b = single_track(CAR, v)
    expected = cont2discrete((a, b, np.eye(4), np.zeros((4, 1))), DT)[:2]
    for ours, theirs in zip(zero_order_hold(a, b, DT), expected, strict=True):
        assert ours == pytest.approx(theirs, abs=1e-13)


def test_zero_order_hold_of_a_double_integrator() -> None:
    a, b = zero_order_hold(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), 0.2)
    assert a == pytest.approx(np.array([[1.0, 0.2], [0.0, 1.0]]))
    assert b == pytest.approx(np.array([[0.02], [0.2]]))


@pytest.mark.parametrize("v", [3.0, 8.0, 25.0])
def test_the_model_turns_as_the_steady_turn_does(v: float) -> None:
    """Rajamani eq. 3.15: the wheel angle of a curvature, from the stationary solution."""
    a, b = single_track(CAR, v)
    sub = np.ix_([1, 3], [1, 3])
    slip, rate = np.linalg.solve(a[sub], -b[[1, 3], 0])
    load_f, load_r = CAR.mass * CAR.l_r / CAR.wheelbase, CAR.mass * CAR.l_f / CAR.wheelbase
    understeer = load_f / CAR.c_f - load_r / CAR.c_r
    assert rate == pytest.approx(v / (CAR.wheelbase + understeer * v * v))
    kappa = rate / v
    assert slip == pytest.approx(CAR.l_r * kappa - load_r / CAR.c_r * v * v * kappa)


def test_condensed_prediction_is_the_simulation() -> None:
    rng = np.random.default_rng(4)
    a, b = zero_order_hold(*single_track(CAR, 8.0), DT)
    free, forced = predict(a, b, N)
    start, steering = rng.normal(size=4), rng.normal(size=N)
    state, lateral = start, []
    for u in steering:
        state = a @ state + b[:, 0] * u
        lateral.append(state[0])
    assert free @ start + forced @ steering == pytest.approx(np.array(lateral), abs=1e-12)


def cost(qp: MpcProblem, plan: FloatArray, r: float, observation: Observation) -> float:
    weights = np.full(N, 1.0)
    weights[-1] += 2.0
    error = qp.forced @ plan + qp.terms(observation)[1]
    return float(0.5 * (weights * error**2).sum() + 0.5 * r * (plan**2).sum())


def test_without_active_limits_the_plan_is_the_unconstrained_one() -> None:
    qp = problem()
    for observation in scenes(largest=0.1):
        turning = observation._replace(yaw_rate=0.1)
        plan = qp.solve(turning, 0.0)
        assert plan is not None
        assert abs(plan).max() < CAR.max_wheel_angle
        linear, _ = qp.terms(turning)
        assert plan == pytest.approx(-np.linalg.solve(qp.hessian, linear), abs=1e-8)


def test_the_plan_minimises_the_cost_as_documented() -> None:
    qp, rng = problem(), np.random.default_rng(5)
    plan = qp.solve(scene(0.2, 0.01), 0.0)
    assert plan is not None
    best = cost(qp, plan, 0.05, scene(0.2, 0.01))
    for _ in range(50):
        assert cost(qp, plan + rng.normal(0.0, 0.01, N), 0.05, scene(0.2, 0.01)) > best


def least_distance(h: FloatArray, f: FloatArray, g: FloatArray, bound: FloatArray) -> FloatArray:
    """min x'hx/2 + f'x with g x <= bound, as Lawson and Hanson's least-distance problem."""
    lower = np.linalg.cholesky(h)
    shift = solve_triangular(lower, f, lower=True)
    g = solve_triangular(lower, g.T, lower=True).T
    design = -np.vstack([g.T, bound + g @ shift])
    unit = np.zeros(len(design))
    unit[-1] = 1.0
    rest = design @ nnls(design, unit, maxiter=10_000)[0] - unit
    answer: FloatArray = solve_triangular(lower.T, -rest[:-1] / rest[-1] - shift, lower=False)
    return answer


def reference(qp: MpcProblem, observation: Observation, last_angle: float) -> FloatArray:
    """The QP as the documentation states it, solved by other means."""
    linear, ref = qp.terms(observation)
    eye, bounds = np.eye(N), [np.full(2 * N, qp.max_angle)]
    rows = [eye, -eye]
    if qp.max_step is not None:
        change, first = eye - np.eye(N, k=-1), np.zeros(N)
        first[0] = last_angle
        rows += [change, -change]
        bounds += [qp.max_step + first, qp.max_step - first]
    hard, limit = np.vstack(rows), np.concatenate(bounds)
    if qp.corridor is None:
        return least_distance(qp.hessian, linear, hard, limit)
    # One slack for each soft row. DAQP scales rows by their size in the metric of the Hessian.
    size = np.linalg.norm(
        solve_triangular(np.linalg.cholesky(qp.hessian), qp.forced.T, lower=True), axis=0
    )
    zero = np.zeros((N, N))
    h = np.block([[qp.hessian, zero], [zero, np.diag(1e6 / size**2)]])
    soft = np.block([[qp.forced, -eye], [-qp.forced, -eye]])
    g = np.vstack([np.hstack([hard, np.zeros_like(hard)]), soft])
    limit = np.concatenate([limit, qp.corridor - ref, qp.corridor + ref])
    return least_distance(h, np.concatenate([linear, np.zeros(N)]), g, limit)[:N]


@pytest.mark.parametrize("name", LIMITS)
def test_with_active_limits_the_plan_is_the_reference_solvers(name: str) -> None:
    qp, active = problem(**LIMITS[name]), 0
    tolerance = 1e-6 if qp.corridor is None else 1e-5  # DAQP's own on soft rows is 1e-6
    for i, observation in enumerate(scenes()):
        last = 0.02 * (i - 10)
        plan = qp.solve(observation, last)
        assert plan is not None
        assert plan == pytest.approx(reference(qp, observation, last), abs=tolerance)
        free = -np.linalg.solve(qp.hessian, qp.terms(observation)[0])
        active += bool(abs(free - plan).max() > 1e-3)
    assert active >= 10


@pytest.mark.parametrize("name", ["angle", "rate"])
def test_karush_kuhn_tucker(name: str) -> None:
    """Stationary, feasible, with multipliers of the right sign on active limits alone."""
    qp = problem(**LIMITS[name])
    for observation in scenes():
        plan = qp.solve(observation, 0.1)
        assert plan is not None
        rows = [np.eye(N)]
        limits = [np.full(N, qp.max_angle)]
        centre = [np.zeros(N)]
        if qp.max_step is not None:
            rows.append(np.eye(N) - np.eye(N, k=-1))
            limits.append(np.full(N, qp.max_step))
            centre.append(np.eye(N)[0] * 0.1)
        g, limit, mid = np.vstack(rows), np.concatenate(limits), np.concatenate(centre)
        room = limit - abs(g @ plan - mid)
        assert room.min() > -1e-6
        active = room < 1e-7
        signed = g[active] * np.sign(g[active] @ plan - mid[active])[:, None]
        gradient = qp.hessian @ plan + qp.terms(observation)[0]
        multipliers, rest = nnls(signed.T, -gradient) if active.any() else ((), 0.0)
        if not active.any():
            rest = float(np.linalg.norm(gradient))
        assert rest < 1e-6 * max(1.0, np.linalg.norm(qp.terms(observation)[0])), multipliers


@pytest.mark.parametrize("name", LIMITS)
def test_a_plan_depends_on_its_observation_alone(name: str) -> None:
    used = problem(**LIMITS[name])
    for observation in scenes():
        used.solve(observation, 0.0)
    for observation in scenes(8):
        fresh = problem(**LIMITS[name]).solve(observation, 0.05)
        used.solve(scene(2.5, -0.1), 0.0)
        assert np.array_equal(used.solve(observation, 0.05), fresh)


def test_a_plan_is_the_callers_to_keep() -> None:
    qp = problem()
    plan = qp.solve(scene(0.5), 0.0)
    assert plan is not None
    kept = plan.copy()
    qp.solve(scene(-0.5), 0.0)
    assert np.array_equal(plan, kept)


def test_rate_limit_counts_from_the_last_angle() -> None:
    qp = problem(rate_limit=True)
    assert qp.max_step is not None
    plan = qp.solve(scene(-3.0), 0.3)
    assert plan is not None
    assert plan[0] == pytest.approx(0.3 + qp.max_step)
    assert abs(np.diff(plan)).max() <= qp.max_step + 1e-9


def test_corridor_is_kept_where_steering_can() -> None:
    tight, loose = problem(r=5.0, corridor=0.05), problem(r=5.0)
    observation = scene(0.0, 0.02, v=8.0)
    plans = [qp.solve(observation, 0.0) for qp in (tight, loose)]
    _, ref = tight.terms(observation)
    worst = [abs(ref + tight.forced @ p).max() for p in plans if p is not None]
    assert worst[0] < 0.051 < worst[1]


def failing(monkeypatch: pytest.MonkeyPatch) -> dict[str, bool]:
    """Makes the solver fail while ``switch["fails"]`` is set."""
    switch, genuine = {"fails": False}, MpcProblem.solve

    def solve(self: MpcProblem, o: Observation, angle: float) -> FloatArray | None:
        return None if switch["fails"] else genuine(self, o, angle)

    monkeypatch.setattr(MpcProblem, "solve", solve)
    return switch


def test_a_solver_that_fails_leaves_the_old_plan_then_the_pid(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    controller, switch = MpcPid(horizon=5, r=20.0, c_mpc=1.0, c_pid=1.0), failing(monkeypatch)
    state = controller.init(CAR, DT)
    observation = observe(Straight(), beside(Straight(), 5.0, d=0.4, heading=0.1), 5.0)
    decision, state = controller.step(state, observation)
    assert decision.status is Status.SOLVED
    plan = state.plan.copy()
    switch["fails"] = True
    pid = state.pid
    for age in range(1, 8):
        feedback, pid = controller.gains.update(pid, observation.lateral_error, observation.v_x, DT)
        decision, state = controller.step(state, observation)
        planned = plan[age] if age < 5 else 0.0
        expected = CAR.steer_for_wheel_angle(planned, observation.v_x) + feedback
        assert decision.status is Status.FALLBACK
        assert decision.steer == pytest.approx(min(max(expected, -1.0), 1.0), abs=1e-12)
    switch["fails"] = False
    decision, state = controller.step(state, observation)
    assert decision.status is Status.SOLVED
    assert np.array_equal(state.plan, plan)


def test_failing_from_the_start_drives_by_pid(monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch)["fails"] = True
    observation = observe(Straight(), beside(Straight(), 5.0, d=0.1), 5.0)
    controller = MpcPid(c_pid=1.0)
    decision, _ = controller.step(controller.init(CAR, DT), observation)
    assert decision.steer == pytest.approx(controller.gains.update(PidState(), 0.1, 10.0, DT)[0])
    assert decision.status is Status.FALLBACK


def test_unsolved_number_is_never_used() -> None:
    """DAQP's iteration limit, infeasibility and friends have other exit flags than solved."""
    qp = problem(corridor=0.5)
    assert qp.soft is not None
    for flag, value in ((-6, 0.1), (-4, 0.1), (-1, 0.1), (0, 0.1), (1, math.nan)):
        qp.soft.model = Stub(flag, value)
        assert qp.solve(scene(0.1), 0.0) is None


class Stub:
    """A solver that answers with the same flag and number every time."""

    def __init__(self, flag: int, value: float) -> None:
        self.flag, self.value = flag, value

    def update(self, **_: Any) -> None:
        return None

    def solve(self) -> tuple[FloatArray, float, int, dict[str, Any]]:
        return np.full(N, self.value), 0.0, self.flag, {}


def test_failures_show_in_the_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    switch = failing(monkeypatch)
    switch["fails"] = True
    episode = drive(MpcPid(), Straight(), duration=1.0)
    assert (episode["status"] == Status.FALLBACK).all()


def test_a_straight_line_needs_no_steering() -> None:
    episode = drive(MpcPid(), Straight(), duration=10.0)
    assert abs(episode["steer_command"]).max() == 0.0
    assert abs(episode["lateral_error"]).max() == 0.0


def test_holds_the_circle_at_its_speed() -> None:
    episode = drive(MpcPid(), Circle(), duration=20.0)
    assert episode.completed
    assert abs(episode["lateral_error"][-100:]).max() < 0.1


def test_output_is_the_weighted_sum() -> None:
    observation = observe(Circle(), beside(Circle(), 5.0, d=0.05, heading=0.01), 5.0)

    def steer(c_mpc: float, c_pid: float) -> float:
        controller = MpcPid(c_mpc=c_mpc, c_pid=c_pid, gains=PidGains(k_p=0.2))
        return controller.step(controller.init(CAR, DT), observation)[0].steer

    assert steer(0.5, 2.0) == pytest.approx(0.5 * steer(1.0, 0.0) + 2.0 * steer(0.0, 1.0))


def test_model_error_changes_the_nominal_vehicle_only() -> None:
    wrong = ModelError(mass=1.2, c_f=0.8).nominal(CAR)
    assert wrong.mass == pytest.approx(1.2 * CAR.mass)
    assert wrong.c_f == pytest.approx(0.8 * CAR.c_f)
    assert ModelError().nominal(CAR) == CAR
    right, off = problem(), build_problem(wrong, DT, v0=30 / 3.6, horizon=N, q=1.0, p=2.0, r=0.05)
    assert not np.array_equal(right.hessian, off.hessian)
