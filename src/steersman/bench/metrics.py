"""What is measured of a run: small pure functions ``Episode -> float`` and their table.

Definitions, formulas and sources are in ``docs/metrics.md``. A quantity that is not defined (a
mean over no rows, anything over a signal with a value that is not finite) is NaN here and None in
:func:`summarise`, so that a summary is always valid JSON.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from steersman.bench.reversals import reversals
from steersman.episode import OFF_TRACK, ROLL_OVER, Episode
from steersman.types import Driver, FloatArray, Status

MetricFunction: TypeAlias = Callable[[Episode], float]
# ISO 11270 judges lateral jerk as a moving average over this time [s].
JERK_WINDOW = 0.5
# A turn back of the normalised steering by less is no reversal [-].
REVERSAL_GAP = 0.01


class Metric(NamedTuple):
    """One line of the table of metrics."""

    function: MetricFunction
    unit: str
    meaning: str
    kind: type[float] | type[int] | type[bool] = float


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


def mean_abs_lateral_error(episode: Episode) -> float:
    """Mean of |d| [m]; the paper's average lateral error (ALE)."""
    return _mean_abs(episode["lateral_error"])


def rms_lateral_error(episode: Episode) -> float:
    """Root mean square of d [m]."""
    return _rms(episode["lateral_error"])


def p95_abs_lateral_error(episode: Episode) -> float:
    """95th percentile of |d| [m], linear between order statistics."""
    return _percentile(np.abs(episode["lateral_error"]), 95.0)


def max_abs_lateral_error(episode: Episode) -> float:
    """Largest |d| [m]."""
    return _max_abs(episode["lateral_error"])


def mean_abs_heading_error(episode: Episode) -> float:
    """Mean of |yaw - path tangent| [deg]; the paper's average orientation error (AOE)."""
    return math.degrees(_mean_abs(episode["heading_error"]))


def mean_abs_course_error(episode: Episode) -> float:
    """Mean of |direction of velocity - path tangent| [deg]."""
    return math.degrees(_mean_abs(episode["course_error"]))


def steer_std(episode: Episode) -> float:
    """Standard deviation (of the population) of the normalised steering command."""
    command = episode["steer_command"]
    return float(np.std(command)) if command.size else math.nan


def steer_rate_rms(episode: Episode) -> float:
    """Root mean square of the command's differences over the control period [1/s]."""
    return _rms(_rate(episode["steer_command"], episode.dt))


def steer_change_rms(episode: Episode) -> float:
    """Root mean square of the command's change from one control step to the next [-]."""
    return _rms(_rate(episode["steer_command"], 1.0))


def steer_reversals(episode: Episode) -> float:
    """Changes of the steering's direction in a minute, those smaller than the gap left out.

    SAE J2944's steering reversal rate: a reversal is a turn back by at least ``REVERSAL_GAP``.
    """
    command = episode["steer_command"]
    if not (command.size and np.isfinite(command).all()):
        return math.nan
    return 60.0 * reversals(command, REVERSAL_GAP) / (command.size * episode.dt)


def lateral_jerk_rms(episode: Episode) -> float:
    """Root mean square of the differences of a_y over the control period [m/s^3]."""
    return _rms(_rate(episode["a_y"], episode.dt))


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


def mean_speed(episode: Episode) -> float:
    """Mean magnitude of the velocity [m/s]."""
    return _mean_abs(_speed(episode))


def max_lateral_acceleration(episode: Episode) -> float:
    """Largest |a_y| of the centre of mass [m/s^2]."""
    return _max_abs(episode["a_y"])


def distance(episode: Episode) -> float:
    """Distance driven along the path [m]."""
    return float(episode.distance)


def duration(episode: Episode) -> float:
    """Number of control steps times the control period [s]."""
    return len(episode) * float(episode.dt)


def completed(episode: Episode) -> float:
    """1 if the run reached its planned end."""
    return float(episode.completed)


def off_track(episode: Episode) -> float:
    """1 if the run ended because the car left the corridor."""
    return float(episode.end == OFF_TRACK)


def rolled_over(episode: Episode) -> float:
    """1 if the run ended because the car rolled over."""
    return float(episode.end == ROLL_OVER)


def saturated(episode: Episode) -> float:
    """Number of control steps at which the command was clipped to a limit."""
    return float(np.count_nonzero(episode["status"] == Status.SATURATED))


def fallbacks(episode: Episode) -> float:
    """Number of control steps at which the controller's fallback answered."""
    return float(np.count_nonzero(episode["status"] == Status.FALLBACK))


def interventions(episode: Episode) -> float:
    """Number of times that a supervisor took the steering from its controller."""
    away = episode["driver"] != Driver.INNER
    return float(np.count_nonzero(np.diff(away, prepend=False) & away))


def intervened(episode: Episode) -> float:
    """Time in which somebody else than the supervised controller steered [s]."""
    return float(np.count_nonzero(episode["driver"] != Driver.INNER)) * float(episode.dt)


def control_time_p50(episode: Episode) -> float:
    """Median computing time of a control step [us]."""
    return 1e6 * _percentile(episode["control_time"], 50.0)


def control_time_p99(episode: Episode) -> float:
    """99th percentile of the computing time of a control step [us]."""
    return 1e6 * _percentile(episode["control_time"], 99.0)


def control_time_max(episode: Episode) -> float:
    """Longest computing time of a control step [us]."""
    return 1e6 * _max_abs(episode["control_time"])


METRICS: dict[str, Metric] = {
    "mean_abs_lateral_error_m": Metric(mean_abs_lateral_error, "m", "mean |lateral error|"),
    "rms_lateral_error_m": Metric(rms_lateral_error, "m", "RMS of the lateral error"),
    "p95_abs_lateral_error_m": Metric(
        p95_abs_lateral_error, "m", "95th percentile of |lateral error|"
    ),
    "max_abs_lateral_error_m": Metric(max_abs_lateral_error, "m", "largest |lateral error|"),
    "mean_abs_heading_error_deg": Metric(
        mean_abs_heading_error, "deg", "mean |heading error|; includes the car's side-slip"
    ),
    "mean_abs_course_error_deg": Metric(
        mean_abs_course_error, "deg", "mean |course error|: velocity against path tangent"
    ),
    "steer_std": Metric(steer_std, "-", "standard deviation of the steering command"),
    "steer_rate_rms_per_s": Metric(
        steer_rate_rms, "1/s", "RMS rate of change of the steering command"
    ),
    "steer_change_rms": Metric(
        steer_change_rms, "-", "RMS change of the steering command in a control step"
    ),
    "steer_reversals_per_min": Metric(
        steer_reversals, "1/min", "reversals of the steering command by at least 0.01"
    ),
    "lateral_jerk_rms_m_s3": Metric(
        lateral_jerk_rms, "m/s^3", "RMS lateral jerk, differences at the control period"
    ),
    "max_lateral_jerk_500ms_m_s3": Metric(
        max_lateral_jerk_500ms, "m/s^3", "largest lateral jerk, 0.5 s moving average"
    ),
    "mean_speed_m_s": Metric(mean_speed, "m/s", "mean speed"),
    "max_lateral_acceleration_m_s2": Metric(
        max_lateral_acceleration, "m/s^2", "largest |lateral acceleration|"
    ),
    "distance_m": Metric(distance, "m", "distance driven along the path"),
    "duration_s": Metric(duration, "s", "time driven"),
    "completed": Metric(completed, "-", "the run reached its planned end", bool),
    "off_track": Metric(off_track, "-", "the car left the corridor", bool),
    "rolled_over": Metric(rolled_over, "-", "the car rolled over", bool),
    "saturated": Metric(saturated, "-", "control steps with the command clipped to a limit", int),
    "fallbacks": Metric(fallbacks, "-", "control steps answered by the controller's fallback", int),
    "interventions": Metric(interventions, "-", "times that a supervisor took the steering", int),
    "intervened_s": Metric(
        intervened, "s", "time in which the supervised controller did not steer"
    ),
    "control_time_us_p50": Metric(control_time_p50, "us", "median computing time of a step"),
    "control_time_us_p99": Metric(control_time_p99, "us", "99th percentile of the same"),
    "control_time_us_max": Metric(control_time_max, "us", "longest computing time of a step"),
}
# What is also reported over the last half of a run, when the start has died away.
STEADY = (
    "mean_abs_lateral_error_m",
    "rms_lateral_error_m",
    "p95_abs_lateral_error_m",
    "max_abs_lateral_error_m",
    "mean_abs_heading_error_deg",
    "mean_abs_course_error_deg",
    "steer_std",
    "mean_speed_m_s",
)


def last_half(episode: Episode) -> Episode:
    """The episode cut to the last half of its rows (rows are equal in time).

    Of an odd number the middle row is kept, so that a run of one row keeps it. Only the columns
    are cut; ``distance`` and ``end`` are still those of the whole run.
    """
    start = len(episode) // 2
    return replace(episode, columns={name: v[start:] for name, v in episode.columns.items()})


def _plain(metric: Metric, episode: Episode) -> float | int | bool | None:
    with np.errstate(over="ignore", invalid="ignore"):  # such a value becomes None below
        value = metric.function(episode)
    return metric.kind(value) if math.isfinite(value) else None


def evaluate(
    episode: Episode, metrics: Mapping[str, Metric] | None = None
) -> dict[str, float | int | bool | None]:
    """The value of each metric (all of ``METRICS`` by default), None where it is undefined."""
    table = METRICS if metrics is None else metrics
    return {name: _plain(metric, episode) for name, metric in table.items()}


def summarise(episode: Episode) -> dict[str, Any]:
    """All metrics of a run, how it ended, and under ``steady`` those of its last half.

    Returns:
        Plain data without NaN, ready for JSON: numbers, booleans, ``end`` as a string, ``steady``
        as a mapping; None where a metric is undefined.
    """
    steady = evaluate(last_half(episode), {name: METRICS[name] for name in STEADY})
    return {"end": episode.end, **evaluate(episode), "steady": steady}
