"""Driving through the real client: the same commands give the embedded simulator's states."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from steersman.kernels import vehicle as kernel
from steersman.plants.simulator import SimulatorConfig
from steersman.types import Command, Pose
from steersman.vehicles import CarlaModel3

from .reference import NEAR, OFFSET, TURNED, assert_same, commands, drive, embedded, start
from .serving import MODEL3, at, spawn, synchronous

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")


@pytest.mark.parametrize(
    ("dt", "substep", "most", "substeps"),
    [(0.05, 0.01, 10, 5), (0.05, 0.005, 10, 10), (0.05, 0.1, 1, 5), (0.02, 0.01, 10, 2)],
)
def test_the_same_commands_give_the_same_states(
    client: Any, dt: float, substep: float, most: int, substeps: int
) -> None:
    world = synchronous(client.get_world(), dt, substep, most)
    car = spawn(world, 10.0, -20.0, 30.0)
    table = commands(120)
    states = embedded(CarlaModel3(), start(10.0, -20.0, 30.0), table, substeps, dt)
    assert_same(drive(world, car, table), states)
    assert np.hypot(*(states[-1] - states[0])[:2]) > 5.0
    assert np.ptp(states[:, kernel.PSI]) > 0.02


def test_the_simulator_as_a_plant_agrees(world: Any) -> None:
    plant = SimulatorConfig().make(CarlaModel3())
    plant.reset(Pose(10.0 + OFFSET, 20.0, 0.0), 0.0, 0.0)
    plant._state[kernel.STEER :] = 0.0  # a car that has just been spawned holds no throttle
    car, table = spawn(world), commands(100)
    for actor, command in zip(drive(world, car, table), table.tolist(), strict=True):
        state = plant.step(Command(*command))
        where = actor.get_transform()
        x = where.location.x + OFFSET * math.cos(math.radians(where.rotation.yaw))
        y = where.location.y + OFFSET * math.sin(math.radians(where.rotation.yaw))
        assert (x, -y) == pytest.approx((state.x, state.y), abs=NEAR)
        assert -math.radians(where.rotation.yaw) == pytest.approx(state.psi, abs=TURNED)
    wheel = carla.VehicleWheelLocation
    cotangents = [
        1.0 / math.tan(-math.radians(car.get_wheel_steer_angle(w)))
        for w in (wheel.FL_Wheel, wheel.FR_Wheel)
    ]
    assert math.atan(2.0 / sum(cotangents)) == pytest.approx(state.wheel_angle, rel=1e-5)
    assert car.get_wheel_steer_angle(wheel.BL_Wheel) == 0.0


def test_an_ackermann_control_reaches_its_speed_and_angle(world: Any) -> None:
    car = spawn(world)
    settings = carla.AckermannControllerSettings()
    assert car.get_ackermann_controller_settings().speed_kp == pytest.approx(0.15)
    car.apply_ackermann_control(carla.VehicleAckermannControl(steer=0.1, speed=8.0))
    for _ in range(160):
        world.tick()
    velocity = car.get_velocity()
    assert math.hypot(velocity.x, velocity.y) == pytest.approx(8.0, abs=0.2)
    inner = car.get_wheel_steer_angle(carla.VehicleWheelLocation.FR_Wheel)
    outer = car.get_wheel_steer_angle(carla.VehicleWheelLocation.FL_Wheel)
    assert 0.0 < outer < inner < math.degrees(0.1)
    assert car.get_angular_velocity().z > 0.0
    # The wheels turn no faster than asked, and a plain control ends it all.
    car.apply_ackermann_control(carla.VehicleAckermannControl(steer=-0.1, steer_speed=0.1))
    world.tick()
    turned = inner - car.get_wheel_steer_angle(carla.VehicleWheelLocation.FR_Wheel)
    assert 0.0 < turned < 1.5 * math.degrees(0.1 * 0.05)
    settings.speed_kp = 0.3
    car.apply_ackermann_controller_settings(settings)
    assert car.get_ackermann_controller_settings().speed_kp == pytest.approx(0.3)
    car.apply_control(carla.VehicleControl(brake=1.0))
    for _ in range(60):
        world.tick()
    assert math.hypot(car.get_velocity().x, car.get_velocity().y) < 0.3
    assert car.get_control().brake == 1.0


@pytest.mark.parametrize("name", [MODEL3, "vehicle.lincoln.mkz_2020"])
def test_an_ackermann_angle_is_a_share_of_the_largest_wheel_angle(world: Any, name: str) -> None:
    # As in CARLA's AckermannController.cpp: what the steering law does after that is not undone.
    car = world.spawn_actor(world.get_blueprint_library().find(name), at(10.0))
    lock = math.radians(car.get_physics_control().wheels[0].max_steer_angle)
    car.set_target_velocity(carla.Vector3D(x=15.0))
    car.apply_ackermann_control(carla.VehicleAckermannControl(steer=0.05, speed=15.0))
    world.tick()
    world.tick()
    assert car.get_control().steer == pytest.approx(0.05 / lock, rel=1e-6)
    speed = math.hypot(car.get_velocity().x, car.get_velocity().y)
    inner = math.radians(car.get_wheel_steer_angle(carla.VehicleWheelLocation.FR_Wheel))
    # At 20 to 60 km/h the curve falls from 0.9 to 0.8.
    assert inner == pytest.approx(0.05 * (0.9 - 0.1 * (3.6 * speed - 20.0) / 40.0), rel=1e-3)
    # A rate holds from one command to the next; beyond the lock there is nothing.
    car.apply_ackermann_control(carla.VehicleAckermannControl(-2.0, 0.4, 15.0))
    world.tick()
    assert car.get_control().steer == pytest.approx((0.05 - 0.4 * 0.05) / lock, rel=1e-5)
    car.apply_ackermann_control(carla.VehicleAckermannControl(-2.0, 0.0, 15.0))
    world.tick()
    assert car.get_control().steer == -1.0


def test_controls_beyond_their_range_are_limited(world: Any) -> None:
    car = spawn(world)
    car.apply_control(carla.VehicleControl(throttle=7.0, steer=-3.0, brake=math.nan))
    for _ in range(20):
        world.tick()
    control = car.get_control()
    assert (control.throttle, control.steer, control.brake) == (1.0, -1.0, 0.0)
    assert car.get_wheel_steer_angle(carla.VehicleWheelLocation.FL_Wheel) < -50.0
    assert car.get_angular_velocity().z < -10.0


def test_the_hand_brake_brakes(world: Any) -> None:
    car = spawn(world)
    car.set_target_velocity(carla.Vector3D(x=10.0))
    car.apply_control(carla.VehicleControl(hand_brake=True))
    for _ in range(80):
        world.tick()
    assert abs(car.get_velocity().x) < 0.1


@pytest.mark.parametrize("gear", [{"reverse": True}, {"manual_gear_shift": True, "gear": -1}])
def test_it_drives_backwards_as_strongly_as_ahead(world: Any, gear: dict[str, Any]) -> None:
    ahead, back = spawn(world), spawn(world, 10.0, 40.0)
    ahead.apply_control(carla.VehicleControl(throttle=0.7, steer=0.2))
    back.apply_control(carla.VehicleControl(throttle=0.7, steer=0.2, **gear))
    for _ in range(40):
        world.tick()
    assert ahead.get_velocity().x > 4.0 > -4.0 > back.get_velocity().x
    speeds = [math.hypot(car.get_velocity().x, car.get_velocity().y) for car in (ahead, back)]
    assert speeds[1] == pytest.approx(speeds[0], rel=0.05)
    # Steered to the right it turns its front to the left, and ends right of where it began.
    assert back.get_angular_velocity().z == pytest.approx(-ahead.get_angular_velocity().z, rel=0.1)
    assert back.get_transform().rotation.yaw < -3.0
    assert back.get_transform().location.y > 40.3
    assert back.get_control().reverse is ("reverse" in gear)
    # The throttle without the gear brakes it, and drives ahead.
    back.apply_control(carla.VehicleControl(throttle=0.7))
    for _ in range(90):
        world.tick()
    assert back.get_velocity().x > 0.5


def test_reverse_against_the_motion_brakes_and_neutral_drives_nowhere(world: Any) -> None:
    car, idle = spawn(world), spawn(world, 10.0, 40.0)
    car.set_target_velocity(carla.Vector3D(x=5.0))
    car.apply_control(carla.VehicleControl(throttle=0.6, reverse=True))
    idle.apply_control(carla.VehicleControl(throttle=1.0, manual_gear_shift=True, gear=0))
    seen = []
    for _ in range(60):
        world.tick()
        seen.append(car.get_velocity().x)
    assert all(b < a for a, b in pairwise(seen))
    assert seen[-1] < -1.0
    assert idle.get_velocity().x == 0.0
    # It stays where the brake has brought it, and an Ackermann control goes back, too.
    car.apply_control(carla.VehicleControl(brake=1.0))
    for _ in range(40):
        world.tick()
    assert abs(car.get_velocity().x) < 0.05
    car.apply_ackermann_control(carla.VehicleAckermannControl(speed=-3.0, acceleration=3.0))
    for _ in range(200):
        world.tick()
    assert car.get_velocity().x == pytest.approx(-3.0, abs=0.5)
    assert car.get_control().reverse


@pytest.mark.parametrize("sticky", [True, False])
def test_a_control_holds_if_the_blueprint_says_so(world: Any, sticky: bool) -> None:
    blueprint = world.get_blueprint_library().find("vehicle.tesla.model3")
    blueprint.set_attribute("sticky_control", str(sticky))
    car = world.spawn_actor(blueprint, at(0.0, -20.0))
    seen = []
    for given in (True, True, False, False):
        if given:
            car.apply_control(carla.VehicleControl(throttle=0.8, steer=0.1))
        world.tick()
        seen.append(car.get_control().throttle)
    assert seen == pytest.approx([0.8, 0.8, *(2 * [0.8 if sticky else 0.0])])
    speed = car.get_velocity().x
    for _ in range(10):
        world.tick()
    assert (car.get_velocity().x > speed + 0.5) is sticky


def test_a_car_that_tips_over_says_so(world: Any) -> None:
    # The Model 3 slides before its wheels lift.
    library = world.get_blueprint_library()
    car = world.spawn_actor(library.find("vehicle.lincoln.mkz_2020"), at(10.0, -20.0, 0.0, 0.5))
    world.tick()
    assert car.get_failure_state() == carla.VehicleFailureState.NONE
    car.set_target_velocity(carla.Vector3D(x=30.0))
    car.apply_control(carla.VehicleControl(throttle=1.0, steer=0.4))
    states = []
    for _ in range(20):
        world.tick()
        states.append(car.get_failure_state())
    assert carla.VehicleFailureState.Rollover in states
