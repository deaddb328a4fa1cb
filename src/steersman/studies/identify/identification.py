"""From a recording to a vehicle: fit it, judge it on held-out blocks, give intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.engine.jobs import Workers
from steersman.errors import DataError
from steersman.studies.identify import lateral_fit, longitudinal, stretch_replay
from steersman.studies.identify.completion import completed
from steersman.studies.identify.lateral import Fitted
from steersman.studies.identify.plausibility import check
from steersman.studies.identify.prediction import Error, errors
from steersman.studies.identify.recording import Log
from steersman.studies.identify.stretch_replay import Stretch
from steersman.studies.identify.unknowns import SIGMAS, Sensors, Unknown, sensors_at
from steersman.vehicles import Vehicle

# Length of the stretches that are fitted or held out [s]: a multiple of the free segments'.
BLOCK = 10.0
# A factor so many prior deviations off the starting vehicle's is doubtful.
_FAR = 3.0
FITTED, GIVEN, KEPT, AT_LEAST, NONE = "fitted", "given", "kept", "at least", "none seen"
SEEN = "seen"


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
    ``at least``; ``none seen`` (zero explains as much); ``seen`` of a sensor in other signals."""
    note: str


class LeftOut(NamedTuple):
    """How much of the recording is not compared, and why."""

    reason: str
    seconds: float


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
    sensors: Sensors
    seconds: float
    """Of the recording that are fitted."""
    left_out: list[LeftOut]


def identify(
    log: Log,
    vehicle: Vehicle,
    holdout: float = 0.25,
    notify: Callable[[str], None] = lambda _: None,
    workers: Workers | None = None,
    *,
    last: bool = False,
) -> Identified:
    """Fit a vehicle to a recording.

    Args:
        log: what was commanded and measured.
        vehicle: the starting vehicle; figures that the recording does not determine are kept.
        holdout: share of the recording that only judges the fit, in blocks of 10 s; 0: none.
        notify: called with a line at the beginning of each stage.
        workers: search from several starts at a time; the result does not depend on them.
        last: whether what is held out is the recording's end instead of blocks all over it.

    Raises:
        DataError: the recording is too short, its columns contradict each other, or a figure ends
            at its bound.
    """
    log = completed(log, vehicle)
    start = first = vehicle.replace(**DIRECT) if log.by_angle else vehicle
    stretches = stretch_replay.stretches(log, start)
    check(log, stretches, start)
    use = fitted_rows(log, holdout, last=last)
    pedals = log.get("throttle") is not None
    count = 4 if pedals else 2
    notify(f"1/{count} lateral: steering, tyres, inertia")
    side = lateral_fit.fit(start, log, stretches, use, workers=workers)
    stretches = lateral_fit.without_upsets(side, log, stretches, use)
    fits = []
    if pedals:
        notify(f"2/{count} longitudinal: throttle map, brakes")
        clock = sensors_at(side.unknowns, side.estimate.z, 0.0).clock
        ahead, stretches = longitudinal.fit(side.vehicle, log, stretches, use, clock)
        fits.append(ahead)
        # The figures of the map are fixed now; those of the steering start where they were.
        before = {u.field: getattr(start, u.field) for u in side.unknowns if not u.sensor}
        start = ahead.vehicle.replace(**before)
    notify(f"{count - 1}/{count} lateral again, with the speed and the rows that are left")
    side = lateral_fit.fit(start, log, stretches, use, side)
    fits.insert(0, side)
    check_bounds(log, fits)
    found = side.vehicle
    if log.by_angle:
        found = found.replace(**{name: getattr(vehicle, name) for name in DIRECT})
    sensors = sensors_at(side.unknowns, side.estimate.z, log.yaw_rate_lag)
    notify(f"{count}/{count} predictions of what was held out")
    figures = [figure for fit in fits for figure in _figures(fit)] + _of_sensors(log)
    judged = errors(log, stretches, ~use, (first, side.vehicle), sensors)
    step = float(np.median(np.diff(log.time)))
    seconds = step * float(use.sum())
    return Identified(
        log, stretches, use, vehicle, found, figures, judged, sensors, seconds,
        _left_out(log, stretches, step),
    )  # fmt: skip


DIRECT = {"steer_delay": 0.0, "steer_lag": 0.0, "steer_rate_up": 1e3, "steer_rate_down": 1e3}
"""Where the measured angle is replayed, nothing of the actuator is between it and the wheels."""

# Why a figure may run to a bound.
_CAUSES = {
    "yaw_inertia": "is the yaw rate low-passed (give the heading, yaw, too), or are mass and axle "
    "distances those of another car?",
    "c_f": "do mass and axle distances belong to another car, or v_y to another point?",
    "c_r": "do mass and axle distances belong to another car, or v_y to another point?",
    "max_wheel_angle": "is the steering in another unit, or --lock another angle?",
    "steer_delay": "are commands and sensors stamped by different clocks?",
    "clock": "are the angle and the sensors stamped by different clocks?",
    "steer_lag": "was the steering command filtered before it was recorded?",
    "arm": "is v_y or a_y in another unit or direction?",
    "offset": "is the sensor's offset a wrong unit or direction?",
    "brake_force": "is the brake recorded as a pressure? scale it to 0 to 1 (brake=TITLE/NUMBER)",
}


def check_bounds(log: Log, fits: Sequence[Fitted]) -> None:
    """Refuse fits that end at a bound: the log contradicts the model, or the starting vehicle.

    Raises:
        DataError: names the figure, its bound and the likely cause.
    """
    for fit in fits:
        for i, unknown in enumerate(fit.unknowns):
            low, high = unknown.bounds()
            z, near = float(fit.estimate.z[i]), 1e-3 * (high - low)
            natural = not unknown.ratio and unknown.low == 0.0  # no delay, no lag
            at_low, at_high = z - low < near and not natural, high - z < near
            if fit.estimate.determined[i] and (at_low or at_high):
                bound = unknown.low if at_low else unknown.high
                cause = _CAUSES.get(unknown.field, "does the starting vehicle describe this car?")
                raise DataError(
                    f"{log.name}: the fit drives {unknown.name} to its bound of {bound:.4g} "
                    f"{unknown.unit}, from {unknown.start:.4g}; {cause}"
                )


def _of_sensors(log: Log) -> list[Figure]:
    """What the recording itself shows of the yaw rate's sensor."""
    out = []
    if log.yaw_rate_lag > 0.0:
        note = "the recorded yaw rate is the heading's through such a low pass"
        lag = log.yaw_rate_lag
        out.append(Figure("lag[yaw_rate]", "s", 0.0, lag, None, None, SEEN, note))
    if log.yaw_rate_offset is not None:
        offset, note = log.yaw_rate_offset, "at standstill or by the heading; subtracted"
        out.append(Figure("offset[yaw_rate]", "rad/s", 0.0, offset, None, None, SEEN, note))
    return out


_REASONS = {
    "slow": "slower than 1 m/s",
    "sliding": "beyond 70 % of the grip",
    "upset": "moved as no command explains (kerbs, bumps, gaps of a sensor)",
}


def _left_out(log: Log, stretches: Sequence[Stretch], step: float) -> list[LeftOut]:
    """Seconds of the rows themselves; a second after each is left out too."""
    out = []
    for name, words in _REASONS.items():
        rows = sum(int(np.sum(getattr(s.left_out, name))) for s in stretches)
        if rows:
            out.append(LeftOut(words, rows * step))
    if log.contradicting:
        out.append(
            LeftOut("in which heading and yaw rate contradict each other", log.contradicting)
        )
    return out


def fitted_rows(log: Log, holdout: float, *, last: bool = False) -> Any:
    """(rows,) bool: about that share of the blocks is held out, evenly spread or the ``last``.

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
    if last:
        return block < round((1.0 - holdout) * count)
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
