"""What every plant's configuration has."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Protocol

import numpy as np

from steersman.config import Component, param, resolve
from steersman.disturbances import Disturber
from steersman.errors import ConfigError
from steersman.kernels.fleet import DELAY_LINE
from steersman.kernels.vehicle import VehicleTable
from steersman.plants.wind import Wind
from steersman.protocols import Path, Plant
from steersman.types import FloatArray
from steersman.vehicles import LONGEST_STEP, Vehicle

# Periods that differ by less are the same, but for rounding [s].
_SAME = 1e-9


def has_one_car(plant: Any) -> bool:
    """Whether a plant, by name or by fields, drives one car, which is as it is.

    Raises:
        ConfigError: there is no such plant, or its fields are wrong.
    """
    found = resolve("plant", plant)
    return isinstance(found, PlantComponent) and not found.computed


class PlantComponent(Component):
    """Something that drives one vehicle."""

    embedded: ClassVar[bool] = False
    """Whether it is the simulator that kernels and environments carry within themselves."""

    computed: ClassVar[bool] = False
    """Whether its vehicles are computed here from rows of figures: as many as are wanted, each a
    car of its own, whose figures may change on the way."""

    cannot: ClassVar[frozenset[str]] = frozenset({"wind"})
    """Disturbances without effect on this plant (names as in a suite's ``Disturbance``); a
    benchmark leaves their scenarios out and says so, ``steersman.contracts.plant`` checks the
    others."""

    dt: float = param(0.05, "s", "Control period.", gt=0, le=2)
    steering_delay: float = param(0.0, "s", "Time until a steering command acts.", ge=0)

    @abstractmethod
    def make(self, vehicle: Vehicle) -> Plant:
        """A plant that drives that vehicle, to be closed by the caller."""

    @property
    @abstractmethod
    def h(self) -> float:
        """Time between the moments at which a command can begin to act [s]."""

    def source(self) -> str:
        """The plant in words, as results state it; a server is queried for its version.

        Raises:
            PlantError: the server does not answer.
        """
        return self.kind

    def car(self, vehicle: Vehicle) -> str:
        """What is driven, in words; ``vehicle`` is the nominal vehicle."""
        return vehicle.title

    def disturbances(self, n: int, seed: int) -> list[Disturber | None]:
        """What disturbs ``n`` vehicles in this plant by its own configuration."""
        return []

    def recorded(self) -> PlantComponent:
        """The same, keeping accelerations between control steps if it can."""
        return self

    def substeps(self) -> int:
        """Steps of ``h`` in a control period.

        Raises:
            ConfigError: the control period is not a whole multiple of them.
        """
        count = round(self.dt / self.h)
        if count < 1 or abs(count * self.h - self.dt) > _SAME:
            raise ConfigError(
                f"plant.dt: {self.dt} s is not a whole multiple of plant.integration_step, "
                f"{self.h} s"
            )
        return count

    def delay_of(self, vehicle: Vehicle) -> int:
        """Steering delay in steps of ``h``, the car's own included where it is simulated here.

        Raises:
            ConfigError: the delay is longer than the delay line.
        """
        return self.delay_substeps(vehicle.steer_delay if self.computed else 0.0)

    def delay_substeps(self, more: float = 0.0) -> int:
        """Steering delay and ``more`` [s] in steps of ``h``.

        Raises:
            ConfigError: the delay is longer than the delay line.
        """
        delay = self.steering_delay + more
        count = round(delay / self.h)
        longest = (DELAY_LINE - 2) * self.substeps()
        if count > longest:
            limit = longest * self.h
            raise ConfigError(f"plant.steering_delay: {delay} s is too long; at most {limit:g} s")
        return count


class LivePlant(Plant, Protocol):
    """A plant whose vehicle's figures may change while it drives."""

    table: VehicleTable
    """Figures of the vehicle that is driven, in its one row."""


class ComputedComponent(PlantComponent):
    """A plant whose vehicles are computed here, in any number, from rows of figures."""

    computed: ClassVar[bool] = True
    cannot: ClassVar[frozenset[str]] = frozenset()

    integration_step: float = param(0.01, "s", "Integration step.", gt=0, le=LONGEST_STEP)
    wind: Wind = param(Wind(), "-", "Side wind.")

    @property
    def h(self) -> float:
        """Integration step [s]."""
        return self.integration_step

    @abstractmethod
    def make(self, vehicle: Vehicle) -> LivePlant:
        """A plant that drives that vehicle, in calm air; a world makes the wind."""

    def disturbances(self, n: int, seed: int) -> list[Disturber | None]:
        """The wind."""
        return [self.wind.make(n, seed)]


class ComputedPlant:
    """The plants that are computed here, a vehicle each, on level ground.

    See :class:`steersman.protocols.Plant`, of which it is the part that they have in common.

    Attributes:
        vehicle: the nominal vehicle.
        table: figures of the vehicle that is driven; its one row may be exchanged at any time.
    """

    def __init__(self, config: PlantComponent, vehicle: Vehicle) -> None:
        """Prepare the plant; ``reset`` before the first step."""
        self.vehicle, self.source = vehicle, config.source()
        self.table = vehicle.table._replace(rows=vehicle.table.rows.copy())
        self.delay = config.delay_of(vehicle)
        self.dt = config.dt
        self._h, self._substeps = config.h, config.substeps()
        self._steps = 0

    def enter(self, path: Path) -> None:
        """Any path will do: the ground is level everywhere."""

    def accelerations(self) -> FloatArray:
        """None: accelerations between control steps are not kept here."""
        return np.zeros((0, 2))

    def close(self) -> None:
        """Nothing to release."""
