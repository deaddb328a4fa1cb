"""What a privileged demonstrator gets, and no agent: the true car, delay, road and state."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from steersman.config import Component
from steersman.kernels import observe
from steersman.kernels import vehicle as car
from steersman.sensing import NO_SHIFT, to_observation
from steersman.types import Observation
from steersman.vehicles import Vehicle
from steersman.world import Simulation

C = TypeVar("C", bound=Component)
# The figures of a car that an episode may change, as it has them and as the kernels do.
_FIGURES = {
    "mass": car.MASS,
    "yaw_inertia": car.INERTIA,
    "c_f": car.C_F,
    "c_r": car.C_R,
    "friction": car.MU,
    "steer_rate_up": car.STEER_UP,
    "steer_rate_down": car.STEER_DOWN,
}


class Truth:
    """The true vehicles of a simulation."""

    def __init__(self, simulation: Simulation, vehicle: Vehicle) -> None:
        """``vehicle`` is the car of which each episode's differs."""
        self._simulation, self._vehicle = simulation, vehicle

    def car(self, n: int) -> Vehicle:
        """The car that vehicle ``n`` is in this episode."""
        row = self._simulation.world.vehicles.rows[n]
        figures = {name: float(row[column]) for name, column in _FIGURES.items()}
        figures["steer_bias"] = float(row[car.STEER_BIAS] * row[car.MAX_STEER])
        return self._vehicle.replace(**figures)

    def delay(self, n: int) -> float:
        """Time until a steering command of vehicle ``n`` acts [s]."""
        return float(self._simulation.fleet.delay[n] * self._simulation.world.h)

    def observation(self, n: int) -> Observation:
        """What a sensor of vehicle ``n`` without errors, latency and losses gives."""
        simulation, fleet, sensor = (
            self._simulation,
            self._simulation.fleet,
            self._simulation.sensor,
        )
        row = np.empty(observe.O_PREVIEW + 2 * sensor.count)
        observe.sense(
            simulation.world.paths,
            int(fleet.path[n]),
            fleet.state[n],
            fleet.tracking[n],
            sensor.spacing,
            sensor.count,
            NO_SHIFT,
            NO_SHIFT,
            row,
        )
        seen = to_observation(row, simulation.time(n), sensor.spacing)
        return simulation.told(n, seen)


def informed(component: C, delay: float) -> C:
    """A component with the steering delay [s] in every field of that name, however deep."""
    changes: dict[str, Any] = {}
    for name in type(component).model_fields:
        value = getattr(component, name)
        if name == "delay":
            changes[name] = delay
        elif isinstance(value, Component):
            changes[name] = informed(value, delay)
    return component.model_copy(update=changes)
