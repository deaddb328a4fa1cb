"""What the lateral fit compares: signals as measured, and as a vehicle would give them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify import stretch_replay
from steersman.studies.identify.estimate import Estimate
from steersman.studies.identify.misses import Misses
from steersman.studies.identify.recording import RESOLUTION, RESPONSES, Log
from steersman.studies.identify.stretch_replay import Stretch
from steersman.studies.identify.unknowns import (
    Sensors,
    Unknown,
    guess_at,
    sensors_at,
    steering,
)
from steersman.types import FloatArray
from steersman.vehicles import Vehicle


class Fitted(NamedTuple):
    """One fit: its unknowns, their estimate, and the fitted vehicle."""

    unknowns: list[Unknown]
    estimate: Estimate
    vehicle: Vehicle
    rest: FloatArray
    """z of the figures that the log does not determine."""
    at_least: frozenset[str] = frozenset()
    """Figures that are held at a value which the log shows to be a lower bound."""


def channels(log: Log) -> list[str]:
    """The measured signals that the lateral fit compares."""
    return [name for name in RESPONSES if log.get(name) is not None]


def measured(log: Log, stretches: Sequence[Stretch], use: Any) -> FloatArray:
    """(rows, channels); NaN where a stretch is not steady, and where not in ``use``."""
    names = channels(log)
    out = np.full((len(log.time), len(names)), np.nan)
    for stretch in stretches:
        for k, name in enumerate(names):
            part = log.signals[name][stretch.rows]
            out[stretch.rows, k] = np.where(stretch.steady & use[stretch.rows], part, np.nan)
    return out


def simulated(
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], sensors: Sensors
) -> FloatArray:
    """(rows, channels), at the recorded speed; NaN outside stretches."""
    names = channels(log)
    out = np.full((len(log.time), len(names)), np.nan)
    for stretch in stretches:
        states = stretch_replay.lateral(vehicle, stretch, sensors.clock)
        out[stretch.rows] = stretch_replay.responses(vehicle, stretch, states, names, sensors)
    return out


def searched(vehicle: Vehicle, log: Log) -> list[Unknown]:
    """The unknowns of the lateral fit of a recording."""
    unknowns = steering(vehicle, channels(log), by_angle=log.by_angle)
    if log.yaw_rate_offset is None:
        return unknowns
    return [u for u in unknowns if u.name != "offset[yaw_rate]"]


def misses_of(
    vehicle: Vehicle,
    log: Log,
    stretches: Sequence[Stretch],
    unknowns: Sequence[Unknown],
    use: Any,
) -> Misses:
    """Simulated minus measured signals as a function of z."""
    seen = measured(log, stretches, use)

    def of(z: FloatArray) -> FloatArray:
        guess = guess_at(vehicle, unknowns, z)
        sensors = sensors_at(unknowns, z, log.yaw_rate_lag)
        return simulated(guess, log, stretches, sensors) - seen

    return Misses(of, unknowns, np.array([RESOLUTION[name] for name in channels(log)]))
