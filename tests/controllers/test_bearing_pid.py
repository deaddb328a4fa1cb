"""PID on the bearing against CARLA's arithmetic, written out for one run of bearings."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from steersman.controllers.bearing_pid import BearingPid
from steersman.paths.analytic import Circle, Straight
from steersman.speed import ConstantSpeed
from steersman.types import Observation, Status

from ..loops import CAR, DT, beside, drive, observe


def seen(bearing: float) -> Observation:
    """A straight road that leads away from 0.45 m behind the centre of mass."""
    u = -0.45 + 2.0 * np.arange(15)
    c, s = math.cos(bearing), math.sin(bearing)
    points = np.stack([-0.45 + c * (u + 0.45), s * (u + 0.45)], axis=1)
    return Observation(0.0, 0.0, -bearing, 8.0, 0.0, 0.0, 0.0, 0.0, points, 2.0)


def carla(bearings: list[float]) -> list[float]:
    """Gains 1.95 / 0.05 / 0.2, ten errors, 0.1 a call, at most 0.8; our signs."""
    errors: deque[float] = deque(maxlen=10)
    last, out = 0.0, []
    for bearing in bearings:
        errors.append(bearing)
        value = 1.95 * bearing
        if len(errors) >= 2:
            value += 0.2 * (errors[-1] - errors[-2]) / 0.05 + 0.05 * sum(errors) * 0.05
        value = float(np.clip(value, -1.0, 1.0))
        last = float(np.clip(np.clip(value, last - 0.1, last + 0.1), -0.8, 0.8))
        out.append(last)
    return out


def test_is_carlas_arithmetic() -> None:
    rng = np.random.default_rng(0)
    bearings = [*rng.normal(0.0, 0.02, 30), *[0.5] * 15, *rng.normal(-0.1, 0.05, 30)]
    controller = BearingPid()
    state, out = controller.init(CAR, 0.05), []
    for bearing in bearings:
        decision, state = controller.step(state, seen(bearing))
        out.append(decision.steer)
    assert out == pytest.approx(carla(bearings), abs=1e-6)
    assert max(out) == 0.8


def test_what_is_cut_is_marked() -> None:
    controller = BearingPid()
    decision, _ = controller.step(controller.init(CAR, DT), seen(0.2))
    assert decision[:2] == (0.1, Status.SATURATED)
    decision, _ = controller.step(controller.init(CAR, DT), seen(0.01))
    assert decision.status is Status.SOLVED


def test_bearing_is_taken_from_carlas_origin() -> None:
    """On a straight, d beside it: sin of the bearing is -d over the distance."""
    controller = BearingPid(k_p=1.0, k_i=0.0, k_d=0.0, max_change=2.0)
    observation = observe(Straight(), beside(Straight(), 5.0, d=0.5, velocity=(4.0, 0.0)), 5.0)
    steer = controller.step(controller.init(CAR, DT), observation)[0].steer
    assert steer == pytest.approx(-math.asin(0.5 / 5.0), abs=1e-6)


def test_carlas_gains_hold_the_circle_at_a_towns_speed() -> None:
    """And cut it: the sum over half a second is no integral."""
    episode = drive(BearingPid(), Circle(), speed=ConstantSpeed(speed=8.0), duration=20.0)
    assert episode.completed
    assert 0.05 < abs(episode["lateral_error"][-1]) < 0.5
