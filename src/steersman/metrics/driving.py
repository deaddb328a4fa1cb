"""What is measured of every drive: tracking, steering, ride, how it went, computing time."""

from __future__ import annotations

import math

import numpy as np

from steersman.episode import OFF_TRACK, ROLL_OVER, Episode
from steersman.metrics.base import metric
from steersman.types import Driver, FloatArray, Status

# Errors are kept in m, and read in mm.
MM = ("mm", 1e3)
# ISO 11270 judges lateral jerk as a moving average over this time [s].
JERK_WINDOW = 0.5
# A turn back of the normalised steering by less is no reversal [-].
REVERSAL_GAP = 0.01


def _mean_abs(values: FloatArray) -> float:
    return float(np.mean(np.abs(values))) if values.size else math.nan


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else math.nan


def _max_abs(values: FloatArray) -> float:
    return float(np.max(np.abs(values))) if values.size else math.nan


def _percentile(values: FloatArray, q: float) -> float:
    return float(np.percentile(values, q)) if values.size else math.nan


def _rate(values: FloatArray, dt: float) -> FloatArray:
    """First differences per second; a run of one row has changed nothing: one zero."""
    return np.diff(values) / dt if values.size > 1 else np.zeros(values.size)


def _speed(episode: Episode) -> FloatArray:
    return np.hypot(episode["v_x"], episode["v_y"])


@metric("mean_abs_lateral_error_m", "m", "mean |lateral error|", "lower", steady=True, shown_in=MM)
def mean_abs_lateral_error(episode: Episode) -> float:
    """Mean of |d| [m]; the paper's average lateral error (ALE)."""
    return _mean_abs(episode["lateral_error"])


@metric("rms_lateral_error_m", "m", "RMS of the lateral error", "lower", steady=True, shown_in=MM)
def rms_lateral_error(episode: Episode) -> float:
    """Root mean square of d [m]."""
    return _rms(episode["lateral_error"])


@metric(
    "p95_abs_lateral_error_m",
    "m",
    "95th percentile of |lateral error|",
    "lower",
    steady=True,
    shown_in=MM,
)
def p95_abs_lateral_error(episode: Episode) -> float:
    """95th percentile of |d| [m], linear between order statistics."""
    return _percentile(np.abs(episode["lateral_error"]), 95.0)


@metric(
    "max_abs_lateral_error_m", "m", "largest |lateral error|", "lower", steady=True, shown_in=MM
)
def max_abs_lateral_error(episode: Episode) -> float:
    """Largest |d| [m]."""
    return _max_abs(episode["lateral_error"])


@metric(
    "mean_abs_heading_error_deg",
    "deg",
    "mean |heading error|; includes the car's side-slip",
    "lower",
    steady=True,
)
def mean_abs_heading_error(episode: Episode) -> float:
    """Mean of |yaw - path tangent| [deg]; the paper's average orientation error (AOE)."""
    return math.degrees(_mean_abs(episode["heading_error"]))


@metric(
    "mean_abs_course_error_deg",
    "deg",
    "mean |course error|: velocity against path tangent",
    "lower",
    steady=True,
)
def mean_abs_course_error(episode: Episode) -> float:
    """Mean of |direction of velocity - path tangent| [deg]."""
    return math.degrees(_mean_abs(episode["course_error"]))


@metric("steer_std", "-", "standard deviation of the steering command", "lower", steady=True)
def steer_std(episode: Episode) -> float:
    """Standard deviation (of the population) of the normalised steering command."""
    command = episode["steer_command"]
    return float(np.std(command)) if command.size else math.nan


@metric("steer_rate_rms_per_s", "1/s", "RMS rate of change of the steering command", "lower")
def steer_rate_rms(episode: Episode) -> float:
    """Root mean square of the command's differences over the control period [1/s]."""
    return _rms(_rate(episode["steer_command"], episode.dt))


@metric("steer_change_rms", "-", "RMS change of the steering command in a control step", "lower")
def steer_change_rms(episode: Episode) -> float:
    """Root mean square of the command's change from one control step to the next [-]."""
    return _rms(_rate(episode["steer_command"], 1.0))


def _reversals(values: FloatArray, gap: float) -> int:
    """How often a signal turns back by at least ``gap`` after it moved by as much."""
    steps = np.sign(np.diff(values))
    # Between its turning points a signal only rises or only falls; they are all that counts.
    turns = np.flatnonzero(steps[1:] != steps[:-1]) + 1
    count, direction = 0, 0
    low = high = float(values[0])
    for value in [*values[turns].tolist(), float(values[-1])]:
        low, high = min(low, value), max(high, value)
        if value - low >= gap and direction <= 0:
            count, direction = count + (direction < 0), 1
        elif high - value >= gap and direction >= 0:
            count, direction = count + (direction > 0), -1
        else:
            continue
        low = high = value
    return count


@metric(
    "steer_reversals_per_min",
    "1/min",
    "reversals of the steering command by at least 0.01",
    "lower",
)
def steer_reversals(episode: Episode) -> float:
    """Changes of the steering's direction in a minute, those smaller than the gap left out.

    SAE J2944's steering reversal rate: a reversal is a turn back by at least ``REVERSAL_GAP``.
    """
    command = episode["steer_command"]
    if not (command.size and np.isfinite(command).all()):
        return math.nan
    return 60.0 * _reversals(command, REVERSAL_GAP) / (command.size * episode.dt)


@metric(
    "lateral_jerk_rms_m_s3", "m/s^3", "RMS lateral jerk, differences at the control period", "lower"
)
def lateral_jerk_rms(episode: Episode) -> float:
    """Root mean square of the differences of a_y over the control period [m/s^3]."""
    return _rms(_rate(episode["a_y"], episode.dt))


@metric(
    "max_lateral_jerk_500ms_m_s3", "m/s^3", "largest lateral jerk, 0.5 s moving average", "lower"
)
def max_lateral_jerk_500ms(episode: Episode) -> float:
    """Largest |jerk| as a moving average over 0.5 s [m/s^3], as ISO 11270 reads it.

    The mean of a derivative over a window is the difference of its ends over its length. A run
    shorter than the window is averaged as a whole.
    """
    a_y = episode["a_y"]
    if a_y.size <= 1:
        return _rms(np.zeros(a_y.size))
    steps = min(max(round(JERK_WINDOW / episode.dt), 1), a_y.size - 1)
    return _max_abs((a_y[steps:] - a_y[:-steps]) / (steps * episode.dt))


@metric("mean_speed_m_s", "m/s", "mean speed", steady=True)
def mean_speed(episode: Episode) -> float:
    """Mean magnitude of the velocity [m/s]."""
    return _mean_abs(_speed(episode))


@metric("max_lateral_acceleration_m_s2", "m/s^2", "largest |lateral acceleration|", "lower")
def max_lateral_acceleration(episode: Episode) -> float:
    """Largest |a_y| of the centre of mass [m/s^2]."""
    return _max_abs(episode["a_y"])


@metric("distance_m", "m", "distance driven along the path")
def distance(episode: Episode) -> float:
    """Distance driven along the path [m]."""
    return float(episode.distance)


@metric("duration_s", "s", "time driven")
def duration(episode: Episode) -> float:
    """Number of control steps times the control period [s]."""
    return len(episode) * float(episode.dt)


@metric("completed", "-", "the run reached its planned end", "higher", dtype=bool)
def completed(episode: Episode) -> float:
    """1 if the run reached its planned end."""
    return float(episode.completed)


@metric("off_track", "-", "the car left the corridor", "lower", dtype=bool)
def off_track(episode: Episode) -> float:
    """1 if the run ended because the car left the corridor."""
    return float(episode.end == OFF_TRACK)


@metric("rolled_over", "-", "the car rolled over", "lower", dtype=bool)
def rolled_over(episode: Episode) -> float:
    """1 if the run ended because the car rolled over."""
    return float(episode.end == ROLL_OVER)


@metric("saturated", "-", "control steps with the command clipped to a limit", "lower", dtype=int)
def saturated(episode: Episode) -> float:
    """Number of control steps at which the command was clipped to a limit."""
    return float(np.count_nonzero(episode["status"] == Status.SATURATED))


@metric("fallbacks", "-", "control steps answered by the controller's fallback", "lower", dtype=int)
def fallbacks(episode: Episode) -> float:
    """Number of control steps at which the controller's fallback answered."""
    return float(np.count_nonzero(episode["status"] == Status.FALLBACK))


@metric("interventions", "-", "times that a supervisor took the steering", "lower", dtype=int)
def interventions(episode: Episode) -> float:
    """Number of times that a supervisor took the steering from its controller."""
    away = episode["driver"] != Driver.INNER
    return float(np.count_nonzero(np.diff(away, prepend=False) & away))


@metric("intervened_s", "s", "time in which the supervised controller did not steer", "lower")
def intervened(episode: Episode) -> float:
    """Time in which a supervisor's fallback steered instead of its controller [s]."""
    return float(np.count_nonzero(episode["driver"] != Driver.INNER)) * float(episode.dt)


@metric("control_time_us_p50", "us", "median computing time of a step", "lower")
def control_time_p50(episode: Episode) -> float:
    """Median computing time of a control step [us]."""
    return 1e6 * _percentile(episode["control_time"], 50.0)


@metric("control_time_us_p99", "us", "99th percentile of the same", "lower")
def control_time_p99(episode: Episode) -> float:
    """99th percentile of the computing time of a control step [us]."""
    return 1e6 * _percentile(episode["control_time"], 99.0)


@metric("control_time_us_max", "us", "longest computing time of a step", "lower")
def control_time_max(episode: Episode) -> float:
    """Longest computing time of a control step [us]."""
    return 1e6 * _max_abs(episode["control_time"])
