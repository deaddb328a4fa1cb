"""Side wind in gusts, drawn from a seed.

Sources: "1 - cosine" shape of a gust, IEC 61400-1; side force and yaw moment of a car in side
wind, Hucho (ed.), *Aerodynamics of Road Vehicles*, 4th ed., ch. 5: for flow angles that occur both
are about proportional to the angle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from steersman.config import Settings, param
from steersman.disturbances import Disturber
from steersman.kernels import vehicle as car
from steersman.kernels.fleet import Fleet, World

_AIR_DENSITY = 1.2


class Wind(Settings):
    """Gusts across the vehicle, from either side, one after the other with pauses between."""

    speed: float = param(0.0, "m/s", "Strongest gust; each has half of it or more. 0: calm.", ge=0)
    gust: tuple[float, float] = param((1.0, 4.0), "s", "Shortest and longest gust.")
    pause: float = param(2.0, "s", "Mean time between gusts.", gt=0)
    area: float = param(2.22, "m^2", "Frontal area of the car.", gt=0)
    side: float = param(2.0, "1/rad", "Side-force coefficient per angle of the flow.", ge=0)
    arm: float = param(0.4, "m", "Centre of pressure ahead of the centre of mass.")
    seed: int = param(0, "-", "Decides when and how strong.", ge=0)

    def figures(self) -> tuple[float, float]:
        """Side force over flow angle and squared speed [N s^2/m^2], and its arm [m]."""
        return 0.5 * _AIR_DENSITY * self.area * self.side, self.arm

    def load(self, wind: float, v_x: float) -> tuple[float, float]:
        """Side force [N] (left positive) and yaw moment [N m] of a wind [m/s] to the left."""
        pressure = 0.5 * _AIR_DENSITY * (v_x * v_x + wind * wind)
        force = pressure * self.area * self.side * math.atan2(wind, abs(v_x))
        return force, force * self.arm

    def make(self, n: int, seed: int) -> Disturber | None:
        """The wind at work on a world; None where it is calm."""
        return Gusts(self, n) if self.speed > 0.0 else None


class Gusts(Disturber):
    """The wind over time, for each vehicle its own; a new drive begins with a pause."""

    def __init__(self, wind: Wind, n: int) -> None:
        """For ``n`` vehicles; the first one's is that of a run with one vehicle."""
        self._wind = wind
        seeds: list[list[int]] = [[wind.seed, i] if i else [wind.seed] for i in range(n)]
        self._rngs = [np.random.default_rng(seed) for seed in seeds]
        self._gusts = np.zeros((n, 3))

    def begin(self, world: World, fleet: Fleet, i: int, rng: np.random.Generator) -> None:
        """Draw the first gust of a drive."""
        self.restart(i)

    def restart(self, i: int) -> None:
        """Begin with a pause."""
        self._gusts[i] = 0.0
        self._next(i)

    def _next(self, i: int) -> None:
        rng, wind, gust = self._rngs[i], self._wind, self._gusts[i]
        gust[0] = gust[1] + rng.exponential(wind.pause)
        gust[1] = gust[0] + rng.uniform(*wind.gust)
        side = 1.0 if rng.uniform() < 0.5 else -1.0  # noqa: PLR2004 - either side
        gust[2] = side * wind.speed * rng.uniform(0.5, 1.0)

    def at(self, i: int, time: float) -> float:
        """Wind to the left that meets vehicle ``i`` at a time [m/s]; times must increase."""
        while time >= self._gusts[i, 1]:
            self._next(i)
        start, end, strength = self._gusts[i].tolist()
        if time <= start:
            return 0.0
        phase = (time - start) / (end - start)
        return float(0.5 * strength * (1.0 - math.cos(math.tau * phase)))

    def act(self, world: World, fleet: Fleet, i: int, time: float) -> None:
        """Load the vehicle with the wind that blows at the step's beginning."""
        row = world.vehicles.rows[i]
        force, moment = self._wind.load(self.at(i, time), float(fleet.state[i, car.VX]))
        row[car.SIDE_FORCE] += force
        row[car.YAW_MOMENT] += moment

    def snapshot(self) -> dict[str, Any]:
        """The gusts under way and the generators."""
        return {
            "gusts": self._gusts,
            "generators": [rng.bit_generator.state for rng in self._rngs],
        }

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from a snapshot."""
        self._gusts[:] = saved["gusts"]
        for rng, state in zip(self._rngs, saved["generators"], strict=True):
            rng.bit_generator.state = state
