"""Pure pursuit against the geometry of circles."""

from __future__ import annotations

import math

import pytest

from steersman.controllers.pure_pursuit import PurePursuit, pursuit_curvature
from steersman.paths.analytic import Circle, Straight
from steersman.speed import ConstantSpeed

from ..loops import CAR, DT, beside, drive, observe
from .kinematic import drive_kinematic

R = 50.0


@pytest.mark.parametrize("direction", ["left", "right"])
@pytest.mark.parametrize("look_ahead", [2.0, 5.0, 15.0])
def test_a_rear_axle_on_the_circle_stays_there(direction: str, look_ahead: float) -> None:
    """Coulter: the arc through the goal point, tangent to the car, is then the road itself."""
    path = Circle(radius=R, direction=direction)
    side = path.at(0.0).curvature * R
    # The centre of mass is on the concentric circle through it, turned by atan(l_r / R).
    d, heading = -side * (math.hypot(R, CAR.l_r) - R), -side * math.atan(CAR.l_r / R)
    observation = observe(path, beside(path, 5.0, d=d, heading=heading), 5.0)
    kappa = pursuit_curvature(observation, -CAR.l_r, 0.0, look_ahead)
    assert kappa == pytest.approx(side / R, rel=1e-4)


def test_aims_at_the_last_waypoint_when_the_preview_ends() -> None:
    observation = observe(Straight(), beside(Straight(), 5.0, d=1.0), 5.0)
    ahead = 28.0 + CAR.l_r
    expected = -2.0 / (ahead**2 + 1.0)
    assert pursuit_curvature(observation, -CAR.l_r, 0.0, 500.0) == pytest.approx(expected)


def test_look_ahead_grows_with_speed() -> None:
    """On a straight, d metres beside it: wheel angle atan(-2 L d / l_d^2)."""
    controller = PurePursuit(look_ahead_time=0.5, look_ahead_offset=2.0)
    for v in (0.0, 4.0, 12.0):
        state = beside(Straight(), 5.0, d=0.3, velocity=(v, 0.0))
        steer = controller.step(controller.init(CAR, DT), observe(Straight(), state, 5.0))[0].steer
        angle = math.atan(-2.0 * CAR.wheelbase * 0.3 / (2.0 + 0.5 * v) ** 2)
        assert steer == pytest.approx(CAR.steer_for_wheel_angle(angle, v), rel=1e-6)


@pytest.mark.parametrize("direction", ["left", "right"])
def test_kinematic_car_settles_on_the_circle_without_error(direction: str) -> None:
    path = Circle(radius=R, direction=direction)
    run = drive_kinematic(PurePursuit(), path, 3.0, d=0.5, duration=40.0)
    assert run.rear[0] == pytest.approx(0.5)
    assert abs(run.rear[-100:]).max() < 1e-4
    outside = math.hypot(R, CAR.l_r) - R
    assert abs(run.centre[-1]) == pytest.approx(outside, abs=1e-4)


def test_the_centre_of_mass_can_follow_instead() -> None:
    run = drive_kinematic(PurePursuit(track="centre_of_mass"), Circle(), 3.0, d=0.5, duration=40.0)
    assert abs(run.centre[-100:]).max() < 1e-4
    episode = drive(
        PurePursuit(track="centre_of_mass"), Circle(), speed=ConstantSpeed(speed=8.0), duration=20.0
    )
    assert abs(episode["lateral_error"]).max() < 0.005


def test_small_errors_on_a_straight_decay_as_the_linearised_loop() -> None:
    """y' = v psi, psi' = -2 v (y + l psi) / l^2: critically shaped, poles (-1 +- i) v / l."""
    v, look_ahead = 4.0, 5.0
    controller = PurePursuit(look_ahead_time=0.0, look_ahead_offset=look_ahead)
    run = drive_kinematic(controller, Straight(), v, d=0.01, duration=4.0)
    for i in (50, 100, 200, 399):
        t = i * 0.01 * v / look_ahead
        assert run.rear[i] == pytest.approx(
            0.01 * math.exp(-t) * (math.cos(t) + math.sin(t)), abs=1e-4
        )


def test_follows_the_road_in_the_simulator() -> None:
    episode = drive(PurePursuit(), Circle(), speed=ConstantSpeed(speed=3.0), duration=30.0)
    assert episode.completed
    outside = -(CAR.l_r**2) / (2.0 * R)
    assert episode["lateral_error"][-1] == pytest.approx(outside, abs=0.01)
