"""Throttle and brake: constant, or a PI controller on a speed profile capped by the road."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from steersman.kernels import path as paths
from steersman.kernels.compiled import kernel
from steersman.kernels.path import PathTable
from steersman.kernels.vehicle import interpolate
from steersman.types import FloatArray

# Columns of SpeedTable.rows.
IS_PROFILE, CONSTANT_THROTTLE, K_P, K_I, CAP_SCALE, STOPS = range(6)
N_COLUMNS = 6
# A car that is to stand at the end of a path presses the brake so far before it [m], so far [-].
_HOLD, _HOLD_BRAKE = 0.12, 0.5
# It stands at the end if it is at most so far from it [m], at no more than this speed [m/s].
AT_END, STANDING = 0.2, 0.01
# It brakes so early, since the pedals follow late [s].
_LEAD = 0.5


class SpeedTable(NamedTuple):
    """Longitudinal control of N vehicles."""

    rows: FloatArray
    """(N, 6): 1 to track the profile else 0, constant throttle, gains, factor on the cap, 1 to
    stand at the end of an open path else 0."""
    times: FloatArray
    """(N, K) times of the profile's breakpoints [s], increasing."""
    speeds: FloatArray
    """(N, K) target speeds there [m/s], linear between."""
    cap: FloatArray
    """Speed limits along the paths behind each other [m/s]; empty: none."""
    cap_first: Any
    """(P,) int64: where each path's limits start in ``cap``."""
    cap_step: FloatArray
    """(P,) distance between the limits of each path [m]."""
    even: bool
    """Whether the acceleration, else the slope of the speed, is constant between limits."""


@kernel
def target_speed(
    speed: SpeedTable, n: int, table: PathTable, p: int, time: float, s: float
) -> float:
    """Target speed at a time and place [m/s]."""
    target = interpolate(speed.times[n], speed.speeds[n], time)
    if speed.cap.shape[0] > 0:
        target = min(target, speed.rows[n, CAP_SCALE] * road_limit(speed, table, p, s))
    return 0.0 if _is_held(speed, n, table, p, s) else target


@kernel
def stops(speed: SpeedTable, n: int, table: PathTable, p: int) -> bool:
    """Whether vehicle ``n`` is to stand at the end of path ``p``."""
    return bool(speed.rows[n, STOPS] > 0.0 and table.meta[p, paths.CLOSED] == 0.0)


@kernel
def _is_held(speed: SpeedTable, n: int, table: PathTable, p: int, s: float) -> bool:
    """Whether vehicle ``n`` is so near the end of path ``p`` that it is to stand."""
    return stops(speed, n, table, p) and s >= table.meta[p, paths.LENGTH] - _HOLD


@kernel
def road_limit(speed: SpeedTable, table: PathTable, p: int, s: float) -> float:
    """Limit along the path at a place [m/s], where there are limits."""
    first = int(speed.cap_first[p])
    step = speed.cap_step[p]
    last = first + int(math.ceil(table.meta[p, paths.LENGTH] / step))
    i = first + int(max(s, 0.0) / step)
    w = max(s, 0.0) / step - (i - first)
    low, high = speed.cap[min(i, last)], speed.cap[min(i + 1, last)]
    if speed.even:
        return math.sqrt(low * low + w * (high * high - low * low))
    return float(low + w * (high - low))


@kernel
def wishes(
    speed: SpeedTable,
    n: int,
    table: PathTable,
    p: int,
    time: float,
    s: float,
    spacing: float,
    out: FloatArray,
) -> None:
    """Write the target speeds [m/s] of this time at places ``spacing`` apart [m] from ``s`` on.

    A vehicle whose throttle is held has none: NaN.
    """
    length, closed = table.meta[p, paths.LENGTH], table.meta[p, paths.CLOSED] > 0.0
    for i in range(out.shape[0]):
        there = s + i * spacing
        if closed:
            there -= length * math.floor(there / length)
        out[i] = target_speed(speed, n, table, p, time, there)
        if speed.rows[n, IS_PROFILE] == 0.0:
            out[i] = math.nan


@kernel
def pedals(  # noqa: PLR0917 - numba takes no keyword-only arguments
    speed: SpeedTable,
    n: int,
    table: PathTable,
    p: int,
    time: float,
    s: float,
    v: float,
    integral: float,
    dt: float,
    most: float = math.nan,
) -> tuple[float, float, float]:
    """Throttle, brake and the new integral (itself in units of pedal travel).

    The sum of both terms is throttle when positive, brake when negative; the integral stops
    where the pedals do (anti-windup by clamping). A target above ``most`` [m/s] becomes that,
    unless it is NaN. A car that is to stand at the end of the path brakes there.
    """
    row = speed.rows[n]
    if row[IS_PROFILE] == 0.0:
        return row[CONSTANT_THROTTLE], 0.0, integral
    if _is_held(speed, n, table, p, s):
        return 0.0, _HOLD_BRAKE, 0.0
    target = target_speed(speed, n, table, p, time, s)
    if stops(speed, n, table, p):
        ahead = road_limit(speed, table, p, s + _LEAD * v)
        target = min(target, row[CAP_SCALE] * ahead)
    if most < target:
        target = max(most, 0.0)
    error = target - v
    wanted = integral + row[K_I] * error * dt
    raw = row[K_P] * error + wanted
    if -1.0 < raw < 1.0 or raw * error < 0.0:
        integral = min(max(wanted, -1.0), 1.0)
    raw = min(max(row[K_P] * error + integral, -1.0), 1.0)
    return max(raw, 0.0), max(-raw, 0.0), integral
