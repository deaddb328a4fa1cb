"""From a recording to a vehicle: fit it, judge it on held-out blocks, give intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.engine.jobs import Workers
from steersman.errors import DataError
from steersman.studies.identify import lateral, longitudinal, stretch_replay
from steersman.studies.identify.lateral import Fitted
from steersman.studies.identify.plausibility import check
from steersman.studies.identify.recording import Log
from steersman.studies.identify.stretch_replay import Stretch
from steersman.studies.identify.unknowns import SIGMAS, Unknown, offsets_at
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Length of the stretches that are fitted or held out [s]: a multiple of the free segments'.
BLOCK = 10.0
# A factor so many prior deviations off the starting vehicle's is doubtful.
_FAR = 3.0
FITTED, GIVEN, KEPT, AT_LEAST, NONE = "fitted", "given", "kept", "at least", "none seen"


class Figure(NamedTuple):
    """A figure of the vehicle or offset of a sensor, as the recording gives it."""

    name: str
    unit: str
    before: float
    value: float
    low: float | None
    """Ends of the 95 % interval; None if the recording does not determine the figure."""
    high: float | None
    status: str
    """``fitted``; ``given`` (depends on a figure that is kept); ``kept`` from the starting vehicle;
    ``at least``; ``none seen`` (zero explains as much)."""
    note: str


class Error(NamedTuple):
    """RMS of a signal's error on what was held out, before and after."""

    signal: str
    unit: str
    before: float
    after: float
    rows: int


class Identified(NamedTuple):
    """A vehicle as a recording gives it."""

    log: Log
    stretches: list[Stretch]
    use: Any
    """(rows,) bool: fitted, not held out."""
    before: Vehicle
    vehicle: Vehicle
    figures: list[Figure]
    errors: list[Error]
    offsets: dict[str, float]
    seconds: float
    """Of the recording that are fitted."""


UNITS = {
    "yaw_rate": "rad/s",
    "v_y": "m/s",
    "a_y": "m/s^2",
    "wheel_angle": "rad",
    "steer": "-",
    "v_x": "m/s",
}


def identify(
    log: Log,
    vehicle: Vehicle,
    holdout: float = 0.25,
    notify: Callable[[str], None] = lambda _: None,
    workers: Workers | None = None,
) -> Identified:
    """Fit a vehicle to a recording.

    Args:
        log: what was commanded and measured.
        vehicle: the starting vehicle; figures that the recording does not determine are kept.
        holdout: share of the recording that only judges the fit, in blocks of 10 s; 0: none.
        notify: called with a line at the beginning of each stage.
        workers: search from several starts at a time; the result does not depend on them.

    Raises:
        DataError: the recording is too short, or its columns contradict each other.
    """
    stretches = stretch_replay.stretches(log, vehicle)
    check(log, stretches, vehicle)
    use = fitted_rows(log, holdout)
    notify("lateral: steering, tyres, inertia")
    side = lateral.fit(vehicle, log, stretches, use, workers=workers)
    found, fits = side.vehicle, [side]
    if log.get("throttle") is not None:
        notify("longitudinal: throttle map, brakes")
        ahead, better = longitudinal.fit(found, log, stretches, use)
        notify("lateral again, with the speed that both agree on")
        # The figures of the map are fixed now; those of the steering start where they were.
        base = ahead.vehicle.replace(**{u.field: getattr(vehicle, u.field) for u in _fields(side)})
        side = lateral.fit(base, log, better, use, side)
        found, fits, stretches = side.vehicle, [side, ahead], better
    offsets = offsets_at(side.unknowns, side.estimate.z)
    figures = [figure for fit in fits for figure in _figures(fit)]
    errors = _errors(log, stretches, ~use, vehicle, found, offsets)
    seconds = float(np.median(np.diff(log.time)) * use.sum())
    return Identified(log, stretches, use, vehicle, found, figures, errors, offsets, seconds)


def _fields(fit: Fitted) -> list[Unknown]:
    return [unknown for unknown in fit.unknowns if not unknown.offset]


def fitted_rows(log: Log, holdout: float) -> Any:
    """(rows,) bool: about that share of the blocks is held out, evenly spread.

    Raises:
        DataError: the recording is too short to hold out a block.
    """
    block = np.floor(log.time / BLOCK + 1e-9)
    if holdout == 0.0:
        return np.full(len(log.time), True)
    count = int(block[-1]) + 1
    if count * holdout < 1.0:
        raise DataError(
            f"{log.name}: {log.time[-1]:.0f} s are too short to hold {holdout:g} of them out in "
            f"blocks of {BLOCK:.0f} s; record more, or give --holdout 0"
        )
    return np.floor((block + 1) * holdout + 1e-9) <= np.floor(block * holdout + 1e-9)


def _figures(fit: Fitted) -> list[Figure]:
    found = fit.estimate
    out = []
    for i, unknown in enumerate(fit.unknowns):
        name, z = unknown.name, float(found.z[i])
        value = unknown.value(z)
        half = SIGMAS * float(np.sqrt(found.covariance[i, i]))
        if found.determined[i]:
            given = found.given[i]
            note = f"depends on {fit.unknowns[given].name}, which is kept" if given >= 0 else ""
            status = GIVEN if given >= 0 else FITTED
            if unknown.ratio and abs(z) > _FAR:
                note = f"doubtful: far from the starting vehicle's{'; ' + note if note else ''}"
            low, high = (unknown.value(z + side * half) for side in (-1.0, 1.0))
            out.append(Figure(name, unknown.unit, unknown.start, value, low, high, status, note))
        else:
            status, note = _why_kept(fit, unknown, float(found.possible[i]))
            out.append(Figure(name, unknown.unit, unknown.start, value, None, None, status, note))
    return out


def _why_kept(fit: Fitted, unknown: Unknown, deviation: float) -> tuple[str, str]:
    if unknown.name in fit.at_least:
        return AT_LEAST, "the recorded steering never went faster"
    if unknown.name == "steer_lag" and np.isfinite(deviation):
        most = unknown.value(2.0 * SIGMAS * deviation)
        if most < 0.5 * unknown.high:
            return NONE, f"less than {most:.2g} s"
    if not np.isfinite(deviation):
        return KEPT, "not determined by this recording"
    width = SIGMAS * deviation * unknown.prior
    if width > 4.0 * unknown.need:
        return KEPT, "not determined by this recording"
    wide = f"{100.0 * width:.0f} %" if unknown.ratio else f"{width:.2g} {unknown.unit}"
    return KEPT, f"only known to +-{wide}"


def _errors(
    log: Log,
    stretches: Sequence[Stretch],
    rows: Any,
    before: Vehicle,
    after: Vehicle,
    offsets: dict[str, float],
) -> list[Error]:
    """On the rows held out; both vehicles are given the same offsets of the sensors."""
    if not rows.any():
        return []
    seen = lateral.measured(log, stretches, rows)
    sides = [lateral.simulated(v, log, stretches, offsets) - seen for v in (before, after)]
    out = [
        Error(name, UNITS[name], _rms(sides[0][:, k]), _rms(sides[1][:, k]), _count(seen[:, k]))
        for k, name in enumerate(lateral.channels(log))
    ]
    if log.get("throttle") is not None:
        speed = np.where(rows, log.signals["v_x"], np.nan)
        ahead = [longitudinal.speeds(v, log, stretches) - speed for v in (before, after)]
        out.append(Error("v_x", "m/s", _rms(ahead[0]), _rms(ahead[1]), _count(ahead[0])))
    return out


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _count(values: FloatArray) -> int:
    return int(np.isfinite(values).sum())
