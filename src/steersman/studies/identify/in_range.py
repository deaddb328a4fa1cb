"""Which rows of a recording the model is meant for; the others are left out, and told."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.kernels.vehicle import GRAVITY
from steersman.types import FloatArray

WARM_UP = 1.0
"""Time after a start in which nothing is compared [s]."""
# Slower than this the tyres do not show in the motion [m/s]; beyond this share of the grip the car
# slides unpredictably.
_SLOWEST, _MOST_GRIP = 1.0, 0.7
# What is left over a quarter of a second, in standard deviations, that no noise of a sensor is; so
# long before and after it is left out too [s], but never more than this share of a recording: a
# model that fails so often is wrong.
_UPSET, _AROUND, _MOST_UPSET = 6.0, 0.5, 0.1
_SPAN = 0.25


class Reasons(NamedTuple):
    """Rows of a stretch that are left out, (n,) bool each."""

    slow: Any
    """Slower than the tyres show."""
    sliding: Any
    """Beyond 70 % of the grip."""
    upset: Any
    """The car moves as its commands do not explain: kerbs, bumps, gaps of a sensor."""


def reasons(speed: FloatArray, yaw_rate: FloatArray, friction: float) -> Reasons:
    """Of a stretch, at its rows (n,): speed [m/s] and yaw rate [rad/s]."""
    slow = speed < _SLOWEST
    sliding = np.abs(speed * np.nan_to_num(yaw_rate)) > _MOST_GRIP * friction * GRAVITY
    return Reasons(slow, sliding, np.zeros(len(speed), dtype=bool))


def steady(time: FloatArray, why: Reasons) -> Any:
    """Rows that lie ``WARM_UP`` behind the start, a standstill, and the edge of the grip."""
    apart = np.flatnonzero(why.slow | why.sliding)
    since = np.concatenate([time[:1], time[apart]])
    before = np.searchsorted(since, time + 1e-9, side="right") - 1
    return (time - since[before] >= WARM_UP) & ~why.upset


def upset(time: FloatArray, left: FloatArray, scales: FloatArray) -> Any:
    """Rows about which a fit leaves far more than noise, in any channel.

    Args:
        time: (rows,) [s].
        left: (rows, channels) simulated minus measured, NaN where nothing compares.
        scales: (channels,) its usual standard deviation.
    """
    rows = max(round(_SPAN / float(np.median(np.diff(time)))), 1)
    size = np.abs(np.nan_to_num(left)) / scales
    mean = np.apply_along_axis(np.convolve, 0, size, np.ones(rows) / rows, "same")
    found = near(time, time[(mean > _UPSET).any(axis=1)], _AROUND)
    return found if found.mean() <= _MOST_UPSET else np.zeros(len(time), dtype=bool)


def near(time: FloatArray, places: FloatArray, distance: float) -> Any:
    """Which times (n,) lie within ``distance`` [s] of one of ``places``, both increasing."""
    if not places.size:
        return np.zeros(len(time), dtype=bool)
    after = np.searchsorted(places, time)
    apart = [np.abs(time - places[np.clip(after - k, 0, len(places) - 1)]) for k in (0, 1)]
    return np.minimum(*apart) <= distance
