"""The force with which gravity draws a vehicle down a banked road.

Source: Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.3, eq. (2.17): bank angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from steersman.disturbances import Disturber
from steersman.kernels import observe
from steersman.kernels import vehicle as car
from steersman.kernels.fleet import Fleet, World
from steersman.paths.base import PathComponent
from steersman.types import Surface


class Banking(Disturber):
    """The side force -m g sin(bank) of each vehicle, where its road is banked."""

    on_vehicle = True

    def __init__(self, surfaces: Sequence[Surface | None]) -> None:
        """``surfaces``: of the bank of roads."""
        self._surfaces = surfaces

    @classmethod
    def of(cls, roads: Sequence[PathComponent]) -> Banking | None:
        """That of roads; None where no road is banked."""
        found = [road.surface() for road in roads]
        banked = any(each is not None and each.bank.any() for each in found)
        return cls(found) if banked else None

    def act(self, world: World, fleet: Fleet, i: int, time: float) -> None:
        """Add the force where the vehicle is."""
        surface = self._surfaces[fleet.path[i]]
        if surface is not None:
            bank = surface.at(float(fleet.tracking[i, observe.S]))[1]
            row = world.vehicles.rows[i]
            row[car.SIDE_FORCE] -= row[car.MASS] * car.GRAVITY * math.sin(bank)
