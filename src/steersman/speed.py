"""The longitudinal side: constant throttle or speed, profiles from tables, curvature cap."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cache
from importlib.resources import files
from pathlib import Path as FilePath
from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from steersman.bounds import in_order
from steersman.config import Component, param, register, required
from steersman.kernels import speed as kernel
from steersman.profiles import Profile, RoadSpeed, read_ggv, read_profile, stack_profiles
from steersman.protocols import Path
from steersman.types import FloatArray

FASTEST = 150.0
"""Highest speed that may be wanted of a car [m/s]."""
# How often the driving cycle is repeated.
_CYCLES = 20
# Time for which stop and go is laid out [s].
_LONGEST = 7200.0


class SpeedComponent(Component):
    """A source of throttle and brake."""

    @abstractmethod
    def profile(self) -> Profile:
        """The demand, as the kernels read it."""

    @abstractmethod
    def start_speed(self, path: Path, s: float) -> float:
        """Speed at which a run starts at arc length ``s`` [m/s]."""

    def draw(self, rng: np.random.Generator, seconds: float) -> Profile:
        """The demand of one training episode; the same every time unless it is random."""
        return self.profile()


@register("speed", "constant_throttle")
class ConstantThrottle(SpeedComponent):
    """The throttle is held; speed is what the road makes of it."""

    throttle: float = param(0.4, "-", "Throttle position.", ge=0, le=1)
    initial: float = param(5.0, "m/s", "Speed at the start.", ge=0, le=FASTEST)

    def profile(self) -> Profile:
        """The demand, as the kernels read it."""
        zero = np.zeros(1)
        return Profile(self.throttle, zero, zero, None, 1.0)

    def start_speed(self, path: Path, s: float) -> float:
        """Speed at which a run starts [m/s]."""
        return self.initial


class SpeedTracking(SpeedComponent):
    """PI control of the speed, split into throttle (positive) and brake (negative)."""

    k_p: float = param(0.5, "s/m", "Proportional gain: pedal travel per speed error.", ge=0)
    k_i: float = param(0.3, "1/m", "Integral gain.", ge=0)
    a_lat_max: float | None = param(
        None, "m/s^2", "Cap the speed at sqrt(a_lat_max R) over the path ahead; null: off.", gt=0
    )
    deceleration: float = param(2.0, "m/s^2", "Braking that the cap reckons with.", gt=0)
    acceleration: float | None = param(
        None, "m/s^2", "Speeding up behind bends; null: as fast as the engine can.", gt=0
    )
    end: float | None = param(
        None, "m/s", "Speed to brake to at the end of an open path; null: it is not braked.", ge=0
    )

    @abstractmethod
    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """Times [s] and speeds [m/s] of the profile, linear between."""

    def along(self) -> RoadSpeed | None:
        """What limits the speed along the path, beside the cap."""
        return None if self.end is None else RoadSpeed(end=self.end, engine=self._gain())

    def _gain(self) -> float:
        return math.inf if self.acceleration is None else self.acceleration

    def profile(self) -> Profile:
        """The demand, as the kernels read it."""
        return self.demand(*self.breakpoints())

    def demand(self, times: FloatArray, speeds: FloatArray) -> Profile:
        """The demand for speeds [m/s] at times [s]."""
        demand = Profile(None, times, speeds, self.a_lat_max, self.deceleration)
        demand = demand._replace(k_p=self.k_p, k_i=self.k_i, acceleration=self._gain())
        return demand._replace(road=self.along())

    def start_speed(self, path: Path, s: float) -> float:
        """Speed at which a run starts at arc length ``s`` [m/s]."""
        table = stack_profiles([self.profile()], [path])
        return float(kernel.target_speed(table, 0, path.table, 0, 0.0, s))


@register("speed", "constant_speed")
class ConstantSpeed(SpeedTracking):
    """One speed for the whole run, which also starts at it."""

    speed: float = param(10.0, "m/s", "Speed to hold.", ge=0, le=FASTEST)

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """A single breakpoint."""
        return np.zeros(1), np.array([self.speed])


@register("speed", "stop_and_go")
class StopAndGo(SpeedTracking):
    """The car stands, drives on, holds its speed and brakes to a stop, again and again."""

    speed: float = param(10.0, "m/s", "Speed between the stops.", gt=0, le=FASTEST)
    stand: float = param(3.0, "s", "Standstill, also at the start.", gt=0)
    hold: float = param(10.0, "s", "Time at the speed.", gt=0)
    change: float = param(2.0, "m/s^2", "Acceleration, and deceleration to the stop.", gt=0)

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """Trapezoids for as long as a run may last."""
        ramp = self.speed / self.change
        corners = np.cumsum([self.stand, ramp, self.hold, ramp])
        starts = np.arange(math.ceil(_LONGEST / corners[-1])) * corners[-1]
        times = (starts[:, None] + [0.0, *corners[:3]]).ravel()
        return times, np.tile([0.0, 0.0, self.speed, self.speed], starts.size)


@register("speed", "nedc")
class Nedc(SpeedTracking):
    """New European Driving Cycle (UN R83) without its first 11 s of standstill.

    The cycle starts over when it ends, twenty times.
    """

    skip_standstill: bool = param(False, "-", "Leave out the later standstill phases too.")
    scale: float = param(1.0, "-", "Factor on all speeds.", gt=0)
    random_start: bool = param(
        False, "-", "Each training episode begins anywhere in the cycle, at the speed there."
    )

    def draw(self, rng: np.random.Generator, seconds: float) -> Profile:
        """The cycle from its beginning, or from a random moment of its first turn."""
        profile = self.profile()
        if not self.random_start:
            return profile
        times, speeds = profile.times, profile.speeds
        size = len(times) // _CYCLES
        begin = rng.uniform(0.0, times[size])
        first = int(np.searchsorted(times, begin, side="right"))
        kept = slice(first, first + len(times) - size - 1)  # always as many
        return profile._replace(
            times=np.concatenate([[0.0], times[kept] - begin]),
            speeds=np.concatenate([[np.interp(begin, times, speeds)], speeds[kept]]),
        )

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """The cycle's breakpoints from t = 11 s, repeated."""
        times, speeds = _driving_cycle()
        if self.skip_standstill:
            times, speeds = _without_standstill(times, speeds)
        period = float(times[-1]) + 1e-3
        starts = period * np.arange(_CYCLES)
        return (times + starts[:, None]).ravel(), np.tile(speeds, _CYCLES) * self.scale

    def start_speed(self, path: Path, s: float) -> float:
        """The cycle starts from standstill [m/s]."""
        return 0.0


@register("speed", "random_profile")
class RandomProfile(SpeedTracking):
    """Speeds drawn anew for each training episode; a single run drives the draw of ``seed``."""

    low: float = param(4.0, "m/s", "Lowest speed drawn.", gt=0, le=FASTEST)
    high: float = param(25.0, "m/s", "Highest speed drawn.", gt=0, le=FASTEST)
    interval: float = param(5.0, "s", "Time between breakpoints.", ge=0.1, le=1e5)
    change: float = param(2.0, "m/s^2", "Largest acceleration between breakpoints.", ge=0)
    cap_low: float = param(
        0.3, "-", "The cap's a_lat_max is scaled by a draw from here to 1.", gt=0, le=1
    )
    seed: int = param(0, "-", "Seed of a single run's draw; training draws from its own.", ge=0)
    seconds: float = param(
        60.0, "s", "Length of a single run's draw; after it the last speed is held.", gt=0, le=1e5
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        in_order(self, "low", "high", "m/s")
        return self

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """The draw of ``seed``."""
        profile = self.draw(np.random.default_rng(self.seed), self.seconds)
        return profile.times, profile.speeds

    def draw(self, rng: np.random.Generator, seconds: float) -> Profile:
        """A random walk of speeds that is kept between ``low`` and ``high``."""
        count = math.ceil(seconds / self.interval) + 1
        times = np.arange(count, dtype=np.float64) * self.interval
        speeds = np.empty(count)
        speeds[0] = rng.uniform(self.low, self.high)
        steps = rng.uniform(-self.change, self.change, count - 1) * self.interval
        for i in range(1, count):
            speeds[i] = min(max(speeds[i - 1] + steps[i - 1], self.low), self.high)
        scale = math.sqrt(rng.uniform(self.cap_low, 1.0))
        return self.demand(times, speeds)._replace(cap_scale=scale)


@cache
def _driving_cycle() -> tuple[FloatArray, FloatArray]:
    """Times [s] and speeds [m/s] of one cycle from t = 11 s; not to be written to."""
    text = files("steersman.data").joinpath("nedc.csv").read_text(encoding="utf-8")
    rows = np.array([[float(v) for v in line.split(",")] for line in text.split()[1:]])
    return rows[1:, 0] - rows[1, 0], rows[1:, 1] / 3.6


def _without_standstill(times: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shorten each phase at speed zero to 0.1 s, so that breakpoints stay increasing."""
    steps = np.diff(times)
    steps[(speeds[1:] == 0.0) & (speeds[:-1] == 0.0)] = 0.1
    return np.concatenate([[0.0], np.cumsum(steps)]), speeds


@register("speed", "csv")
class SpeedCsv(SpeedTracking):
    """A profile from a table with columns of time and speed, e.g. time_s and speed_km_h."""

    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    file: str = required("-", "CSV file with a header line.")

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """Times [s] from zero and speeds [m/s] of the file."""
        return read_profile(FilePath(self.file))


class RoadSpeedTracking(SpeedTracking):
    """Speeds that are given along the path, whatever the time."""

    top: float = param(60.0, "m/s", "Highest speed.", gt=0, le=FASTEST)

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """The highest speed at all times."""
        return np.zeros(1), np.array([self.top])


@register("speed", "path")
class PathSpeed(RoadSpeedTracking):
    """The speeds of the path's own file (``path=csv`` with a column of speeds)."""

    scale: float = param(1.0, "-", "Factor on all speeds.", gt=0)

    def along(self) -> RoadSpeed:
        """The path's speeds."""
        return RoadSpeed(end=self.end, recorded=self.scale, engine=self._gain())


@register("speed", "profile")
class SpeedProfile(RoadSpeedTracking):
    """The fastest speeds along the path that grip and engine allow.

    Forward and backward passes; ``ggv`` replaces ``a_lat_max`` and ``deceleration`` by a table.
    """

    a_lat_max: float = param(4.0, "m/s^2", "Lateral acceleration that grip allows.", gt=0)
    deceleration: float = param(
        4.0, "m/s^2", "Braking, and acceleration, that grip allows on a straight.", gt=0
    )
    acceleration: float = param(2.0, "m/s^2", "Acceleration that the engine allows.", gt=0)
    exponent: float = param(
        2.0, "-", "Shape of the grip's limit: 1 a rhombus, 2 an ellipse.", ge=1, le=100
    )
    start: float | None = param(
        None, "m/s", "Speed at the start of an open path; null: as fast as the path allows.", ge=0
    )
    ggv: FilePath | None = param(
        None, "-", "CSV file of grip over speed: v_mps, ax_max_mps2, ay_max_mps2."
    )

    def along(self) -> RoadSpeed:
        """Limits of grip and engine."""
        grip = None if self.ggv is None else read_ggv(self.ggv)
        return RoadSpeed(
            end=self.end,
            start=self.start,
            engine=self.acceleration,
            exponent=self.exponent,
            grip=grip,
        )
