"""One vehicle moved by a plant: the same as by the kernels, shared in turns, closed once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.errors import ConfigError
from steersman.kernels import vehicle as car
from steersman.learning.fleet import FleetDriver
from steersman.learning.validate import Validator
from steersman.plants.mover import Shared, make_mover
from steersman.plants.simulator import Simulator, SimulatorConfig

from .problems import problem, tiny

ONE_CAR: dict[str, Any] = {"spread": {"mass": 0.0, "delay": 0.1}}
# Loads are the simulator's own, and no plant tells them.
TOLD = [c for c in range(car.N_STATE) if c not in {car.LOAD_AX, car.LOAD_AY}]


def shared(**settings: Any) -> Shared:
    return Shared(SimulatorConfig(**settings).make(problem().vehicle))


def drive(driver: FleetDriver, steps: int, seed: int = 3) -> list[Any]:
    """What a driver sees, is rewarded with, and where its car is."""
    driver.seed(seed)
    driver.reset(0)
    rows = []
    for u in np.random.default_rng(0).uniform(-0.3, 0.3, steps):
        driver.step(np.array([u]))
        fleet = driver.fleet
        parts = (fleet.inputs[0], fleet.reward[0], fleet.state[0, TOLD], fleet.demo, fleet.ended)
        rows.append(np.concatenate([np.ravel(part) for part in parts]))
        if fleet.ended[0]:
            driver.reset(0)
    return rows


def test_a_plant_moves_the_car_as_the_kernels_do_to_the_bit() -> None:
    task = problem(**ONE_CAR)
    alone, seated = FleetDriver(task, 1), FleetDriver(task, 1, shared())
    expected, found = drive(alone, 200), drive(seated, 200)
    assert np.array_equal(expected, found)
    assert len({row[-1] for row in expected}) > 1  # episodes ended on the way


def test_validation_by_turns_is_validation_at_once() -> None:
    task, config = problem(**ONE_CAR), tiny().validation.model_copy(update={"vehicles": 3})

    def act(inputs: Any) -> Any:
        return np.tanh(inputs[:, 1])

    by_turns = Validator(task, config, shared()).score(act)
    assert by_turns == pytest.approx(Validator(task, config).score(act), rel=1e-12)


def test_who_did_not_drive_last_puts_the_car_back_first() -> None:
    task, both = problem(**ONE_CAR), shared()
    training, other = FleetDriver(task, 1, both), FleetDriver(task, 1, both)
    alone = FleetDriver(task, 1)
    first = drive(training, 30, seed=5)
    assert np.array_equal(drive(alone, 30, seed=5), first)
    drive(other, 25, seed=6)
    before = training.fleet.state[0, TOLD].copy()
    for driver in (training, alone):
        driver.step(np.zeros(1))
    moved = training.fleet.state[0]
    assert np.hypot(*(moved[:2] - before[:2])) < 2.0  # it was not left where the other had it
    # Loads are put back as those of the accelerations.
    assert moved[TOLD] == pytest.approx(alone.fleet.state[0, TOLD], abs=1e-2)


def test_a_restored_driver_puts_the_car_back_too() -> None:
    task = problem(**ONE_CAR)
    driver, alone = FleetDriver(task, 1, shared()), FleetDriver(task, 1)
    drive(alone, 40)
    driver.restore(alone.snapshot())
    for one in (driver, alone):
        one.step(np.zeros(1))
    assert driver.fleet.state[0, TOLD] == pytest.approx(alone.fleet.state[0, TOLD], abs=1e-2)


class Countable(SimulatorConfig):
    """Not embedded, as CARLA is not; its plants count how often they are closed."""

    embedded = computed = False

    def make(self, vehicle: Any) -> Simulator:
        plant = super().make(vehicle)
        plant.closed = 0  # type: ignore[attr-defined]

        def close() -> None:
            plant.closed += 1  # type: ignore[attr-defined]

        plant.close = close  # type: ignore[method-assign]
        return plant


def test_a_plant_drives_one_vehicle() -> None:
    task = problem(plant=Countable(), spread={"mass": 0.0})
    with pytest.raises(ConfigError, match=r"drives one vehicle, 4 are wanted"):
        make_mover(task.plant, task.vehicle, task.roads, 4)
    with pytest.raises(ConfigError, match=r"agent\.vehicles: 4 is not allowed; .* one vehicle"):
        tiny(problem={"plant": Countable(), "spread": {"mass": 0.0}})
    with pytest.raises(ConfigError, match=r"spread\.mass: 0\.1 is not allowed; .* the one car"):
        problem(plant=Countable(), spread={"mass": 0.1})


def test_a_driver_that_cannot_begin_closes_its_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    make = Countable.make

    def keep(self: Countable, vehicle: Any) -> Simulator:
        made.append(make(self, vehicle))
        return made[-1]  # type: ignore[no-any-return]

    def fail(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Countable, "make", keep)
    task = problem(plant=Countable(), spread={"mass": 0.0})
    FleetDriver(task, 1).close()
    assert [plant.closed for plant in made] == [1]
    monkeypatch.setattr(Simulator, "reset", fail)
    with pytest.raises(KeyboardInterrupt):
        FleetDriver(task, 1)
    assert [plant.closed for plant in made] == [1, 1]
