"""What is measured of a drive behind another car; undefined where there is none."""

from __future__ import annotations

import math

import numpy as np

from steersman.episode import COLLISION, LEAD_COLUMNS, Episode
from steersman.metrics.base import Metric, metric, metrics
from steersman.types import FloatArray

_NAMES = (
    "collided",
    "least_gap_m",
    "rms_gap_error_m",
    "rms_time_gap_error_s",
    "rms_longitudinal_jerk_m_s3",
)
GAP_AND_JERK = ("rms_gap_error_m", "rms_longitudinal_jerk_m_s3")
"""Those that a benchmark sums up and shows, in this order."""
# Below this speed a time gap tells nothing [m/s].
_SLOW = 1.0


def following() -> dict[str, type[Metric]]:
    """The metrics of a drive behind another car, by name."""
    known = metrics(benchmark=True)
    return {name: known[name] for name in _NAMES}


def _follows(episode: Episode) -> bool:
    return len(episode) > 0 and all(name in episode.columns for name in LEAD_COLUMNS)


def _wished(episode: Episode) -> FloatArray:
    """Gap that was wished at each step [m]."""
    given = episode.meta["config"]["lead"]
    v = np.hypot(episode["v_x"], episode["v_y"])
    return np.asarray(given["standstill"] + given["headway"] * v)


@metric("collided", "-", "the car ran into the one ahead", "lower", dtype=bool, benchmark=True)
def collided(episode: Episode) -> float:
    """1 if the run ended because the car touched the one ahead of it."""
    return float(episode.end == COLLISION) if _follows(episode) else math.nan


@metric("least_gap_m", "m", "least gap to the car ahead", "higher", benchmark=True)
def least_gap(episode: Episode) -> float:
    """Least distance to the car ahead, bumper to bumper [m]; 0 after a collision."""
    if not _follows(episode):
        return math.nan
    return 0.0 if episode.end == COLLISION else float(np.min(episode["gap"]))


@metric("rms_gap_error_m", "m", "RMS of the gap less the wished one", "lower", benchmark=True)
def rms_gap_error(episode: Episode) -> float:
    """Root mean square of the gap less the wished one [m]."""
    if not _follows(episode):
        return math.nan
    return float(np.sqrt(np.mean(np.square(episode["gap"] - _wished(episode)))))


@metric(
    "rms_time_gap_error_s",
    "s",
    "RMS of the gap's error over the own speed, from 1 m/s on",
    "lower",
    benchmark=True,
)
def rms_time_gap_error(episode: Episode) -> float:
    """Root mean square of the gap less the wished one, over the own speed [s]."""
    if not _follows(episode):
        return math.nan
    v = np.hypot(episode["v_x"], episode["v_y"])
    moves = v >= _SLOW
    if not moves.any():
        return math.nan
    error = (episode["gap"] - _wished(episode))[moves] / v[moves]
    return float(np.sqrt(np.mean(np.square(error))))


@metric(
    "rms_longitudinal_jerk_m_s3",
    "m/s^3",
    "RMS longitudinal jerk, differences at the control period",
    "lower",
    benchmark=True,
)
def rms_longitudinal_jerk(episode: Episode) -> float:
    """Root mean square of the longitudinal acceleration's differences over the period [m/s^3]."""
    change = np.diff(episode["a_x"])
    return float(np.sqrt(np.mean(np.square(change)))) / episode.dt if change.size else math.nan
