"""The lateral fit: delay, lag, rates, ratio and bias of the steering; stiffnesses and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from steersman.engine.jobs import Workers
from steersman.studies.identify import in_range, stretch_replay
from steersman.studies.identify.estimate import estimate
from steersman.studies.identify.lateral import Fitted, measured, misses_of, searched, simulated
from steersman.studies.identify.lateral_start import begun as begun_at
from steersman.studies.identify.misses import Selection
from steersman.studies.identify.recording import Log
from steersman.studies.identify.stretch_replay import Stretch
from steersman.studies.identify.unknowns import sensors_at, vehicle_at
from steersman.studies.identify.valleys import RATES, delay_of, snapped, without_rates
from steersman.vehicles import Vehicle

# Lateral acceleration that a tenth of a recording exceeds unless the car drives straight [m/s^2].
_LEAST_TURN = 0.3


def fit(
    vehicle: Vehicle,
    log: Log,
    stretches: Sequence[Stretch],
    use: Any,
    before: Fitted | None = None,
    workers: Workers | None = None,
) -> Fitted:
    """Search the figures of steering, tyres and inertia; ``use`` (rows,) bool are fitted.

    ``before`` is an earlier fit of the same recording, from which this one goes on. Without it
    delays and rates are tried all over, and whether there is a lag is decided, on the part of a
    long recording that tells most of it; by ``workers`` if there are two starts.
    """
    unknowns = searched(vehicle, log)
    misses = misses_of(vehicle, log, stretches, unknowns, use)
    names, everything = misses.names, Selection.of(misses)
    if not _turns(log, stretches):
        some = np.array([u.sensor or u.field == "steer_bias" for u in unknowns])
        found = estimate(misses, everything.rest, everything._replace(wanted=some))
        return Fitted(unknowns, found, vehicle_at(vehicle, unknowns, found.z), everything.rest)
    if before is not None:
        begun, rest = before.estimate, before.rest
    else:
        begun, rest = begun_at(vehicle, log, stretches, use, workers or Workers("local", 1))
    how = Selection.of(misses, rest)
    delay = delay_of(names)
    if not log.by_angle:
        lag = names.index("steer_lag")
        if not (begun.determined[lag] or unknowns[lag].start > 0.0):
            how = how.without(lag)
        how.unsure[lag] = min(begun.possible[lag], 1.0)
    step = stretch_replay.H / unknowns[delay].prior
    found = snapped(misses, estimate(misses, begun.z, how), how, step)
    if not log.by_angle:
        found = without_rates(misses, found, how)
        if not how.wanted[lag]:
            found.possible[lag] = begun.possible[lag]
    at_least = {n for n, r in zip(names, rest, strict=True) if r > 0.0 and n in RATES}
    kept = {n for n, determined in zip(names, found.determined, strict=True) if not determined}
    fitted = vehicle_at(vehicle, unknowns, found.z)
    return Fitted(unknowns, found, fitted, rest, frozenset(at_least & kept))


def without_upsets(
    fitted: Fitted, log: Log, stretches: Sequence[Stretch], use: Any
) -> list[Stretch]:
    """The stretches without the rows about which a fit leaves far more than noise."""
    sensors = sensors_at(fitted.unknowns, fitted.estimate.z, log.yaw_rate_lag)
    left = simulated(fitted.vehicle, log, stretches, sensors) - measured(log, stretches, use)
    found = in_range.upset(log.time, left, fitted.estimate.scales)
    return [stretch.without(found[stretch.rows]) for stretch in stretches]


def _turns(log: Log, stretches: Sequence[Stretch]) -> bool:
    """Whether the car turns at all; of one that does not, only the bias shows."""
    sideways = [
        stretch_replay.at_rows(stretch, stretch.speed) * log.signals["yaw_rate"][stretch.rows]
        for stretch in stretches
    ]
    known = np.abs(np.nan_to_num(np.concatenate(sideways)))
    return float(np.percentile(known, 90.0)) > _LEAST_TURN
