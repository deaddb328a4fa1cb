"""What moves the vehicles of a world: the kernels all of them at once, or a plant one of them.

Everything else of a step (pedals, faults, place on the road, sensors, reward, features) is the
same compiled code in both cases, so that whatever plant there is can be driven and learned on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, Protocol

import numpy as np

from steersman.errors import ConfigError, PlantError
from steersman.kernels import step as lessons
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.kernels.bound import Bound, bind, learn, move
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.step import Lesson
from steersman.plants.base import ComputedComponent, LivePlant, PlantComponent
from steersman.plants.simulator import place
from steersman.protocols import Path, Plant
from steersman.sensing import STATE_COLUMNS, to_state
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import Vehicle

# A load at which any car has rolled over [m/s^2].
_ROLLED = 1e9


class Mover(Protocol):
    """Puts the vehicles of a fleet at their starts, and moves them."""

    shared: Shared | None
    """The plant, if there is one, which several movers drive in turns."""

    @property
    def vehicle(self) -> Vehicle:
        """The nominal vehicle; a plant may have better figures once a drive has begun."""
        ...

    def begin(
        self, world: World, fleet: Fleet, i: int, pose: Pose, speed: float, curvature: float
    ) -> None:
        """Put vehicle ``i`` on ``pose`` in the steady turn; ``fleet.path`` says on which road."""
        ...

    def step(self, world: World, fleet: Fleet, lesson: Lesson | None, actions: FloatArray) -> None:
        """One control step of all vehicles; without a lesson actions are steering commands."""
        ...

    def lose(self) -> None:
        """The fleet's state was replaced: the vehicles have to be put there before a step."""
        ...

    def close(self) -> None:
        """Release whatever is held; may be called twice."""
        ...


@dataclass
class Shared:
    """A plant, and the seat that drives it at the moment."""

    plant: Plant
    driver: Seat | None = None


def make_mover(
    plant: PlantComponent,
    vehicle: Vehicle,
    roads: Sequence[Path],
    n: int,
    shared: Shared | None = None,
) -> Mover:
    """The kernels, or plants: ``shared`` if it is given, else those that ``plant`` makes.

    Raises:
        ConfigError: ``n`` vehicles are wanted of a plant that drives one.
        PlantError: the plant cannot be reached.
    """
    if shared is None and plant.embedded:
        return Kernels(vehicle)
    if shared is None and plant.computed and isinstance(plant, ComputedComponent):
        return Computed([plant.make(vehicle) for _ in range(n)])
    if n != 1:
        raise ConfigError(
            f"plant={plant.kind} drives one vehicle, {n} are wanted; set agent.vehicles=1"
        )
    return Seat(shared or Shared(plant.make(vehicle)), roads)


class Kernels:
    """The embedded simulator: all vehicles in one call."""

    shared: Shared | None = None

    def __init__(self, vehicle: Vehicle) -> None:
        """Of that nominal vehicle; ``world.vehicles`` has each one's own."""
        self._vehicle = vehicle
        self._tables: tuple[Any, ...] = ()
        self._bound: Bound | None = None

    @property
    def vehicle(self) -> Vehicle:
        """The nominal vehicle."""
        return self._vehicle

    def begin(
        self, world: World, fleet: Fleet, i: int, pose: Pose, speed: float, curvature: float
    ) -> None:
        """Fill the vehicle's row."""
        place(world.vehicles, i, fleet.state[i], fleet.delayed[i], pose, speed, curvature)

    def step(self, world: World, fleet: Fleet, lesson: Lesson | None, actions: FloatArray) -> None:
        """One call of a kernel."""
        (move if lesson is None else learn)(self.bound(world, fleet, lesson), actions)

    def bound(self, world: World, fleet: Fleet, lesson: Lesson | None) -> Bound:
        """The three as one, the same as long as they are."""
        tables = world, fleet, lesson
        if self._bound is None or any(a is not b for a, b in zip_longest(tables, self._tables)):
            self._tables, self._bound = tables, bind(*tables)
        return self._bound

    def lose(self) -> None:
        """They are where the fleet has them."""

    def close(self) -> None:
        """Nothing to release."""


def _ride(
    world: World, fleet: Fleet, lesson: Lesson | None, i: int, steer: float, plant: Plant
) -> None:
    """The kernel's step of vehicle ``i``, with a plant's motion in its middle.

    Raises:
        PlantError: the plant failed, or left the numbers.
    """
    before = 0.0
    if lesson is not None:
        steer, before = lessons.command(lesson, fleet, i, steer, world.dt)
    near = kernel.decide(world, fleet, i, steer)
    _write(fleet, i, plant.step(Command(*fleet.command[i].tolist())), plant)
    kernel.conclude(world, fleet, i, near)
    if lesson is not None:
        lessons.judge(lesson, fleet, i, steer, before)


def _write(fleet: Fleet, i: int, state: VehicleState, plant: Plant) -> None:
    row = fleet.state[i]
    row[STATE_COLUMNS] = state[1:]
    if not np.isfinite(row).all():
        raise PlantError(f"the plant's state is not finite: {state}")
    row[car.LOAD_AX], row[car.LOAD_AY] = 0.0, _ROLLED * plant.rolled_over()


class Computed:
    """Plants that are computed here, one for each vehicle, with the figures of the fleet's rows."""

    shared: Shared | None = None

    def __init__(self, plants: Sequence[LivePlant]) -> None:
        """Take the plants; they are put at their starts by ``begin``."""
        self._plants = plants
        self._there = [False] * len(plants)

    @property
    def vehicle(self) -> Vehicle:
        """The nominal vehicle."""
        vehicle: Vehicle = self._plants[0].vehicle
        return vehicle

    def _prepare(self, world: World, fleet: Fleet, i: int) -> LivePlant:
        plant = self._plants[i]
        plant.table.rows[0] = world.vehicles.rows[i]
        plant.delay = int(fleet.delay[i])
        return plant

    def begin(
        self, world: World, fleet: Fleet, i: int, pose: Pose, speed: float, curvature: float
    ) -> None:
        """Start there."""
        plant = self._prepare(world, fleet, i)
        self._there[i] = True
        _write(fleet, i, plant.reset(pose, speed, curvature), plant)

    def step(self, world: World, fleet: Fleet, lesson: Lesson | None, actions: FloatArray) -> None:
        """One vehicle after the other.

        Raises:
            PlantError: a plant left the numbers.
        """
        for i, steer in enumerate(actions.tolist()):
            if lesson is not None and lesson.period > 1 and fleet.ended[i] != kernel.RUNNING:
                continue
            plant = self._prepare(world, fleet, i)
            if not self._there[i]:
                plant.resume(to_state(fleet.state[i], 0.0))
                self._there[i] = True
            _ride(world, fleet, lesson, i, steer, plant)

    def lose(self) -> None:
        """The next step begins with putting the vehicles where the fleet has them."""
        self._there = [False] * len(self._plants)

    def close(self) -> None:
        """Release the plants."""
        for plant in self._plants:
            plant.close()


class Seat:
    """A seat in a plant's vehicle, which several take in turns.

    Training and validation drive the same vehicle: the seat that did not drive last puts it back
    first.
    """

    def __init__(self, shared: Shared, roads: Sequence[Path]) -> None:
        """Take a seat; nothing moves yet."""
        self.shared: Shared | None = shared
        self._shared = shared
        self._plant = shared.plant
        self._roads = roads

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with the plant's own figures."""
        vehicle: Vehicle = self._plant.vehicle
        return vehicle

    def enter(self) -> None:
        """Enter the first road, so that whatever is missing is found before anything is learned."""
        if self._shared.driver is None:
            at = self._roads[0].at(0.0)
            self._plant.enter(self._roads[0])
            self._plant.reset(Pose(at.x, at.y, at.psi), 0.0, 0.0)
            self._shared.driver = self

    def begin(
        self, world: World, fleet: Fleet, i: int, pose: Pose, speed: float, curvature: float
    ) -> None:
        """Enter the road and start there."""
        self._shared.driver = self
        self._plant.enter(self._roads[int(fleet.path[i])])
        self._plant.delay = int(fleet.delay[i])
        _write(fleet, 0, self._plant.reset(pose, speed, curvature), self._plant)

    def step(self, world: World, fleet: Fleet, lesson: Lesson | None, actions: FloatArray) -> None:
        """The kernel's step, with the plant's motion in its middle.

        Raises:
            PlantError: the plant failed, or left the numbers.
        """
        if self._shared.driver is not self:
            self._return(fleet)
        _ride(world, fleet, lesson, 0, float(actions[0]), self._plant)

    def _return(self, fleet: Fleet) -> None:
        """Put the vehicle where the fleet has it."""
        self._shared.driver = self
        self._plant.enter(self._roads[int(fleet.path[0])])
        self._plant.delay = int(fleet.delay[0])
        self._plant.resume(to_state(fleet.state[0], 0.0))

    def accelerations(self) -> FloatArray:
        """What the plant kept of the accelerations between control steps, see ``Plant``."""
        return self._plant.accelerations()

    def lose(self) -> None:
        """No seat drives: the next step begins with putting the vehicle back."""
        self._shared.driver = None

    def close(self) -> None:
        """Release the plant, for all that share it."""
        self._plant.close()
