"""What disturbs the vehicles of a world: the one interface, and the components of other packages.

A disturbance alters arrays of the fleet between the compiled steps, at two moments of each step:

- ``act``: the step begins. It may alter the vehicle's parameters (``world.vehicles.rows[i]``:
  friction, side force, ...) and what the steering actuator takes (``fleet.bounds[i]``).
- ``sense``: what is observed after the step is about to be measured. It may set the errors of the
  measured pose and velocities (``fleet.errors[i]``, columns of a state row) and of the waypoints
  (``fleet.shifts[i]``), or what arrives at all (``fleet.arrives[i]``).

So it acts alike in rollouts, environments, benchmark and tuning. Sensor errors, wind and faults of
this package are disturbances of this kind; one of another package is a registered component
(family ``disturbance``) whose ``make`` returns a :class:`Disturber`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from steersman.config import Component, param, register
from steersman.kernels import observe
from steersman.kernels import vehicle as car
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.world import DROPPED
from steersman.types import FloatArray


class Disturber:
    """One disturbance at work on a fleet; the methods here do nothing."""

    errors = False
    """Whether it sets ``fleet.errors``, which exist only if some disturbance does."""
    on_vehicle = False
    """Whether it alters the vehicle's parameters, which only plants that are computed here take."""

    def begin(self, world: World, fleet: Fleet, i: int, rng: np.random.Generator) -> None:
        """A new drive of vehicle ``i`` begins; ``rng`` is the vehicle's own generator."""

    def act(self, world: World, fleet: Fleet, i: int, time: float) -> None:
        """A step of vehicle ``i`` begins at ``time`` [s]."""

    def sense(
        self, world: World, fleet: Fleet, i: int, time: float, rng: np.random.Generator
    ) -> None:
        """Vehicle ``i`` is going to be measured at ``time`` [s]."""

    def sense_each(
        self,
        world: World,
        fleet: Fleet,
        chosen: Sequence[int],
        times: FloatArray,
        rngs: Sequence[np.random.Generator],
    ) -> None:
        """These vehicles are going to be measured at ``times`` [s], one for each of them.

        To be written instead of :meth:`sense` where all at once are cheaper than one by one.
        ``rngs`` are the generators of all vehicles.
        """
        for i, time in zip(chosen, times.tolist(), strict=True):
            self.sense(world, fleet, i, time, rngs[i])

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

    def friction(self, s: float) -> tuple[float, float]:
        """Factors on the friction under left and right wheels at arc length ``s`` [m]."""
        return 1.0, 1.0


# Columns of ``fleet.errors`` that a bias adds to, in the order of its values.
_BIASED = np.array([observe.V_X_SCALE, car.VX, car.VY, car.YAW_RATE, car.PSI])


class _Bias(Disturber):
    errors = True

    def __init__(self, config: SensorBias, n: int) -> None:
        values = config.v_x_scale, config.v_x, config.v_y, config.yaw_rate, config.heading
        self._values, self._drawn = np.array(values), config.drawn
        self._own = np.tile(self._values, (n, 1))

    def begin(self, world: World, fleet: Fleet, i: int, rng: np.random.Generator) -> None:
        factors = rng.uniform(-1.0, 1.0, self._values.size) if self._drawn else 1.0
        self._own[i] = fleet.levels[i] * (factors * self._values)

    def sense_each(
        self,
        world: World,
        fleet: Fleet,
        chosen: Sequence[int],
        times: FloatArray,
        rngs: Sequence[np.random.Generator],
    ) -> None:
        fleet.errors[np.array(chosen)[:, None], _BIASED] += self._own[chosen]

    def snapshot(self) -> dict[str, Any]:
        return {"own": self._own}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self._own[:] = saved["own"]


@register("disturbance", "sensor_bias")
class SensorBias(DisturbanceComponent):
    """Constant errors of measured heading and velocities."""

    v_x: float = param(0.0, "m/s", "Added to the measured longitudinal velocity.")
    v_x_scale: float = param(
        0.0, "-", "So is this times the true one: a wrong rolling radius.", gt=-1, lt=1
    )
    v_y: float = param(0.0, "m/s", "Added to the measured lateral velocity.")
    yaw_rate: float = param(0.0, "rad/s", "Added to the measured yaw rate.")
    heading: float = param(0.0, "rad", "Added to the measured yaw.")
    drawn: bool = param(
        False, "-", "Each drive draws its errors, uniformly from minus to plus the values."
    )

    def make(self, n: int, seed: int) -> Disturber:
        """The errors at work."""
        return _Bias(self, n)


class _Drift(Disturber):
    errors = True

    def __init__(self, config: PositionDrift, n: int) -> None:
        self._config, self._now = config, np.zeros((n, 2))

    def begin(self, world: World, fleet: Fleet, i: int, rng: np.random.Generator) -> None:
        self._now[i] = rng.normal(0.0, self._config.deviation, 2)

    def sense(
        self, world: World, fleet: Fleet, i: int, time: float, rng: np.random.Generator
    ) -> None:
        if time > 0.0:
            keep = math.exp(-world.dt / self._config.time)
            spread = self._config.deviation * math.sqrt(1.0 - keep * keep)
            self._now[i] = keep * self._now[i] + rng.normal(0.0, spread, 2)
        fleet.errors[i, [car.X, car.Y]] += fleet.levels[i] * self._now[i]

    def snapshot(self) -> dict[str, Any]:
        return {"now": self._now}

    def restore(self, saved: Mapping[str, Any]) -> None:
        self._now[:] = saved["now"]


@register("disturbance", "position_drift")
class PositionDrift(DisturbanceComponent):
    """Slow error of the measured position, in x and in y, as of satellite navigation.

    A first-order Gauss-Markov process (Groves, Principles of GNSS, Inertial, and Multisensor
    Integrated Navigation Systems, 2nd ed., app. B.4): e_k+1 = e_k exp(-dt / time) + w_k, with
    the stationary deviation from the start on.
    """

    deviation: float = param(0.2, "m", "SD in x and in y.", ge=0)
    time: float = param(10.0, "s", "Correlation time.", gt=0)

    def make(self, n: int, seed: int) -> Disturber:
        """The error at work."""
        return _Drift(self, n)


class _Dropouts(Disturber):
    def __init__(self, config: Dropouts) -> None:
        self._share = config.share

    def sense(
        self, world: World, fleet: Fleet, i: int, time: float, rng: np.random.Generator
    ) -> None:
        if time > 0.0 and rng.uniform() < self._share * fleet.levels[i]:
            fleet.arrives[i] = DROPPED


@register("disturbance", "dropouts")
class Dropouts(DisturbanceComponent):
    """Observations get lost, each on its own; the last one is there again, with its own time."""

    share: float = param(0.05, "-", "Share of the observations that get lost.", ge=0, lt=1)

    def make(self, n: int, seed: int) -> Disturber:
        """The losses at work."""
        return _Dropouts(self)


class _Patch(Disturber):
    on_vehicle = True

    def __init__(self, config: FrictionPatch) -> None:
        self._config = config

    def act(self, world: World, fleet: Fleet, i: int, time: float) -> None:
        left, right = self._config.friction(float(fleet.tracking[i, observe.S]))
        row = world.vehicles.rows[i]
        row[car.GRIP_LEFT] *= left
        row[car.GRIP_RIGHT] *= right


@register("disturbance", "friction_patch")
class FrictionPatch(DisturbanceComponent):
    """A length of road with other friction, on one side or on both: a wet patch, ice at the edge.

    Several of them multiply where they overlap. Controllers compute with the vehicle's friction.
    """

    begin: float = param(10.0, "m", "Arc length at which it begins.", ge=0)
    length: float = param(20.0, "m", "How long it is.", gt=0)
    every: float | None = param(
        None, "m", "Distance from one to the next; null: there is one.", gt=0
    )
    left: float = param(0.5, "-", "Factor on the friction under the left wheels.", gt=0)
    right: float = param(0.5, "-", "Factor on the friction under the right wheels.", gt=0)

    def covers(self, s: float) -> bool:
        """Whether the road at arc length ``s`` [m] is part of it."""
        since = s - self.begin
        if self.every is not None and since >= 0.0:
            since %= self.every
        return 0.0 <= since < self.length

    def friction(self, s: float) -> tuple[float, float]:
        """The factors where the road at arc length ``s`` [m] is part of it."""
        return (self.left, self.right) if self.covers(s) else (1.0, 1.0)

    def make(self, n: int, seed: int) -> Disturber:
        """The patch under the vehicles."""
        return _Patch(self)
