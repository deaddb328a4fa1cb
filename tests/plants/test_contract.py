"""The contract of plants: kept by those that come with the package, broken by faulty ones."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from steersman.bench.disturbance import Disturbance
from steersman.contracts.plant import check
from steersman.plants.base import PlantComponent
from steersman.plants.multibody import MultiBody
from steersman.plants.physics import PhysicsComponent, PhysicsPlant
from steersman.plants.simulator import SimulatorConfig
from steersman.plants.tum_single_track import TumSingleTrack
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import CarlaModel3, Vehicle


class Kinematic(PhysicsComponent):
    """A car without slip: only its geometry counts."""

    family: ClassVar[str] = "plant"
    kind: ClassVar[str] = "kinematic"
    cannot: ClassVar[frozenset[str]] = frozenset(
        {"mass", "yaw_inertia", "c_f", "c_r", "friction", "wind"}
    )

    def derivative(
        self, vehicle: Vehicle, state: FloatArray, steer: float, throttle: float, brake: float
    ) -> FloatArray:
        psi, v_x, v_y, rate = state[2:6].tolist()
        turn = np.tan(vehicle.wheel_angle(steer, v_x)) / vehicle.wheelbase
        push = 4.0 * throttle - 8.0 * brake - 0.1 * v_x
        x = v_x * np.cos(psi) - v_y * np.sin(psi)
        y = v_x * np.sin(psi) + v_y * np.cos(psi)
        slip, lag = vehicle.l_r * rate - v_y, turn * v_x - rate
        return np.array([x, y, rate, push, 50.0 * slip, 50.0 * lag])


class Undelayed(Kinematic):
    """Its steering delay does nothing."""

    def make(self, vehicle: Vehicle) -> PhysicsPlant:
        plant = super().make(vehicle)
        step = plant.step

        def at_once(command: Command) -> VehicleState:
            plant.delay = 0
            return step(command)

        plant.step = at_once  # type: ignore[method-assign]
        return plant


class Random(Kinematic):
    """Its motion is another one every time."""

    def derivative(self, vehicle: Vehicle, state: FloatArray, *inputs: float) -> FloatArray:
        return super().derivative(vehicle, state, *inputs) + np.random.uniform(0.0, 1e-3, 6)  # noqa: NPY002


class Boastful(Kinematic):
    """Lists too little, and what there is not."""

    cannot: ClassVar[frozenset[str]] = frozenset({"mass", "yaw_inertia", "c_f", "c_r", "rain"})


@pytest.mark.parametrize(
    "plant",
    [SimulatorConfig(), Kinematic(), Kinematic(dt=0.02), MultiBody(), TumSingleTrack(dt=0.04)],
)
def test_plants_keep_their_contract(plant: PlantComponent) -> None:
    assert check(plant) == []


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        (Undelayed(), ["ignores delay", "a steering delay of 0.2 s is not one of 4"]),
        (Random(), ["give another motion"]),
        (Boastful(), ["cannot names rain", "ignores friction", "ignores wind"]),
    ],
)
def test_what_breaks_the_contract_is_named(plant: PlantComponent, said: list[str]) -> None:
    found = check(plant)
    assert all(any(words in one for one in found) for words in said), found


def test_what_a_plant_cannot_do_is_left_out_of_a_benchmark() -> None:
    plant, mixed = Kinematic(), Disturbance(mass=1.2, delay=0.1, wind=5.0, speed_noise=0.1)
    assert mixed.beyond(plant) == ["mass", "wind"]
    assert mixed.beyond(SimulatorConfig()) == []
    assert Disturbance(delay=0.1).beyond(plant) == []
    assert Disturbance(delay=0.105).beyond(plant) == ["delay"]


def test_own_physics_starts_in_its_own_steady_turn() -> None:
    """With the steering and the throttle of the start the turn goes on."""
    plant = Kinematic().make(CarlaModel3())
    first = plant.reset(Pose(0.0, 0.0, 0.0), 10.0, 0.03)
    state = first
    for _ in range(100):
        state = plant.step(Command(first.steer, first.throttle, first.brake))
    assert state.yaw_rate == pytest.approx(0.3, abs=1e-6)
    assert state.v_x == pytest.approx(first.v_x, abs=1e-6)
