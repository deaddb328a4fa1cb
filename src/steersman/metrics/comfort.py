"""Metrics that a benchmark adds: standards of comfort, deadlines, shares.

Accelerations come from the plant's integration steps (``plant.record``), since UN R79 needs
100 Hz or more. Sources: ISO 11270:2014 (lane keeping: |a_y| at most 3 m/s^2, lateral jerk as a
moving average over 0.5 s at most 5 m/s^3); UN Regulation No. 79, Annex 8 (a_y through a
fourth-order Butterworth low-pass of 0.5 Hz, jerk as the moving average over 0.5 s of its
derivative; the same limits); ISO 2631-1:1997 (weighting W_d of horizontal acceleration).
"""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Any

import numpy as np

from steersman.episode import Episode
from steersman.metrics.base import metric
from steersman.metrics.driving import (
    JERK_WINDOW,
    max_lateral_acceleration,
    max_lateral_jerk_500ms,
    saturated,
)
from steersman.types import FloatArray

# Limits of ISO 11270 and UN R79.
MOST_ACCELERATION, MOST_JERK = 3.0, 5.0
# UN R79's filter, and the least sampling rate [Hz].
_R79_CUT, _R79_ORDER, _R79_RATE = 0.5, 4, 100.0
# W_d of ISO 2631-1, Table A.1: high-pass, and transition from acceleration to velocity. Its
# low-pass at 100 Hz lies beyond what is sampled.
_F1, _Q1, _F3, _F4, _Q4 = 0.4, 1.0 / math.sqrt(2.0), 2.0, 2.0, 0.63
_DEADLINES = (0.05, 0.01)
_benchmark = partial(metric, benchmark=True)


def sampled_rate(episode: Episode) -> float:
    """How often accelerations were recorded [Hz]; NaN if they were not."""
    if not episode.fine.size or not len(episode):
        return math.nan
    return round(len(episode.fine) / len(episode)) / episode.dt


def _fine(episode: Episode, column: int) -> FloatArray | None:
    """Recorded acceleration (column 0: a_x, 1: a_y); None without any, or if one is not finite."""
    values = episode.fine[:, column]
    return values if values.size and bool(np.isfinite(values).all()) else None


@_benchmark("r79_acceleration_m_s2", "m/s^2", "largest |a_y|, UN R79's filter", "lower")
def r79_acceleration(episode: Episode) -> float:
    """Largest |a_y| after UN R79's filter [m/s^2]."""
    filtered = _r79(episode)
    return math.nan if filtered is None else float(np.max(np.abs(filtered)))


@_benchmark("r79_jerk_m_s3", "m/s^3", "largest lateral jerk, UN R79's filter and average", "lower")
def r79_jerk(episode: Episode) -> float:
    """Largest moving average over 0.5 s of the derivative of the filtered a_y [m/s^3]."""
    filtered = _r79(episode)
    if filtered is None:
        return math.nan
    rate = sampled_rate(episode)
    steps = min(round(JERK_WINDOW * rate), filtered.size - 1)
    if steps < 1:
        return 0.0
    return float(np.max(np.abs(filtered[steps:] - filtered[:-steps])) * rate / steps)


def _r79(episode: Episode) -> FloatArray | None:
    """a_y after UN R79's filter, which starts settled; None below 100 Hz."""
    values, rate = _fine(episode, 1), sampled_rate(episode)
    if values is None or rate < _R79_RATE - 1e-6:
        return None
    return _settled(_r79_filter(rate), values)


@cache
def _r79_filter(rate: float) -> Any:
    """UN R79's filter at a rate [Hz], as second-order sections."""
    from scipy import signal

    return signal.butter(_R79_ORDER, _R79_CUT, fs=rate, output="sos")


def _settled(sos: Any, values: FloatArray) -> FloatArray:
    """Filter from the steady state of the first value."""
    from scipy import signal

    filtered: FloatArray
    filtered, _ = signal.sosfilt(sos, values, zi=signal.sosfilt_zi(sos) * values[0])
    return filtered


@cache
def weighting(rate: float) -> Any:
    """ISO 2631-1's W_d as digital second-order sections, by the bilinear transform."""
    from scipy import signal

    w1, w3, w4 = (2.0 * math.pi * f for f in (_F1, _F3, _F4))
    high = ([1.0, 0.0, 0.0], [1.0, w1 / _Q1, w1 * w1])
    step = ([1.0 / w3, 1.0], [1.0 / (w4 * w4), 1.0 / (_Q4 * w4), 1.0])
    parts = [signal.bilinear(*part, fs=rate) for part in (high, step)]
    return np.vstack([signal.tf2sos(*part) for part in parts])


@_benchmark(
    "weighted_acceleration_m_s2", "m/s^2", "ISO 2631-1 weighted RMS of a_x and a_y", "lower"
)
def weighted_acceleration(episode: Episode) -> float:
    """Root of the summed mean squares of weighted a_x and a_y [m/s^2], seated, comfort (k = 1)."""
    along, across = _fine(episode, 0), _fine(episode, 1)
    if along is None or across is None:
        return math.nan
    sos = weighting(sampled_rate(episode))
    squares = [np.mean(np.square(_settled(sos, values))) for values in (along, across)]
    return math.sqrt(float(sum(squares)))


@_benchmark("path_acceleration_m_s2", "m/s^2", "largest lateral acceleration that the path needs")
def path_acceleration(episode: Episode) -> float:
    """Largest lateral acceleration that the path needs at the driven speed, v^2 |kappa| [m/s^2]."""
    if not len(episode):
        return math.nan
    speed2 = np.square(episode["v_x"]) + np.square(episode["v_y"])
    return float(np.max(speed2 * np.abs(episode["curvature"])))


@_benchmark("iso_11270", "-", "completed within ISO 11270's limits", "higher", dtype=bool)
def iso_11270(episode: Episode) -> float:
    """1 if the run was completed within ISO 11270's acceleration and jerk."""
    return _within(episode, max_lateral_acceleration(episode), max_lateral_jerk_500ms(episode))


@_benchmark("r79", "-", "completed within UN R79's limits", "higher", dtype=bool)
def r79(episode: Episode) -> float:
    """1 if the run was completed within UN R79's acceleration and jerk."""
    return _within(episode, r79_acceleration(episode), r79_jerk(episode))


def _within(episode: Episode, acceleration: float, jerk: float) -> float:
    if not math.isfinite(acceleration + jerk):
        return math.nan
    good = acceleration <= MOST_ACCELERATION and jerk <= MOST_JERK
    return float(episode.completed and good)


@_benchmark("saturated_share", "-", "share of steps with the command clipped", "lower")
def saturated_share(episode: Episode) -> float:
    """Share of control steps whose command was clipped to a limit."""
    return saturated(episode) / len(episode) if len(episode) else math.nan


@_benchmark("rms_heading_error_deg", "deg", "RMS of the heading error", "lower")
def rms_heading_error(episode: Episode) -> float:
    """Root mean square of the heading error [deg]."""
    return _rms_degrees(episode["heading_error"])


@_benchmark("rms_course_error_deg", "deg", "RMS of the course error", "lower")
def rms_course_error(episode: Episode) -> float:
    """Root mean square of the course error [deg]."""
    return _rms_degrees(episode["course_error"])


def _rms_degrees(values: FloatArray) -> float:
    return math.degrees(float(np.sqrt(np.mean(np.square(values))))) if values.size else math.nan


@_benchmark("deadline_misses_50ms", "-", "control steps over 50 ms", "lower", dtype=int)
def misses_50ms(episode: Episode) -> float:
    """Number of control steps that took longer than 50 ms."""
    return float(np.count_nonzero(episode["control_time"] > _DEADLINES[0]))


@_benchmark("deadline_misses_10ms", "-", "control steps over 10 ms", "lower", dtype=int)
def misses_10ms(episode: Episode) -> float:
    """Number of control steps that took longer than 10 ms."""
    return float(np.count_nonzero(episode["control_time"] > _DEADLINES[1]))
