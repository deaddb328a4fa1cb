"""The PID and its feed-forward against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.controllers.pid import Pid, PidGains, PidState
from steersman.controllers.single_track import (
    preview_curvature,
    steady_side_slip,
    steady_wheel_angle,
)
from steersman.paths.analytic import Circle, Straight
from steersman.speed import ConstantSpeed
from steersman.types import Status

from ..loops import CAR, DT, beside, drive, observe

V = 10.0


def gains(**given: float) -> PidGains:
    zero = {"k_p": 0.0, "k_i": 0.0, "k_d": 0.0, "filter_time": 0.0}
    return PidGains(**{**zero, **given})


def outputs(pid: PidGains, errors: list[float]) -> list[float]:
    state, out = PidState(), []
    for error in errors:
        steer, state = pid.update(state, error, V, DT)
        out.append(steer)
    return out


def test_proportional_steers_against_the_error() -> None:
    assert outputs(gains(k_p=0.3), [0.5, -0.2]) == pytest.approx([-0.15, 0.06])


def test_integral_sums_up() -> None:
    assert outputs(gains(k_i=0.5), [0.2] * 10) == pytest.approx(
        [-0.5 * 0.2 * DT * (k + 1) for k in range(10)]
    )


def test_integral_is_bounded() -> None:
    out = outputs(gains(k_i=0.5, integral_limit=0.3), [1.0] * 20)
    assert out[-1] == pytest.approx(-0.15)


def test_derivative_of_a_ramp() -> None:
    out = outputs(gains(k_d=2.0), [0.1 * DT * k for k in range(5)])
    assert out == pytest.approx([0.0, *[-0.2] * 4])


def test_derivative_starts_without_a_kick() -> None:
    assert outputs(gains(k_d=2.0), [0.7, 0.7]) == [0.0, 0.0]


def test_derivative_filter_is_first_order() -> None:
    tau = 0.15
    out = outputs(gains(k_d=1.0, filter_time=tau), [0.1 * DT * k for k in range(30)])
    keep = tau / (tau + DT)
    assert out == pytest.approx([-0.1 * (1.0 - keep**k) for k in range(30)])


def test_anti_windup_holds_the_integral_while_saturated() -> None:
    pid, state = gains(k_p=2.0, k_i=0.5), PidState(0.1)
    _, after = pid.update(state, 1.0, V, DT)
    assert after.integral == 0.1
    # Saturated the other way round, the integral may unwind.
    _, after = gains(k_i=1.0, integral_limit=5.0).update(PidState(-2.0), 1.0, V, DT)
    assert after.integral == pytest.approx(-2.0 + DT)


def test_recovers_from_saturation_at_once() -> None:
    pid = gains(k_p=2.0, k_i=1.0)
    out = outputs(pid, [1.0] * 100 + [-0.1])
    assert out[-1] == pytest.approx(0.2 + 0.1 * DT)


@given(st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=30))
def test_is_odd_in_the_error(errors: list[float]) -> None:
    pid = PidGains(k_p=0.3, k_i=0.1, k_d=0.2)
    assert outputs(pid, [-e for e in errors]) == [-u for u in outputs(pid, errors)]


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30))
def test_integral_never_exceeds_its_bound(errors: list[float]) -> None:
    pid, state = PidGains(integral_limit=0.7), PidState()
    for error in errors:
        _, state = pid.update(state, error, V, DT)
        assert abs(state.integral) <= 0.7


def test_controller_is_its_gains_without_feedforward() -> None:
    controller = Pid(gains=gains(k_p=0.4), k_heading=0.5)
    observation = observe(Straight(), beside(Straight(), 3.0, d=0.2, heading=-0.1), 3.0)
    decision, _ = controller.step(controller.init(CAR, DT), observation)
    assert decision.steer == pytest.approx(-0.08 + 0.05)
    assert decision.status is Status.SOLVED


def test_saturation_is_marked() -> None:
    controller = Pid(gains=gains(k_p=4.0))
    observation = observe(Straight(), beside(Straight(), 3.0, d=0.3), 3.0)
    decision, _ = controller.step(controller.init(CAR, DT), observation)
    assert decision[:2] == (-1.0, Status.SATURATED)


@pytest.mark.parametrize("direction", ["left", "right"])
@pytest.mark.parametrize("distance", [0.0, 0.5, 2.0, 9.0, 100.0])
def test_curvature_ahead_on_a_circle(direction: str, distance: float) -> None:
    path = Circle(radius=40.0, direction=direction)
    observation = observe(path, beside(path, 5.0, d=0.3, heading=0.1), 5.0)
    expected = path.at(0.0).curvature
    assert preview_curvature(observation, distance) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("window", "share"), [(6.0, 0.003), (12.0, 0.01), (28.0, 0.04)])
def test_fitted_curvature_of_a_circle(window: float, share: float) -> None:
    path = Circle(radius=50.0)
    observation = observe(path, beside(path, 5.0, d=0.3, heading=0.1), 5.0)
    assert preview_curvature(observation, 6.0, window) == pytest.approx(0.02, rel=share)


def test_a_longer_window_hears_less_noise() -> None:
    path, rng = Straight(), np.random.default_rng(0)
    clean = observe(path, beside(path, 5.0), 5.0)
    spread = []
    for window in (4.0, 12.0, 28.0):
        shifted = [
            clean._replace(preview=clean.preview + rng.uniform(-0.1, 0.1, clean.preview.shape))
            for _ in range(100)
        ]
        spread.append(np.std([preview_curvature(o, 6.0, window) for o in shifted]))
    assert spread[0] > 8.0 * spread[1] > 40.0 * spread[2]


def test_feedforward_of_a_neutral_car_is_geometry() -> None:
    neutral = CAR.replace(l_f=1.5, l_r=1.5, c_f=80_000.0, c_r=80_000.0)
    assert steady_wheel_angle(neutral, 20.0, 0.02) == pytest.approx(math.atan(3.0 * 0.02))
    assert steady_side_slip(neutral, 0.0, 0.02) == pytest.approx(1.5 * 0.02)


@pytest.mark.parametrize("speed", [3.0, 8.0, 12.0])
def test_feedforward_holds_the_circle_from_the_steady_turn(speed: float) -> None:
    """What feedback has to add is what tyres and lock-to-lock steering differ from linear."""
    controller = Pid(feedforward=True, gains=PidGains(k_p=0.1, k_i=0.05, k_d=0.05))
    episode = drive(controller, Circle(), speed=ConstantSpeed(speed=speed), duration=30.0)
    assert episode.completed
    assert abs(episode["lateral_error"]).max() < 0.1
    assert abs(episode["lateral_error"][-100:]).max() < 0.01


def test_without_feedforward_the_integral_does_it() -> None:
    controller = Pid(gains=PidGains(k_p=0.1, k_i=0.05, k_d=0.05, integral_limit=10.0))
    episode = drive(controller, Circle(), speed=ConstantSpeed(speed=5.0), duration=60.0)
    assert episode.completed
    assert abs(episode["lateral_error"][-200:]).max() < 0.05
