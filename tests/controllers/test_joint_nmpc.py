"""The MPC of steering and speed: its derivatives, its limits, bends beyond grip."""

from __future__ import annotations

import numpy as np
import pytest

from steersman.config import build
from steersman.controllers.joint_nmpc import JointNmpc
from steersman.controllers.joint_plan import JointNlp, improved, linearised
from steersman.controllers.nmpc_plan import Limits
from steersman.kernels import joint_speeds
from steersman.kernels.vehicle import GRAVITY
from steersman.rollout import RunConfig, attempt

from .test_grip_speed import on_a_bend
from .test_nmpc import N, problem

FRICTION = 0.9


def joint(start: float = 14.0, cap: float = 30.0, friction: float = FRICTION) -> JointNlp:
    """A car that slides a little on a bending road, and a plan that may brake and speed up."""
    return JointNlp(
        nlp=problem(v=start),
        friction=friction,
        start=start,
        wished=np.full(N, start + 2.0),
        prices=np.array([0.01, 0.002]),
        low=np.full(2 * N, -3.0),
        high=np.full(2 * N, 2.0),
        caps=np.full(N, cap),
    )


def pairs(p: JointNlp, spread: float) -> np.ndarray:
    rng = np.random.default_rng(0)
    plan = np.empty(2 * N)
    plan[::2] = p.nlp.steady + 0.01 * spread * rng.normal(size=N)
    plan[1::2] = spread * rng.uniform(-1.5, 1.5, N)
    return plan


def test_the_gradient_is_the_one_of_finite_differences() -> None:
    """By both inputs: wheel angles, and accelerations, which change speed and grip."""
    p, h = joint(friction=1.5), 1e-4
    plan = pairs(p, 1.0)
    step = linearised(p, plan)
    assert step.plan == pytest.approx(plan)
    moved = [h * row for row in np.eye(2 * N)]
    costs = [(linearised(p, plan + e).cost, linearised(p, plan - e).cost) for e in moved]
    numeric = np.array([(up - down) / (2.0 * h) for up, down in costs])
    assert step.linear[::2] == pytest.approx(numeric[::2], rel=1e-3, abs=1e-5)
    assert step.linear[1::2] == pytest.approx(numeric[1::2], rel=1e-3, abs=1e-5)
    assert np.linalg.eigvalsh(step.hessian).min() > 0.0


def test_a_plan_keeps_all_its_limits() -> None:
    """Also where the speed at the start is above the caps, as far as braking goes."""
    for cap in (30.0, 14.2, 13.5):
        p = joint(cap=cap)
        held = np.maximum(p.caps, p.start - 3.0 * p.nlp.dt * np.arange(1, N + 1))
        p = p._replace(caps=held)
        plan = improved(p, Limits(0.0, 0.03), pairs(p, 0.5))
        assert plan is not None
        speeds = np.empty(N + 1)
        joint_speeds.speeds_of(plan, p.start, p.nlp.dt, speeds)
        assert (speeds[1:] <= held + 1e-5).all()
        assert (plan[1::2] >= -3.0 - 1e-6).all()
        assert (plan[1::2] <= 2.0 + 1e-6).all()
        assert np.abs(np.diff(plan[::2], prepend=0.0)).max() <= 0.03 + 1e-6
        faster = speeds[-1] > p.start
        assert faster == (cap > p.start)


def test_it_brakes_for_a_bend_in_view_and_no_earlier_than_it_has_to() -> None:
    """Bends of 0.05 1/m begin 40 m ahead."""
    road, low, high = np.zeros(N + 1), np.empty(2 * N), np.empty(2 * N)
    caps, view = np.empty(N), np.where(np.arange(40) * 2.0 >= 40.0, 0.05, 0.0)
    speeds, grip = np.full(N + 1, 14.0), 0.5 * GRAVITY
    joint_speeds.bound_speeds(
        road, view, 2.0, 0.0, speeds, 0.05, grip, 0.6, 0.5, (1.0, 0.8), low, high, caps
    )
    way = 14.0 * 0.05 * N
    assert caps[-1] == pytest.approx(np.sqrt(0.6 * grip / 0.05 + grip * (40.0 - way)), rel=1e-6)
    assert caps[:-1].min() > 100.0
    assert (low[1::2], high[1::2]) == (pytest.approx(-0.8 * 0.85 * grip), pytest.approx(0.5 * grip))


def test_wished_speeds_are_those_in_view_where_the_plan_will_be() -> None:
    """Beside the first and beyond the last one, too, and on one."""
    rng = np.random.default_rng(0)
    view, dt, found = rng.uniform(5.0, 20.0, 9), 0.05, np.empty(N)
    for start in (-3.0, 0.0, 6.1, 15.7, 99.0):
        for speeds in (rng.uniform(0.0, 40.0, N + 1), np.full(N + 1, 40.0)):
            joint_speeds.wished_speeds(view, 2.0, start, speeds, dt, 0.2, found)
            places = start + np.cumsum(speeds[:-1]) * dt
            assert found == pytest.approx(np.interp(places, 2.0 * np.arange(9), view) + 0.2, 1e-14)


@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_a_friction_that_nothing_tells_is_found(friction: float) -> None:
    episode = on_a_bend(JointNmpc(found=True), friction, 25.0)
    assert episode.completed
    used = episode["v_x"] ** 2 / 30.0 / (friction * GRAVITY)
    assert 0.4 < used[-1] < 1.0
    assert np.abs(episode["lateral_error"]).max() < 0.5


def test_with_a_known_friction_it_is_what_the_bend_allows() -> None:
    controller = JointNmpc(friction=0.5)
    episode = on_a_bend(controller, 3.0, 12.0)
    allowed = np.sqrt(controller.used * 0.5 * GRAVITY * 30.0)
    assert episode["v_x"][-1] == pytest.approx(allowed, abs=0.3)
    assert np.abs(episode["lateral_error"]).max() < 0.02


@pytest.mark.parametrize("speed", [{"kind": "constant_speed", "speed": 12.0}, "constant_throttle"])
def test_where_grip_suffices_it_drives_as_wished(speed: object) -> None:
    words = {"path": {"kind": "circle", "radius": 80.0}, "speed": speed, "duration": 12.0}
    found = [
        attempt(build(RunConfig, words | {"controller": kind})).episode
        for kind in ("joint_nmpc", "tuned/nmpc")
    ]
    assert found[0]["v_x"] == pytest.approx(found[1]["v_x"], abs=0.1)
    assert np.abs(found[0]["lateral_error"]).max() < 0.01
