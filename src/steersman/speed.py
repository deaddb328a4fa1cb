"""The longitudinal side: constant throttle or speed, profiles from tables, curvature cap."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from steersman.config import Component, param, register, required
from steersman.errors import ConfigError, DataError
from steersman.kernels import speed as kernel
from steersman.kernels.speed import SpeedTable
from steersman.protocols import Path
from steersman.types import FloatArray, VehicleState

CAP_STEP = 1.0
_NO_CAP = np.zeros(0)


class Profile(NamedTuple):
    """Longitudinal demand: a constant throttle, or speed over time."""

    throttle: float | None
    times: FloatArray
    speeds: FloatArray
    a_lat_max: float | None
    deceleration: float
    k_p: float = 0.0
    k_i: float = 0.0
    cap_scale: float = 1.0


class SpeedState(NamedTuple):
    """What the longitudinal controller carries from step to step."""

    table: SpeedTable
    path: Path
    integral: float
    dt: float


def curvature_cap(path: Path, a_lat_max: float | None, deceleration: float) -> FloatArray:
    """Speed limits every metre along a path [m/s].

    At each place sqrt(a_lat_max / |kappa|), lowered ahead of corners so that braking with
    ``deceleration`` [m/s^2] suffices. Empty without a limit.
    """
    if a_lat_max is None:
        return _NO_CAP
    count = math.ceil(path.length / CAP_STEP) + 1
    kappa = np.array([abs(path.at(min(i * CAP_STEP, path.length)).kappa) for i in range(count)])
    limit: FloatArray = np.sqrt(a_lat_max / np.maximum(kappa, 1e-4))
    for _ in range(2 if path.closed else 1):
        for i in range(count - 2, -1, -1):
            reach = math.sqrt(limit[i + 1] ** 2 + 2.0 * deceleration * CAP_STEP)
            limit[i] = min(limit[i], reach)
        if path.closed:
            limit[-1] = min(limit[-1], limit[0])
    return limit


def stack_profiles(profiles: list[Profile], paths_: list[Path]) -> SpeedTable:
    """One table for vehicles with a profile each, over a bank of paths.

    The curvature cap is that of the first profile: it belongs to the road, not to the vehicle.
    """
    width = max(len(p.times) for p in profiles)
    n = len(profiles)
    rows = np.zeros((n, kernel.N_COLUMNS))
    times, speeds = np.zeros((n, width)), np.zeros((n, width))
    for i, profile in enumerate(profiles):
        write_profile(profile, i, rows, times, speeds)
    caps = [curvature_cap(p, profiles[0].a_lat_max, profiles[0].deceleration) for p in paths_]
    first = np.cumsum([0, *(len(c) for c in caps[:-1])]).astype(np.int64)
    return SpeedTable(rows, times, speeds, np.concatenate(caps), first, CAP_STEP)


def write_profile(
    profile: Profile, i: int, rows: FloatArray, times: FloatArray, speeds: FloatArray
) -> None:
    """Put a profile into row ``i`` of a table; unused breakpoints repeat the last speed."""
    tracks = profile.throttle is None
    rows[i] = (
        float(tracks),
        profile.throttle or 0.0,
        profile.k_p,
        profile.k_i,
        profile.cap_scale,
    )
    k = len(profile.times)
    times[i, :k], speeds[i, :k] = profile.times, profile.speeds
    times[i, k:] = profile.times[-1] + 1.0 + np.arange(times.shape[1] - k)
    speeds[i, k:] = profile.speeds[-1]


class SpeedComponent(Component):
    """A source of throttle and brake."""

    def profile(self) -> Profile:
        """The demand, as the kernels read it."""
        raise NotImplementedError

    def start_speed(self, path: Path, s: float) -> float:
        """Speed at which a run starts at arc length ``s`` [m/s]."""
        raise NotImplementedError

    def draw(self, rng: np.random.Generator, seconds: float) -> Profile:
        """The demand of one training episode; the same every time unless it is random."""
        return self.profile()

    def init(self, path: Path, dt: float, start: VehicleState) -> SpeedState:
        """State before the first step; the integral starts at the pedals of the steady turn."""
        table = stack_profiles([self.profile()], [path])
        return SpeedState(table, path, start.throttle - start.brake, dt)

    def step(
        self, state: SpeedState, vehicle: VehicleState, s: float
    ) -> tuple[float, float, SpeedState]:
        """Throttle and brake, each in [0, 1], for the vehicle at arc length ``s``."""
        v = float(np.hypot(vehicle.v_x, vehicle.v_y))
        throttle, brake, integral = kernel.pedals(
            state.table, 0, state.path.table, 0, vehicle.time, s, v, state.integral, state.dt
        )
        return throttle, brake, state._replace(integral=integral)


@register("speed", "constant_throttle")
class ConstantThrottle(SpeedComponent):
    """The throttle is held; speed is what the road makes of it."""

    throttle: float = param(0.4, "-", "Throttle position.", ge=0, le=1)
    initial: float = param(5.0, "m/s", "Speed at the start.", ge=0)

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

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """Times [s] and speeds [m/s] of the profile, linear between."""
        raise NotImplementedError

    def profile(self) -> Profile:
        """The demand, as the kernels read it."""
        times, speeds = self.breakpoints()
        return Profile(None, times, speeds, self.a_lat_max, self.deceleration, self.k_p, self.k_i)

    def start_speed(self, path: Path, s: float) -> float:
        """Speed at which a run starts at arc length ``s`` [m/s]."""
        table = stack_profiles([self.profile()], [path])
        return float(kernel.target_speed(table, 0, path.table, 0, 0.0, s))


@register("speed", "constant_speed")
class ConstantSpeed(SpeedTracking):
    """One speed for the whole run, which also starts at it."""

    speed: float = param(10.0, "m/s", "Speed to hold.", ge=0)

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """A single breakpoint."""
        return np.zeros(1), np.array([self.speed])


@register("speed", "nedc")
class Nedc(SpeedTracking):
    """New European Driving Cycle (UN R83) without its first 11 s of standstill.

    The cycle starts over when it ends, twenty times.
    """

    skip_standstill: bool = param(False, "-", "Leave out the later standstill phases too.")
    scale: float = param(1.0, "-", "Factor on all speeds.", gt=0)

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """The cycle's breakpoints from t = 11 s, repeated."""
        text = files("steersman.data").joinpath("nedc.csv").read_text(encoding="utf-8")
        rows = np.array([[float(v) for v in line.split(",")] for line in text.split()[1:]])
        times, speeds = rows[1:, 0] - rows[1, 0], rows[1:, 1] / 3.6
        if self.skip_standstill:
            times, speeds = _without_standstill(times, speeds)
        period = float(times[-1]) + 1e-3
        all_times = np.concatenate([times + k * period for k in range(20)])
        return all_times, np.tile(speeds, 20) * self.scale

    def start_speed(self, path: Path, s: float) -> float:
        """The cycle starts from standstill [m/s]."""
        return 0.0


@register("speed", "random_profile")
class RandomProfile(SpeedTracking):
    """Speeds drawn anew for each training episode; a single run drives one draw of seed 0."""

    low: float = param(4.0, "m/s", "Lowest speed drawn.", gt=0)
    high: float = param(25.0, "m/s", "Highest speed drawn.", gt=0)
    interval: float = param(5.0, "s", "Time between breakpoints.", gt=0)
    change: float = param(2.0, "m/s^2", "Largest acceleration between breakpoints.", ge=0)
    cap_low: float = param(
        0.3, "-", "The cap's a_lat_max is scaled by a draw from here to 1.", gt=0, le=1
    )

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """One draw."""
        profile = self.draw(np.random.default_rng(0), 60.0)
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
        return Profile(
            None,
            times,
            speeds,
            self.a_lat_max,
            self.deceleration,
            self.k_p,
            self.k_i,
            scale,
        )


def _without_standstill(times: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shorten each phase at speed zero to 0.1 s, so that breakpoints stay increasing."""
    steps = np.diff(times)
    steps[(speeds[1:] == 0.0) & (speeds[:-1] == 0.0)] = 0.1
    return np.concatenate([[0.0], np.cumsum(steps)]), speeds


@register("speed", "csv")
class SpeedCsv(SpeedTracking):
    """A profile from a CSV file with the columns time_s and speed_m_s (or speed_km_h)."""

    file: str = required("-", "CSV file with a header line.")

    def breakpoints(self) -> tuple[FloatArray, FloatArray]:
        """Times [s] from zero and speeds [m/s] of the file."""
        return read_profile(FilePath(self.file))


def read_profile(file: FilePath) -> tuple[FloatArray, FloatArray]:
    """Times [s] from zero and speeds [m/s].

    Raises:
        DataError: names the file, the line and what is wrong.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise DataError(f"{file}: cannot be read ({reason})") from None
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    factors = {"speed_m_s": 1.0, "speed_km_h": 1.0 / 3.6}
    column = next((name for name in factors if name in header), None)
    if "time_s" not in header or column is None:
        raise DataError(f"{file}, line 1: needs the columns time_s and speed_m_s or speed_km_h")
    filled = [(i, line) for i, line in enumerate(lines[1:], start=2) if line.strip()]
    rows = [_numbers(file, i, line, len(header)) for i, line in filled]
    if not rows:
        raise DataError(f"{file}: holds no breakpoints; give at least one line of numbers")
    data = np.array(rows)
    times, speeds = data[:, header.index("time_s")], data[:, header.index(column)]
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if back.size:
        raise DataError(
            f"{file}, line {filled[back[0] + 1][0]}: time_s must increase from line to line"
        )
    if (speeds < 0.0).any():
        line = filled[np.flatnonzero(speeds < 0.0)[0]][0]
        raise DataError(f"{file}, line {line}: {column} must not be negative")
    return times - times[0], speeds * factors[column]


def _numbers(file: FilePath, line: int, text: str, count: int) -> list[float]:
    cells = text.split(",")
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        raise DataError(f"{file}, line {line}: not numbers: {text.strip()!r}") from None
    if len(values) != count or not np.isfinite(values).all():
        raise DataError(f"{file}, line {line}: needs {count} finite numbers, has {text.strip()!r}")
    return values


def check_profile(component: Any) -> SpeedComponent:
    """The component itself, if it is a source of speed.

    Raises:
        ConfigError: it is something else.
    """
    if not isinstance(component, SpeedComponent):
        raise ConfigError(f"{component!r} is not a source of speed")
    return component
