"""Speed profiles: what the longitudinal controller tracks, its tables, its files."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.columns import find
from steersman.errors import ConfigError, DataError
from steersman.kernels import speed as kernel
from steersman.kernels.speed import SpeedTable
from steersman.kernels.speed_profile import brake_ahead, curvatures, fastest, gain_ahead
from steersman.logs.columns import SIGNALS
from steersman.paths.points import COLUMNS as PATH_COLUMNS
from steersman.protocols import Path
from steersman.tables import Sheet, read_sheet
from steersman.types import FloatArray

CAP_STEP = 1.0
# A car that is to stop at the end of a path drives the last bit before at this speed [m/s], so long
# a bit [m].
CRAWL, CRAWLED = 0.3, 0.35
# No limit, as a speed [m/s] or an acceleration [m/s^2].
_CEILING = 1e3
# Steps are so much longer than a whole fraction of the path that none is left over by rounding.
_LONGER = 1.0 + 1e-12
_NO_CAP = np.zeros(0)
# Of a profile's file.
_COLUMNS = {"time": SIGNALS["time"], "speed": PATH_COLUMNS["speed"]}
_NEEDS = "needs the columns time and speed, e.g. time_s and speed_m_s or speed_km_h"


class RoadSpeed(NamedTuple):
    """What limits the speed along a path, beside a_lat_max and deceleration."""

    end: float | None = None
    """Speed at the end of an open path [m/s]."""
    start: float | None = None
    """Speed at its start [m/s]."""
    recorded: float | None = None
    """Factor on the path's own speeds, which are limits [-]; None: they are not."""
    engine: float = math.inf
    """Largest acceleration of the engine [m/s^2]."""
    exponent: float = math.inf
    """How acceleration along and across share the grip, see ``kernels.speed_profile``."""
    grip: FloatArray | None = None
    """Rows of speed [m/s], acceleration along and across [m/s^2] instead of a_lat_max and
    deceleration."""

    @property
    def stops(self) -> bool:
        """Whether the car is to stand at the end of an open path."""
        return self.end == 0.0


class Profile(NamedTuple):
    """Longitudinal demand: a constant throttle, or speed over time and along the path.

    Where ``road`` is given, its engine limits the acceleration, and ``acceleration`` does not.
    """

    throttle: float | None
    times: FloatArray
    speeds: FloatArray
    a_lat_max: float | None
    deceleration: float
    k_p: float = 0.0
    k_i: float = 0.0
    cap_scale: float = 1.0
    road: RoadSpeed | None = None
    acceleration: float = math.inf


def curvature_cap(
    path: Path, a_lat_max: float | None, deceleration: float, acceleration: float = math.inf
) -> FloatArray:
    """Speed limits every metre along a path [m/s].

    At each place sqrt(a_lat_max / |kappa|), lowered ahead of corners so that braking with
    ``deceleration`` [m/s^2] suffices, and behind them so that the car speeds up by at most
    ``acceleration`` [m/s^2]. Empty without a limit.
    """
    if a_lat_max is None:
        return _NO_CAP
    count = math.ceil(path.length / CAP_STEP) + 1
    kappa = np.empty(count)
    curvatures(path.table, 0, CAP_STEP, path.length, kappa)
    limit: FloatArray = np.sqrt(a_lat_max / np.maximum(np.abs(kappa), 1e-4))
    brake_ahead(path.table, 0, 2.0 * deceleration * CAP_STEP, limit)
    gain_ahead(path.table, 0, 2.0 * acceleration * CAP_STEP, limit)
    return limit


def road_limits(path: Path, profile: Profile) -> tuple[FloatArray, float]:
    """Speed limits along a path [m/s], and the distance between two, at most 1 m.

    Raises:
        ConfigError: the path's own speeds are wanted, and it has none.
    """
    road = profile.road
    if road is None:
        limits = profile.a_lat_max, profile.deceleration, profile.acceleration
        return curvature_cap(path, *limits), CAP_STEP
    step, places = _places(path, road)
    kappa = np.empty(len(places))
    curvatures(path.table, 0, step, math.inf if path.closed else path.length, kappa)
    limit = np.full(len(places), _CEILING)
    if not path.closed:
        limit[0] = _CEILING if road.start is None else max(road.start, CRAWL)
        limit[-1] = _CEILING if road.end is None else max(road.end, CRAWL)
        if road.stops:
            limit[places >= path.length - CRAWLED] = CRAWL
    across = _CEILING if profile.a_lat_max is None else profile.a_lat_max
    grip = np.array([[0.0, profile.deceleration, across]])
    if road.grip is not None:
        grip = road.grip
    fastest(grip, road.exponent, road.engine, kappa, step, path.closed, limit)
    if road.recorded is not None:
        known = path.speeds()
        if known is None:
            raise ConfigError(
                "path has no speeds along the path; path=csv has them if its file has a column "
                "v, speed, velocity or vx_mps [m/s]",
                ("speed",),
            )
        period = path.length if path.closed else None
        own = road.recorded * np.interp(places, *known, period=period)
        limit = np.minimum(limit, own)
        gain_ahead(path.table, 0, 2.0 * road.engine * step, limit)
    return np.maximum(limit, CRAWL), step


def _places(path: Path, road: RoadSpeed) -> tuple[float, FloatArray]:
    """Arc lengths of the limits along a path [m], the last at its end or behind, and their step.

    Where the car is to stop, one of them is where it is slow.
    """
    length = path.length
    slow = max(length - CRAWLED, 0.5 * length) if road.stops and not path.closed else length
    count = max(math.ceil(slow / CAP_STEP), 1)
    step = slow / count * _LONGER
    return step, step * np.arange(math.ceil(length / step) + 1, dtype=np.float64)


def stack_profiles(profiles: list[Profile], paths_: list[Path]) -> SpeedTable:
    """One table for vehicles with a profile each, over a bank of paths.

    The limits along the paths are those of the first profile: they belong to the road, not to the
    vehicle.

    Raises:
        ConfigError: a path's own speeds are wanted, and it has none.
    """
    width = max(len(p.times) for p in profiles)
    n = len(profiles)
    rows = np.zeros((n, kernel.N_COLUMNS))
    times, speeds = np.zeros((n, width)), np.zeros((n, width))
    for i, profile in enumerate(profiles):
        write_profile(profile, i, rows, times, speeds)
    limits = [road_limits(p, profiles[0]) for p in paths_]
    caps = [cap for cap, _ in limits]
    first = np.cumsum([0, *(len(c) for c in caps[:-1])]).astype(np.int64)
    steps = np.array([step for _, step in limits])
    even = profiles[0].road is not None
    return SpeedTable(rows, times, speeds, np.concatenate(caps), first, steps, even)


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
        float(profile.road is not None and profile.road.stops),
    )
    write_points(profile.times, profile.speeds, times[i], speeds[i])


def write_points(
    times: FloatArray, speeds: FloatArray, to_times: FloatArray, to_speeds: FloatArray
) -> None:
    """Put breakpoints into rows of a table; unused ones repeat the last speed."""
    k = len(times)
    to_times[:k], to_speeds[:k] = times, speeds
    to_times[k:] = times[-1] + 1.0 + np.arange(len(to_times) - k)
    to_speeds[k:] = speeds[-1]


def read_profile(file: FilePath) -> tuple[FloatArray, FloatArray]:
    """Times [s] from zero and speeds [m/s].

    Raises:
        DataError: names the file, the line and what is wrong.
    """

    def is_header(titles: list[str]) -> bool:
        return _COLUMNS.keys() <= find(Sheet(file, titles, 0, [], []), _COLUMNS).keys()

    sheet = read_sheet(file, _NEEDS, is_header)
    found = find(sheet, _COLUMNS)
    if found.keys() < _COLUMNS.keys():
        along = "; speeds along a path are speed=path, with this file as path.file"
        raise sheet.fault(sheet.title_line, _NEEDS + along * ("speed" in found))
    if not sheet.rows:
        raise DataError(f"{file}: holds no breakpoints; give at least one line of numbers")
    times, speeds = (found[k].factor * sheet.numbers(found[k].place) for k in ("time", "speed"))
    title = {name: sheet.titles[column.place] for name, column in found.items()}
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if back.size:
        line = sheet.lines[back[0] + 1]
        raise sheet.fault(line, f"{title['time']} must increase from line to line")
    if (speeds < 0.0).any():
        line = sheet.lines[np.flatnonzero(speeds < 0.0)[0]]
        raise sheet.fault(line, f"{title['speed']} must not be negative")
    return times - times[0], speeds


def read_ggv(file: FilePath) -> FloatArray:
    """Grip over speed: rows of speed [m/s], acceleration along and across [m/s^2].

    Raises:
        DataError: names the file, the line and what is wrong.
    """
    names = ("v_mps", "ax_max_mps2", "ay_max_mps2")
    needs = f"needs the columns {', '.join(names)}"
    sheet = read_sheet(file, needs, lambda titles: set(names) <= set(titles))
    if not set(names) <= set(sheet.titles):
        raise sheet.fault(sheet.title_line, needs)
    table = np.stack([sheet.numbers(name) for name in names], axis=1)
    if not len(table):
        raise DataError(f"{file}: holds no rows; give at least one line of numbers")
    wrong = np.flatnonzero((np.diff(table[:, 0], prepend=-1.0) <= 0.0) | (table < 0.0).any(axis=1))
    wrong = np.union1d(wrong, np.flatnonzero((table[:, 1:] == 0.0).any(axis=1)))
    if wrong.size:
        text = "v_mps must increase from line to line, and accelerations be above 0"
        raise sheet.fault(sheet.lines[int(wrong[0])], text)
    return table
