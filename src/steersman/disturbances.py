"""What disturbs the vehicles of a world: the one interface, and the components of other packages.

A disturbance alters arrays of the fleet between the compiled steps, at two moments of each step:

- ``act``: the step begins. It may alter the vehicle's parameters (``world.vehicles.rows[i]``:
  friction, side force, ...) and what the steering actuator takes (``fleet.bounds[i]``).
- ``sense``: what is observed after the step is about to be measured. It may set the errors of the
  measured pose and velocities (``fleet.errors[i]``) and of the waypoints (``fleet.shifts[i]``), or
  what arrives at all (``fleet.arrives[i]``).

So it acts alike in rollouts, environments, benchmark and tuning. Sensor errors, wind and faults of
this package are disturbances of this kind; one of another package is a registered component
(family ``disturbance``) whose ``make`` returns a :class:`Disturber`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from steersman.config import Component, param, register
from steersman.kernels import vehicle as car
from steersman.kernels.world import Fleet, World


class Disturber:
    """One disturbance at work on a fleet; the methods here do nothing."""

    errors = False
    """Whether it sets ``fleet.errors``, which exist only if some disturbance does."""

    def begin(self, world: World, fleet: Fleet, i: int, rng: np.random.Generator) -> None:
        """A new drive of vehicle ``i`` begins; ``rng`` is the vehicle's own generator."""

    def act(self, world: World, fleet: Fleet, i: int, time: float) -> None:
        """A step of vehicle ``i`` begins at ``time`` [s]."""

    def sense(
        self, world: World, fleet: Fleet, i: int, time: float, rng: np.random.Generator
    ) -> None:
        """Vehicle ``i`` is going to be measured at ``time`` [s]."""

    def snapshot(self) -> dict[str, Any]:
        """What changes while driving, as plain data, apart from the fleet's arrays."""
        return {}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from a snapshot."""


class DisturbanceComponent(Component):
    """A disturbance as a configuration declares it."""

    @abstractmethod
    def make(self, n: int, seed: int) -> Disturber:
        """The disturbance for a fleet of ``n`` vehicles; ``seed`` is the run's."""


class _Bias(Disturber):
    errors = True

    def __init__(self, config: SensorBias) -> None:
        self._config = config

    def sense(
        self, world: World, fleet: Fleet, i: int, time: float, rng: np.random.Generator
    ) -> None:
        config, errors = self._config, fleet.errors[i]
        errors[car.VX] += config.v_x
        errors[car.VY] += config.v_y
        errors[car.YAW_RATE] += config.yaw_rate
        errors[car.PSI] += config.heading


@register("disturbance", "sensor_bias")
class SensorBias(DisturbanceComponent):
    """Constant errors of measured heading and velocities."""

    v_x: float = param(0.0, "m/s", "Added to the measured longitudinal velocity.")
    v_y: float = param(0.0, "m/s", "Added to the measured lateral velocity.")
    yaw_rate: float = param(0.0, "rad/s", "Added to the measured yaw rate.")
    heading: float = param(0.0, "rad", "Added to the measured yaw.")

    def make(self, n: int, seed: int) -> Disturber:
        """The errors at work."""
        return _Bias(self)
