"""Speed profiles: what the longitudinal controller tracks, its tables, its files."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.errors import DataError
from steersman.kernels import speed as kernel
from steersman.kernels.speed import SpeedTable
from steersman.protocols import Path
from steersman.tables import read_sheet
from steersman.types import FloatArray

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


def read_profile(file: FilePath) -> tuple[FloatArray, FloatArray]:
    """Times [s] from zero and speeds [m/s].

    Raises:
        DataError: names the file, the line and what is wrong.
    """
    needs = "needs the columns time_s and speed_m_s or speed_km_h"
    sheet = read_sheet(file, needs, lambda titles: "time_s" in titles)
    header = sheet.titles
    factors = {"speed_m_s": 1.0, "speed_km_h": 1.0 / 3.6}
    column = next((name for name in factors if name in header), None)
    if "time_s" not in header or column is None:
        raise sheet.fault(sheet.title_line, needs)
    if not sheet.rows:
        raise DataError(f"{file}: holds no breakpoints; give at least one line of numbers")
    times, speeds = sheet.numbers("time_s"), sheet.numbers(column)
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if back.size:
        raise sheet.fault(sheet.lines[back[0] + 1], "time_s must increase from line to line")
    if (speeds < 0.0).any():
        line = sheet.lines[np.flatnonzero(speeds < 0.0)[0]]
        raise sheet.fault(line, f"{column} must not be negative")
    return times - times[0], speeds * factors[column]
