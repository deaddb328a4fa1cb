"""How well a vehicle predicts a recording: 1 s ahead of its recorded state, again and again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import vehicle as car
from steersman.studies.identify import lateral, stretch_replay
from steersman.studies.identify.completion import low_pass
from steersman.studies.identify.recording import Log
from steersman.studies.identify.stretch_replay import H, Stretch
from steersman.studies.identify.unknowns import Sensors
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

HORIZON = 1.0
"""Length of a prediction [s]; each begins where the one before ends."""

UNITS = {
    "yaw_rate": "rad/s",
    "v_y": "m/s",
    "a_y": "m/s^2",
    "wheel_angle": "rad",
    "steer": "-",
    "v_x": "m/s",
}


class Error(NamedTuple):
    """RMS error of predictions over 1 s of what was held out, with two vehicles."""

    signal: str
    unit: str
    before: float
    """With the starting vehicle; both are given the same sensors."""
    after: float
    """With the identified one."""
    noise: float
    """White noise of the recorded signal, by its second differences: the least there can be."""
    rows: int


def errors(
    log: Log,
    stretches: Sequence[Stretch],
    rows: Any,
    vehicles: tuple[Vehicle, Vehicle],
    sensors: Sensors,
) -> list[Error]:
    """Of the signals at those rows (bool); the speed's only if the pedals were recorded."""
    if not rows.any():
        return []
    names = lateral.channels(log)
    if log.get("throttle") is not None:
        names = [*names, "v_x"]
    steady = np.zeros(len(log.time), dtype=bool)
    for stretch in stretches:
        why = stretch.left_out._replace(upset=np.zeros(len(stretch.time), dtype=bool))
        steady[stretch.rows] = stretch.range_of(why)
    sides = [predicted(vehicle, log, stretches, sensors) for vehicle in vehicles]
    out = []
    for name in names:
        seen = log.signals[name]
        left = [side[name] - seen for side in sides]
        known = rows & steady & np.isfinite(left[0]) & np.isfinite(left[1])
        before, after = (
            float(np.sqrt(np.mean(e[known] ** 2))) if known.any() else float("nan") for e in left
        )
        noise = stretch_replay.noise_of(seen[np.isfinite(seen)])
        out.append(Error(name, UNITS[name], before, after, noise, int(known.sum())))
    return out


def predicted(
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], sensors: Sensors
) -> dict[str, FloatArray]:
    """Signal -> (rows,), each predicted from the last start; NaN at starts and outside stretches.

    Yaw rate, v_y and speed start as recorded; what is not recorded starts as in a replay from the
    recording's beginning. Without pedals the speed is the recorded one.
    """
    names = lateral.channels(log)
    out = {name: np.full(len(log.time), np.nan) for name in [*names, "v_x"]}
    for stretch in stretches:
        starts = np.arange(0, len(stretch.speed) - 1, round(HORIZON / H), dtype=np.int64)
        base = _starts(vehicle, log, stretch, sensors)
        states = stretch_replay.replayed(vehicle, stretch, base, starts, sensors.clock)
        plain = sensors._replace(yaw_rate_lag=0.0)
        found = stretch_replay.responses(vehicle, stretch, states, names, plain)
        begun = np.isclose(stretch.time % HORIZON, 0.0, atol=H) | np.isclose(
            stretch.time % HORIZON, HORIZON, atol=H
        )
        for k, name in enumerate(names):
            values = found[:, k]
            if name == "yaw_rate" and sensors.yaw_rate_lag > 0.0:
                values = stretch_replay.at_rows(stretch, _passed(log, stretch, states, sensors))
            out[name][stretch.rows] = np.where(begun, np.nan, values)
        speed = stretch_replay.at_rows(stretch, states[:, car.VX])
        out["v_x"][stretch.rows] = np.where(begun, np.nan, speed)
    return out


def _starts(vehicle: Vehicle, log: Log, stretch: Stretch, sensors: Sensors) -> FloatArray:
    """States (m + 1, N_STATE) from which predictions may start."""
    base = stretch_replay.lateral(vehicle, stretch, sensors.clock)
    rate = _recorded(log, stretch, "yaw_rate")
    if rate is not None:
        turning = rate - sensors.offsets.get("yaw_rate", 0.0)
        base[:, car.YAW_RATE] = turning + sensors.yaw_rate_lag * np.gradient(turning, H)
    aside = _recorded(log, stretch, "v_y")
    if aside is not None:
        askew, arm = sensors.offsets.get("v_y", 0.0), sensors.arms.get("v_y", 0.0)
        base[:, car.VY] = aside - askew * stretch.speed - arm * base[:, car.YAW_RATE]
    return base


def _recorded(log: Log, stretch: Stretch, name: str) -> FloatArray | None:
    """A signal on the grid, straight between rows."""
    values = log.get(name)
    known = None if values is None else np.isfinite(values[stretch.rows])
    if values is None or known is None or not known.any():
        return None
    grid = H * np.arange(len(stretch.speed))
    return np.asarray(np.interp(grid, stretch.time[known], values[stretch.rows][known]))


def _passed(log: Log, stretch: Stretch, states: FloatArray, sensors: Sensors) -> FloatArray:
    """The yaw rate on the grid as its low pass shows it, which starts as recorded."""
    size = round(HORIZON / H)
    rate = states[:, car.YAW_RATE]
    seen = _recorded(log, stretch, "yaw_rate")
    pad = -len(rate) % size
    parts = np.pad(rate, (0, pad), mode="edge").reshape(-1, size)
    first = parts[:, 0] if seen is None else seen[::size]
    offset = sensors.offsets.get("yaw_rate", 0.0)
    out = low_pass(parts, sensors.yaw_rate_lag, H, first - offset) + offset
    return out.ravel()[: len(rate)]
