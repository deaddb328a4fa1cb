"""Each fault that the doctor looks for, in drives made up to have it."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from steersman.plants import carla_doctor as doctor
from steersman.plants.carla import CarlaConfig
from steersman.plants.carla_doctor import Finding, _Run
from steersman.plants.simulator import SimulatorConfig
from steersman.types import Command, Pose, VehicleState
from steersman.vehicles import CarlaModel3

CAR = CarlaModel3()


class Stand:
    """As much of a plant as the doctor asks for, driven by the simulator."""

    ahead = 0.45

    def __init__(self, pull: float = 1.0) -> None:
        self._plant = SimulatorConfig().make(CAR)
        self._pull = pull
        self.vehicle, self.dt = CAR, 0.05
        self.first = self._plant.reset(Pose(0.0, 0.0, 0.0), 0.0, 0.0)

    def step(self, command: Command) -> VehicleState:
        return self._plant.step(command._replace(throttle=self._pull * command.throttle))


def turning() -> _Run:
    plant = SimulatorConfig().make(CAR)
    states = [plant.reset(Pose(0.0, 0.0, 0.0), 8.0, 0.02)]
    held = states[0].steer
    for k in range(60):
        states.append(plant.step(Command(held + 0.1 * math.sin(0.5 * k), 0.45, 0.0)))
    return _Run(held, states)


def faulty(finding: Finding, cure: str) -> bool:
    assert not finding.healthy
    assert cure in finding.cure
    return True


def test_a_car_that_does_not_take_off() -> None:
    well: Any = Stand()
    assert doctor._takes_off(well, well.first).healthy
    slow: Any = Stand(pull=0.4)
    assert faulty(doctor._takes_off(slow, slow.first), "plant.warm_up=4")


def test_wheels_that_are_off_the_law() -> None:
    run, stand = turning(), SimpleNamespace(vehicle=CAR)
    plant: Any = stand
    found = doctor._steering(plant, run)
    assert found.healthy
    assert "0.0 % off the law" in found.text
    stand.vehicle = CAR.replace(max_wheel_angle=0.9 * CAR.max_wheel_angle)
    assert faulty(doctor._steering(plant, run), "carla calibrate")


def test_velocities_of_the_origin_are_noticed() -> None:
    plant: Any = Stand()
    states = turning().states
    assert doctor._velocity(plant, states).healthy
    # The origin is behind: in a left turn it moves more to the right than the centre of mass.
    others = [s._replace(v_y=s.v_y - s.yaw_rate * plant.ahead) for s in states]
    assert faulty(doctor._velocity(plant, others), "report it")


@pytest.mark.parametrize(("apart", "healthy"), [(0.0, True), (5e-4, True), (2e-3, False)])
def test_runs_that_differ(apart: float, healthy: bool) -> None:
    one = turning().states
    other = [s._replace(y=s.y + apart * k / 60) for k, s in enumerate(one)]
    found = doctor._repeats(one, other)
    assert found.healthy == healthy
    assert f"{1e3 * apart:.3g} mm apart" in found.text
    assert healthy or faulty(found, "nothing else may run on the server")


@pytest.mark.parametrize(
    ("blueprint", "believed", "read", "cure"),
    [
        ("vehicle.tesla.model3", CarlaModel3(), False, ""),
        ("vehicle.tesla.model3", CarlaModel3(mass=1093.0), True, ""),
        ("vehicle.tesla.model3", CarlaModel3(mass=1093.0), False, "plant.read_physics=true"),
        ("vehicle.lincoln.mkz_2020", CarlaModel3(), True, "vehicle=carla_mkz2020"),
        ("vehicle.audi.tt", CarlaModel3(), True, ""),
    ],
)
def test_what_is_believed_of_the_car(
    blueprint: str, believed: CarlaModel3, read: bool, cure: str
) -> None:
    config = CarlaConfig(vehicle=blueprint, read_physics=read)
    found = doctor._vehicle(config, believed, CarlaModel3())
    assert found.healthy == (cure == "")
    assert cure in found.cure


def test_what_the_server_tells_otherwise() -> None:
    assert doctor._differences(CAR, CAR) == ""
    other = CAR.replace(mass=2100.0, steer_curve_factor=(1.0, 1.0, 1.0, 1.0))
    said = doctor._differences(CAR, other)
    assert said == "mass 2100 (not 1845), another steering curve"
