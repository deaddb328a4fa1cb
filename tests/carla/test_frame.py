"""Axes, signs and units at CARLA's edge: there and back again, and mirrored as they must be."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.plants import carla_frame as frame
from steersman.plants.carla_frame import CarlaFrame, Placement
from steersman.types import Pose

METRES = st.floats(-1e4, 1e4)
ANGLES = st.floats(-3.1, 3.1)
OFFSETS = st.builds(CarlaFrame, st.floats(-2.0, 2.0), st.floats(-0.5, 0.5))


@given(METRES, METRES, ANGLES, OFFSETS)
def test_pose_there_and_back(x: float, y: float, psi: float, offset: CarlaFrame) -> None:
    back = offset.pose(*offset.placement(Pose(x, y, psi)))
    assert back == pytest.approx(Pose(x, y, psi), abs=1e-9)


@given(METRES, METRES, st.floats(-179.0, 179.0), OFFSETS)
def test_placement_there_and_back(x: float, y: float, yaw: float, offset: CarlaFrame) -> None:
    back = offset.placement(offset.pose(x, y, yaw))
    assert back == pytest.approx(Placement(x, y, yaw), abs=1e-9)


@given(ANGLES, METRES, METRES)
def test_vectors_there_and_back(psi: float, forward: float, left: float) -> None:
    assert CarlaFrame.body_vector(
        psi, *CarlaFrame.world_vector(psi, forward, left)
    ) == pytest.approx((forward, left), abs=1e-9)
    x, y = CarlaFrame.world_vector(psi, forward, left)
    assert math.hypot(x, y) == pytest.approx(math.hypot(forward, left))


def test_left_is_left() -> None:
    # At yaw 90 deg to the left, CARLA looks along its -y; left of that is its -x.
    assert CarlaFrame().placement(Pose(0.0, 0.0, math.pi / 2)).yaw == pytest.approx(-90.0)
    assert CarlaFrame.world_vector(math.pi / 2, 1.0, 0.0) == pytest.approx((0.0, -1.0), abs=1e-12)
    assert CarlaFrame.world_vector(math.pi / 2, 0.0, 1.0) == pytest.approx((-1.0, 0.0), abs=1e-12)
    # The Model 3's origin is 0.45 m behind its centre of mass.
    at = CarlaFrame(0.45).placement(Pose(0.0, 0.0, math.pi / 2))
    assert at[:2] == pytest.approx((0.0, 0.45), abs=1e-12)
    assert CarlaFrame.degrees_right(1.0) == pytest.approx(-57.29577951308232)
    assert CarlaFrame.radians_left(CarlaFrame.degrees_right(-2.0)) == pytest.approx(-2.0)


@given(METRES, METRES, ANGLES, OFFSETS)
def test_a_mirrored_pose_is_mirrored_in_carla(
    x: float, y: float, psi: float, offset: CarlaFrame
) -> None:
    at = offset.placement(Pose(x, y, psi))
    mirrored = offset._replace(left=-offset.left).placement(Pose(x, -y, -psi))
    assert mirrored == pytest.approx(Placement(at.x, -at.y, -at.yaw), abs=1e-9)


@given(ANGLES, st.floats(-50.0, 50.0))
def test_unwrapping_keeps_the_angle_and_stays_near(angle: float, near: float) -> None:
    found = frame.unwrapped(angle, near)
    assert abs(found - near) <= math.pi + 1e-9
    assert math.remainder(found - angle, math.tau) == pytest.approx(0.0, abs=1e-9)


@given(ANGLES, st.floats(-0.5, 0.5), st.floats(0.0, 40.0), st.floats(-2.0, 2.0))
def test_a_step_before_leads_to_the_pose(
    psi: float, slip: float, speed: float, rate: float
) -> None:
    dt, pose = 0.05, Pose(3.0, -2.0, psi)
    before = frame.a_step_before(pose, psi + slip, speed, rate, dt)
    x, y, heading = before
    n = 2000
    for _ in range(n):  # midpoint rule, along the arc
        course = heading + slip + 0.5 * rate * dt / n
        x += speed * math.cos(course) * dt / n
        y += speed * math.sin(course) * dt / n
        heading += rate * dt / n
    assert (x, y, heading) == pytest.approx(pose, abs=1e-6)
