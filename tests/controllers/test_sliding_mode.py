"""Sliding mode: the surface obeys the reaching law, errors on it decay as stated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.controllers.single_track import error_model, steady_state
from steersman.controllers.sliding_mode import SlidingMode
from steersman.kernels.vehicle import wheel_tangents
from steersman.paths.analytic import Circle
from steersman.speed import ConstantSpeed
from steersman.types import FloatArray, Observation, Status

from ..loops import CAR, drive

V = 10.0


def slide(
    controller: SlidingMode, xi: FloatArray, kappa: float, duration: float, v: float = V
) -> tuple[FloatArray, FloatArray]:
    """Surface and lateral error of the point ahead along the linear model, finely stepped."""
    dt, model = 1e-3, error_model(CAR, v)
    xi_steady, _ = steady_state(model)
    state, out = controller.init(CAR, dt), []
    points = np.zeros((15, 2))
    for _ in range(round(duration / dt)):
        e1, e1_rate, e2, e2_rate = xi
        side = (e1_rate - v * math.sin(e2)) / math.cos(e2)
        rate = e2_rate + kappa * (v * math.cos(e2) - side * math.sin(e2)) / (1.0 - kappa * e1)
        observation = Observation(0.0, e1, e2, v, side, rate, 0.0, kappa, points, 2.0)
        decision, state = controller.step(state, observation)
        assert decision.status is Status.SOLVED
        ahead = controller.look_ahead
        y = e1 + ahead * (e2 - xi_steady[2] * kappa)
        c = controller.slope
        y_rate = e1_rate + ahead * e2_rate
        out.append((y_rate + 2.0 * c * y + c * c * state.integral, y))
        angle = math.atan(wheel_tangents(CAR.table, 0, decision.steer, v)[2])
        xi = xi + dt * (model.a @ xi + model.b * angle + model.g * kappa)
    s, y = np.array(out).T
    return s, y


START = np.array([0.2, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("look_ahead", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("kappa", [0.0, 0.01])
def test_inside_the_layer_the_surface_decays_exponentially(look_ahead: float, kappa: float) -> None:
    """s' = -(q + k / layer) s."""
    controller = SlidingMode(
        look_ahead=look_ahead, layer=2.0, reaching=1.0, proportional=1.5, preview_time=0.0
    )
    s, _ = slide(controller, START, kappa, 1.0)
    for i in (200, 500, 999):
        assert s[i] == pytest.approx(s[0] * math.exp(-2.0 * i * 1e-3), rel=0.02, abs=2e-4)


def test_outside_the_layer_it_is_reached_in_the_stated_time() -> None:
    """s' = -k alone takes (s_0 - layer) / k to the layer."""
    controller = SlidingMode(layer=0.05, reaching=0.4, proportional=0.0, preview_time=0.0)
    s, _ = slide(controller, START, 0.0, 1.2)
    reached = int(np.argmax(abs(s) < 0.05))
    assert reached * 1e-3 == pytest.approx((abs(s[0]) - 0.05) / 0.4, rel=0.03)


def test_errors_on_the_surface_decay_twice_at_the_slope() -> None:
    """With s = 0 and the integral z: z'' + 2 c z' + c^2 z = 0."""
    controller = SlidingMode(slope=2.0, proportional=40.0, reaching=0.0, preview_time=0.0)
    _, y = slide(controller, START, 0.0, 6.0)
    assert abs(y[-1]) < 1e-3 * abs(y[0])
    c = 2.0
    # From s = 0 at the time t0: y = (A + B t) exp(-c t), whose logarithmic slope tends to -c.
    late = math.log(abs(y[2500] / y[3500]))
    assert 0.7 * c < late < c


@pytest.mark.parametrize("v", [3.0, 8.0, 12.0])
def test_no_steady_error_on_the_circle(v: float) -> None:
    """Only the integral does that: a boundary layer alone leaves what the model gets wrong."""
    episode = drive(SlidingMode(), Circle(), speed=ConstantSpeed(speed=v), duration=40.0)
    assert episode.completed
    assert abs(episode["lateral_error"][-100:]).max() < 0.002


def test_integral_is_bounded_and_waits_while_saturated() -> None:
    points = np.stack([2.0 * np.arange(15), np.zeros(15)], axis=1)
    far = Observation(0.0, 15.0, 1.0, V, 0.0, 0.0, 0.0, 0.0, points, 2.0)
    controller = SlidingMode(integral_limit=0.01)
    state = controller.init(CAR, 0.05)
    decision, after = controller.step(state, far)
    assert decision[:2] == (-1.0, Status.SATURATED)
    assert after.integral == 0.0
    for _ in range(5):
        _, state = controller.step(state, far._replace(lateral_error=0.1))
    assert state.integral == 0.01
