"""Side wind in gusts, drawn from a seed.

Sources: "1 - cosine" shape of a gust, IEC 61400-1; side force and yaw moment of a car in side
wind, Hucho (ed.), *Aerodynamics of Road Vehicles*, 4th ed., ch. 5: for flow angles that occur both
are about proportional to the angle.
"""

from __future__ import annotations

import math

import numpy as np

from steersman.config import Settings, param

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

    def load(self, wind: float, v_x: float) -> tuple[float, float]:
        """Side force [N] (left positive) and yaw moment [N m] of a wind [m/s] to the left."""
        pressure = 0.5 * _AIR_DENSITY * (v_x * v_x + wind * wind)
        force = pressure * self.area * self.side * math.atan2(wind, abs(v_x))
        return force, force * self.arm


class Gusts:
    """The wind over time; asked for increasing times."""

    def __init__(self, wind: Wind) -> None:
        """Begin with a pause."""
        self._wind = wind
        self._rng = np.random.default_rng(wind.seed)
        self._start = self._end = 0.0
        self._strength = 0.0
        self._next()

    def _next(self) -> None:
        rng, wind = self._rng, self._wind
        self._start = self._end + float(rng.exponential(wind.pause))
        self._end = self._start + float(rng.uniform(*wind.gust))
        side = 1.0 if rng.uniform() < 0.5 else -1.0  # noqa: PLR2004 - either side
        self._strength = side * wind.speed * float(rng.uniform(0.5, 1.0))

    def at(self, time: float) -> float:
        """Wind to the left at a time [m/s]."""
        while time >= self._end:
            self._next()
        if time <= self._start:
            return 0.0
        phase = (time - self._start) / (self._end - self._start)
        return 0.5 * self._strength * (1.0 - math.cos(math.tau * phase))
