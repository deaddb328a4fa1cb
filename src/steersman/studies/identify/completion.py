"""What a recording tells of its own sensors, and signals that follow from others."""

from __future__ import annotations

import numpy as np

from steersman.studies.identify.in_range import near
from steersman.studies.identify.recording import Log, pieces
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# At standstill the car is slower than this [m/s]; so long [s] it has to stand to tell an offset.
_STANDS, _LONG_ENOUGH = 0.1, 2.0
# Time constants that are tried for the yaw rate's low pass [s]: what is beyond is no sensor's.
_LAGS = np.arange(0.0, 1.0, 0.01)
# Slower than this a heading is mostly noise [m/s].
_MOVES = 3.0
# A lag is one if the misfit falls below this share of that without one.
_CLEARLY = 0.6
# Heading and yaw rate contradict each other if they are so many standard deviations apart, and no
# less than this [rad/s]; a heading that turns faster than this has jumped [rad/s].
_FAILS, _LEAST_FAILURE, _FASTEST = 6.0, 0.01, 1.5
# Time over which they are compared [s].
_SPAN = 0.25


def completed(log: Log, vehicle: Vehicle) -> Log:
    """The recording with what the fit needs.

    A yaw rate that is missing is the slope of the heading, and v_y that of the positions. What the
    heading and a standstill show of the yaw rate's sensor is subtracted or noted. A measured wheel
    angle stands for a command if there is none.
    """
    signals = dict(log.signals)
    rate = _slope(log, "yaw") if log.get("yaw") is not None else None
    if {"x", "y", "yaw"} <= signals.keys() and "v_y" not in signals:
        yaw = _filled(log.time, signals["yaw"])
        east, north = _slope(log, "x"), _slope(log, "y")
        signals["v_y"] = np.cos(yaw) * north - np.sin(yaw) * east
        # What is missing is missing; a car that stands has no direction of motion.
    if "v_x" not in signals:
        aside = np.nan_to_num(signals["v_y"]) if "v_y" in signals else 0.0
        signals["v_x"] = np.sqrt(np.maximum(signals["speed"] ** 2 - aside**2, 0.0))
    log = log._replace(signals=signals)
    if "yaw_rate" not in signals and rate is not None:
        signals["yaw_rate"] = rate
    elif rate is not None:
        lag = _lag(log, rate)
        wrong = _contradicting(log, rate, lag)
        signals["yaw_rate"] = np.where(wrong, np.nan, signals["yaw_rate"])
        seconds = float(np.median(np.diff(log.time)) * wrong.sum())
        log = log._replace(yaw_rate_lag=lag, contradicting=seconds)
        # A heading does not drift away from where the car goes.
        log = _without_offset(log, signals["yaw_rate"] - _passed(log, _without_jumps(rate), lag))
    if log.yaw_rate_offset is None:
        stands = np.abs(signals["v_x"]) < _STANDS
        log = _without_offset(log, np.where(stands, signals["yaw_rate"], np.nan))
    signals = dict(log.signals)
    if "steer_command" not in signals:
        angle = signals.pop("wheel_angle")
        steer = [
            vehicle.steer_for_wheel_angle(float(a), float(v))
            for a, v in zip(angle, np.nan_to_num(signals["v_x"]), strict=True)
        ]
        signals["steer_command"] = np.where(np.isfinite(angle), steer, np.nan)
        log = log._replace(signals=signals, by_angle=True)
    return log


def _without_offset(log: Log, shown: FloatArray) -> Log:
    """The recording without the yaw rate's offset, of which ``shown`` (rows,) are samples."""
    known = shown[np.isfinite(shown)]
    if float(np.median(np.diff(log.time))) * len(known) < _LONG_ENOUGH:
        return log
    offset = float(np.median(known))
    signals = {**log.signals, "yaw_rate": log.signals["yaw_rate"] - offset}
    return log._replace(signals=signals, yaw_rate_offset=offset)


def _filled(time: FloatArray, angle: FloatArray) -> FloatArray:
    """An angle without jumps by a whole turn; what is missing lies on a line between."""
    known = np.isfinite(angle)
    return np.asarray(np.interp(time, time[known], np.unwrap(angle[known])))


def _slope(log: Log, name: str) -> FloatArray:
    """Derivative of a signal by a cubic spline; NaN outside stretches."""
    from scipy.interpolate import CubicSpline

    values = log.signals[name]
    values = _filled(log.time, values) if name == "yaw" else values
    out = np.full(len(log.time), np.nan)
    for rows in pieces(log):
        known = np.flatnonzero(np.isfinite(values[rows])) + rows.start
        spline = CubicSpline(log.time[known], values[known])
        out[known] = spline(log.time[known], 1)
    return out


def _lag(log: Log, rate: FloatArray) -> float:
    """Time constant [s] of the low pass between heading and recorded yaw rate; 0 if none shows."""
    moves = np.nan_to_num(log.signals["v_x"]) > _MOVES
    if moves.sum() < len(_LAGS):
        return 0.0

    def misfit(lag: float) -> float:
        left = log.signals["yaw_rate"] - _passed(log, rate, lag)
        left = left[moves & np.isfinite(left)]
        return float(np.median(np.abs(left - np.median(left))))

    rate = _without_jumps(rate)
    found = min(_LAGS.tolist(), key=misfit)
    return found if misfit(found) < _CLEARLY * misfit(0.0) else 0.0


def _contradicting(log: Log, rate: FloatArray, lag: float) -> FloatArray:
    """Rows at which the yaw rate is not that of the heading: one of the two sensors fails there.

    A heading that jumps for a row is no reason; its low pass goes on for some time constants.
    """
    left = np.nan_to_num(log.signals["yaw_rate"] - _passed(log, _without_jumps(rate), lag))
    rows = max(round(_SPAN / float(np.median(np.diff(log.time)))), 1)
    left = np.abs(np.convolve(left, np.ones(rows) / rows, "same"))
    usual = 1.4826 * float(np.median(left))
    seeds = log.time[left > max(_FAILS * usual, _LEAST_FAILURE)]
    return np.asarray(near(log.time, seeds, 0.5))


def _without_jumps(rate: FloatArray) -> FloatArray:
    """Straight lines where a heading turned faster than cars do."""
    good = np.abs(np.nan_to_num(rate, nan=np.inf)) < _FASTEST
    rows = np.arange(len(rate))
    return np.asarray(np.interp(rows, rows[good], rate[good]))


def _passed(log: Log, values: FloatArray, lag: float) -> FloatArray:
    out = np.full(len(values), np.nan)
    for rows in pieces(log):
        step = float(np.median(np.diff(log.time[rows])))
        out[rows] = low_pass(values[rows], lag, step)
    return out


def low_pass(values: FloatArray, lag: float, step: float, first: object = None) -> FloatArray:
    """A first-order low pass of the time constant ``lag`` [s] along the last axis, every ``step``.

    ``first`` are its values before; None: it has settled at the first of ``values``.
    """
    if lag <= 0.0:
        return values
    from scipy.signal import lfilter

    keep = float(np.exp(-step / lag))
    begin = values[..., 0] if first is None else np.asarray(first)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, zi=(keep * begin)[..., None])[0])
