"""Stanley against its paper's equations and what they predict."""

from __future__ import annotations

import math

import pytest

from steersman.controllers.stanley import Stanley, moved_errors
from steersman.paths.analytic import Circle, Straight
from steersman.speed import ConstantSpeed

from ..loops import CAR, DT, Posed, beside, drive, observe
from .kinematic import STIFF, drive_kinematic

R = 50.0


def steer(controller: Stanley, path: Circle | Straight, **car: float) -> float:
    v = car.pop("v")
    observation = observe(path, beside(path, 5.0, velocity=(v, 0.0), **car), 5.0)
    return controller.step(controller.init(CAR, DT), observation)[0].steer


@pytest.mark.parametrize("v", [0.0, 2.0, 15.0])
def test_is_the_published_law_on_a_straight(v: float) -> None:
    """Hoffmann et al. write psi and e from the car to the path, so all signs turn round."""
    controller = Stanley(gain=2.5, softening=0.8, yaw_damping=0.1, steer_damping=0.0)
    psi, e, r = -0.05, -(0.2 + CAR.l_f * math.sin(0.05)), 0.03
    expected = psi + math.atan(2.5 * e / (0.8 + v)) + 0.1 * (0.0 - r)
    found = steer(controller, Straight(), d=0.2, heading=0.05, yaw_rate=r, v=v)
    assert found == pytest.approx(CAR.steer_for_wheel_angle(expected, v))


def test_steady_yaw_is_the_published_gain() -> None:
    """psi_ss = k_ag v r_traj, k_ag = m / (C_y (1 + a / b)), with C_y of the front axle."""
    v, kappa = 10.0, 1.0 / R
    k_ag = CAR.mass / (CAR.c_f * (1.0 + CAR.l_f / CAR.l_r))
    angles = []
    for steady in (True, False):
        controller = Stanley(steady_yaw=steady, yaw_damping=0.0)
        found = steer(controller, Circle(), yaw_rate=v * kappa, v=v)
        angles.append(_angle(found, v))
    assert angles[0] - angles[1] == pytest.approx(k_ag * v * v * kappa, rel=1e-9)


def _angle(steer: float, v: float) -> float:
    """The wheel angle of a steering, by bisection on its inverse."""
    low, high = -1.0, 1.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (
            (middle, high) if CAR.steer_for_wheel_angle(middle, v) < steer else (low, middle)
        )
    return low


@pytest.mark.parametrize(("gain", "softening", "v"), [(1.0, 0.5, 4.0), (2.5, 1.0, 8.0)])
def test_small_errors_decay_at_the_stated_rate(gain: float, softening: float, v: float) -> None:
    """The front wheels point along -atan(k e / (k_s + v)): e' = -v k e / (k_s + v)."""
    controller = Stanley(gain=gain, softening=softening, yaw_damping=0.0)
    run = drive_kinematic(controller, Straight(), v, d=0.02, duration=3.0)
    rate = gain * v / (softening + v)
    measured = math.log(run.front[20] / run.front[299]) / 2.79
    assert measured == pytest.approx(rate, rel=0.02)


def test_large_errors_are_approached_at_a_limited_rate() -> None:
    """|e'| <= v, whatever the error: the arctangent saturates."""
    run = drive_kinematic(Stanley(yaw_damping=0.0), Straight(), 5.0, d=5.0, duration=15.0)
    fall = -(run.front[1:] - run.front[:-1]) / 0.01
    assert fall.max() < 5.0 / math.cos(1.0)
    assert abs(run.front[-1]) < 0.01


@pytest.mark.parametrize("direction", ["left", "right"])
def test_kinematic_front_axle_settles_on_the_circle_without_error(direction: str) -> None:
    path = Circle(radius=R, direction=direction)
    run = drive_kinematic(Stanley(yaw_damping=0.0), path, 3.0, d=0.3, duration=30.0)
    assert abs(run.front[-100:]).max() < 1e-4
    inside = R - math.sqrt(R**2 - STIFF.wheelbase**2 + STIFF.l_r**2)
    assert abs(run.centre[-1]) == pytest.approx(inside, abs=1e-4)


def test_the_centre_of_mass_can_follow_instead() -> None:
    controller = Stanley(track="centre_of_mass")
    run = drive_kinematic(controller, Circle(), 3.0, d=0.3, duration=30.0)
    assert abs(run.centre[-100:]).max() < 1e-4
    episode = drive(controller, Circle(), speed=ConstantSpeed(speed=8.0), duration=20.0)
    assert abs(episode["lateral_error"]).max() < 0.01


@pytest.mark.parametrize("radius", [15.0, -60.0])
@pytest.mark.parametrize("ahead", [1.168, -1.836])
def test_moved_errors_are_the_projection_of_the_moved_point(radius: float, ahead: float) -> None:
    path = Circle(radius=abs(radius), direction="left" if radius > 0 else "right")
    car = beside(path, 9.0, d=0.4, heading=0.1)
    x, y = car.x + ahead * math.cos(car.psi), car.y + ahead * math.sin(car.psi)
    s, d = path.project(x, y, near=9.0)
    error, heading = moved_errors(0.4, 0.1, 1.0 / radius, ahead)
    assert error == pytest.approx(d, abs=1e-9)
    assert heading == pytest.approx(math.remainder(car.psi - path.at(s).psi, math.tau), abs=1e-9)


def test_steady_yaw_takes_the_error_out_of_a_fast_circle() -> None:
    late = {}
    for steady in (True, False):
        episode = drive(
            Stanley(steady_yaw=steady), Circle(), speed=ConstantSpeed(speed=12.0), duration=20.0
        )
        late[steady] = abs(episode["lateral_error"][-1])
    assert late[True] < 0.03
    assert late[False] > 3.0 * late[True]


def test_steering_damping_opposes_the_change() -> None:
    """Against the change of the measured steering since the last step, none at the first."""
    controller = Stanley(steer_damping=0.3)
    state, out = controller.init(CAR, DT), []
    for measured in (0.1, 0.15):
        car = beside(Posed(), 5.0, d=0.1, steer=measured)
        decision, state = controller.step(state, observe(Posed(), car, 5.0))
        out.append(decision.steer)
    assert out[1] - out[0] == pytest.approx(-0.3 * 0.05)
