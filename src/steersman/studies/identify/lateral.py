"""The lateral fit: delay, lag, rates, ratio and bias of the steering; stiffnesses and inertia."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify import replayed
from steersman.studies.identify.estimate import (
    Estimate,
    Misses,
    cost,
    estimate,
    judge,
    scale_of,
    search,
)
from steersman.studies.identify.log import RESOLUTION, RESPONSES, Log
from steersman.studies.identify.replayed import Stretch
from steersman.studies.identify.unknowns import (
    SIGMAS,
    Unknown,
    offsets_at,
    steering,
    vehicle_at,
)
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Delays [s] and factors on the steering rates from which the search may start.
_DELAYS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4)
# Delays that are tried in earnest, in steps of the integration.
_TRIED = (0, 4, 8, 12, 16, 20, 25, 30, 40)
_RATES = (1.0, 0.25, 0.5, 2.0, 4.0)
# Another start has to leave this share less of the residuals' variance.
_BETTER = 0.02
# The search for a lag begins with one of so many prior deviations, off the bound.
_A_LAG = 0.6
# Differences that tell of delay and lag: below the step of the integration they show in part.
_COARSE = {"steer_delay": 0.1, "steer_lag": 0.3}
# In prior deviations: half a step of the integration.
_LEAST_LAG = 0.1
_RATE_FIELDS = ("steer_rate_up", "steer_rate_down")


class Fitted(NamedTuple):
    """One fit: what was looked for, what came out, and the vehicle of it."""

    unknowns: list[Unknown]
    estimate: Estimate
    vehicle: Vehicle
    rest: FloatArray
    """What figures that are not told return to (z)."""
    at_least: frozenset[str] = frozenset()
    """Figures that rest where the log says that they are at least."""


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
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], offsets: dict[str, float]
) -> FloatArray:
    """(rows, channels), at the recorded speed; NaN outside stretches."""
    names = channels(log)
    out = np.full((len(log.time), len(names)), np.nan)
    for stretch in stretches:
        states = replayed.lateral(vehicle, stretch)
        out[stretch.rows] = replayed.responses(vehicle, stretch, states, names, offsets)
    return out


def misses_of(
    vehicle: Vehicle,
    log: Log,
    stretches: Sequence[Stretch],
    unknowns: Sequence[Unknown],
    use: Any,
) -> Misses:
    """What the figures of z leave."""
    seen = measured(log, stretches, use)
    low, high = np.array([u.bounds() for u in unknowns]).T

    def of(z: FloatArray) -> FloatArray:
        guess = vehicle_at(vehicle, unknowns, z)
        return simulated(guess, log, stretches, offsets_at(unknowns, z)) - seen

    least = np.array([RESOLUTION[name] for name in channels(log)])
    coarse = np.array([_COARSE.get(u.field, 0.0) for u in unknowns])
    return Misses(of, low, high, least, coarse)


def fit(
    vehicle: Vehicle,
    log: Log,
    stretches: Sequence[Stretch],
    use: Any,
    before: Fitted | None = None,
) -> Fitted:
    """Search all that steers; ``use`` (rows,) bool are fitted.

    ``before`` is an earlier fit of the same recording, from which this one goes on. Without it
    delays and rates are tried all over, and whether there is a lag is decided.
    """
    unknowns = steering(vehicle, channels(log))
    names = [u.name for u in unknowns]
    lag = names.index("steer_lag")
    step = replayed.H / unknowns[names.index("steer_delay")].prior
    misses = misses_of(vehicle, log, stretches, unknowns, use)
    need, wanted = np.array([u.need_z for u in unknowns]), np.full(len(unknowns), True)
    if before is not None:
        rest, unsure = before.rest, np.ones(len(unknowns))
        wanted[lag] = before.estimate.told[lag] or unknowns[lag].start > 0.0
        unsure[lag] = min(before.estimate.possible[lag], 1.0)
        found = estimate(misses, before.estimate.z, rest, need, wanted, unsure)
        found = _snapped(misses, found, need, wanted, unsure, names, step)
        if not wanted[lag]:
            found.possible[lag] = before.estimate.possible[lag]
    else:
        start, rest = _start(vehicle, log, stretches, unknowns, use)
        if unknowns[lag].start > 0.0:
            found = estimate(misses, start, rest, need, wanted)
        else:
            found = _with_lag_or_without(misses, start, rest, need, names, step)
    looked_for = np.full(len(unknowns), True)
    looked_for[lag] = found.told[lag] or unknowns[lag].start > 0.0
    found = _without_rates(misses, found, rest, need, looked_for, names)
    at_least = {n for n, r in zip(names, rest, strict=True) if r > 0.0 and n in _RATE_FIELDS}
    kept = {n for n, told in zip(names, found.told, strict=True) if not told}
    fitted = vehicle_at(vehicle, unknowns, found.z)
    return Fitted(unknowns, found, fitted, rest, frozenset(at_least & kept))


def _with_lag_or_without(
    misses: Misses,
    start: FloatArray,
    rest: FloatArray,
    need: FloatArray,
    names: Sequence[str],
    step: float,
) -> Estimate:
    """Both fits; the one without a lag unless the other is clearly better.

    A lag that cannot be told from none is none: the simpler model explains as much. The fit with
    it begins where the other ended, part of the delay (the unknown before it) exchanged for it.
    """
    lag = names.index("steer_lag")
    wanted, unsure = np.full(len(start), True), np.ones(len(start))
    wanted[lag] = False
    begun = _whole_delay(misses, start, wanted, names, step)
    without = estimate(misses, begun, rest, need, wanted)
    without = _snapped(misses, without, need, wanted, unsure, names, step)
    begin = without.z.copy()
    begin[lag] = start[lag] if start[lag] > _LEAST_LAG else _A_LAG
    begin[lag - 1] = max(begin[lag - 1] - begin[lag], misses.low[lag - 1])
    with_lag = estimate(misses, begin, rest, need, np.full(len(start), True))
    gain = cost(misses(without.z), without.scales) - cost(misses(with_lag.z), without.scales)
    deviation = float(np.sqrt(with_lag.covariance[lag, lag]))
    clear = with_lag.z[lag] > max(SIGMAS * deviation, _LEAST_LAG)
    if with_lag.told[lag] and clear and gain > 0.5 * SIGMAS**2:
        return with_lag
    if with_lag.told[lag]:
        unsure[lag] = min(deviation, 1.0)
        without = judge(misses, without.z, without.told, need, wanted, unsure)
    possible = np.array(without.possible)
    possible[lag] = unsure[lag] if with_lag.told[lag] else np.inf
    return without._replace(possible=possible)


def _without_rates(
    misses: Misses,
    found: Estimate,
    rest: FloatArray,
    need: FloatArray,
    wanted: Any,
    names: Sequence[str],
) -> Estimate:
    """The estimate, or one whose rates rest if it explains as much and they limit nothing there.

    Slow rates that look like a lag are a valley of their own, out of which this leads.
    """
    rates = [names.index(name) for name in _RATE_FIELDS]
    if not found.told[rates].any():
        return found
    others, begin, unsure = np.array(wanted), found.z.copy(), np.ones(len(rest))
    others[rates] = False
    begin[rates] = rest[rates]
    held = ~np.array(wanted)
    unsure[held] = np.minimum(found.possible[held], 1.0)
    trial = estimate(misses, begin, rest, need, others, unsure)
    gain = cost(misses(trial.z), found.scales) - cost(misses(found.z), found.scales)
    if gain < -1.0:
        again = np.where(trial.told, trial.z, begin)
        found = estimate(misses, again, rest, need, wanted, unsure)
    elif gain <= len(rates) * 0.5 * SIGMAS**2:
        open_to = judge(misses, trial.z, trial.told, need, wanted, unsure).possible
        if (SIGMAS * open_to[rates] > need[rates]).all():
            found = trial
    found.possible[held] = unsure[held]
    return found


def _snapped(
    misses: Misses,
    found: Estimate,
    need: FloatArray,
    wanted: Any,
    unsure: FloatArray,
    names: Sequence[str],
    step: float,
) -> Estimate:
    """The estimate, or one whose delay is a whole number of steps nearby if that is better."""
    delay = names.index("steer_delay")
    others = np.array(found.told)
    others[delay] = False
    best, z = cost(misses(found.z), found.scales), None
    near = math.floor(found.z[delay] / step)
    for k in (near, near + 1):
        begin = found.z.copy()
        begin[delay] = np.clip(k * step, misses.low[delay], misses.high[delay])
        trial, _ = search(misses, begin, others)
        value = cost(misses(trial), found.scales)
        if value < best:
            best, z = value, trial
    return found if z is None else judge(misses, z, found.told, need, wanted, unsure)


def _whole_delay(
    misses: Misses, z: FloatArray, wanted: Any, names: Sequence[str], step: float
) -> FloatArray:
    """The best whole number of integration steps as delay, everything else searched at each.

    A command that jumps from row to row makes the acceleration jump at the very row or not, as
    the delay is, and slow rates and inertia look like delays: the sum of squares has kinks and
    valleys, in which gradients get stuck. So delays are tried all over, and then downhill.
    """
    delay, others = names.index("steer_delay"), np.array(wanted)
    others[delay] = False
    begin = np.where(wanted, z, 0.0)
    scales = misses.scales(search(misses, begin, others, quick=True)[0])
    found: dict[int, tuple[float, FloatArray]] = {}

    def at(k: int) -> float:
        if k not in found:
            near = min(found, key=lambda other: abs(other - k), default=None)
            z = (begin if near is None else found[near][1]).copy()
            z[delay] = np.clip(k * step, misses.low[delay], misses.high[delay])
            z, _ = search(misses, z, others, quick=True)
            found[k] = (cost(misses(z), scales), z)
        return found[k][0]

    now = round(begin[delay] / step)
    best = min((now, *_TRIED), key=at)
    while (near := min((best, best - 1, best + 1), key=at)) != best:
        best = near
    return found[best][1]


def _start(
    vehicle: Vehicle,
    log: Log,
    stretches: Sequence[Stretch],
    unknowns: Sequence[Unknown],
    use: Any,
) -> tuple[FloatArray, FloatArray]:
    """Where to start, and where to return to: the best of some delays, rates, and the ratio there.

    For each the measured yaw rate is regressed on the simulated one, outliers left out.
    """
    names = [u.name for u in unknowns]
    seen = measured(log, stretches, use)[:, 0]
    best, chosen = np.inf, (0.0, 1.0, 1.0)
    for factor in _RATES:
        rates = {name: getattr(vehicle, name) * factor for name in _RATE_FIELDS}
        for delay in sorted({*_DELAYS, vehicle.steer_delay}):
            guess = vehicle.replace(steer_delay=delay, **rates)
            answer = simulated(guess, log, stretches, {})[:, 0]
            gain, left = _regressed(answer, seen)
            if left < (1.0 - _BETTER) * best:
                best, chosen = left, (delay, factor, gain)
    delay, factor, gain = chosen
    z, rest = np.zeros(len(unknowns)), np.zeros(len(unknowns))
    for name, value in (
        ("steer_delay", delay),
        ("max_wheel_angle", vehicle.max_wheel_angle * min(max(gain, 0.25), 4.0)),
        *((name, getattr(vehicle, name) * factor) for name in _RATE_FIELDS),
    ):
        i = names.index(name)
        z[i] = np.clip(unknowns[i].z(value), *unknowns[i].bounds())
        if name in _RATE_FIELDS:
            rest[i] = z[i]
    return z, rest


def _regressed(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope of y on x and the robust scale of what is left."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < 3 or float(np.ptp(x)) == 0.0:  # noqa: PLR2004 - a line and one more
        return 1.0, float(scale_of((y - np.mean(y))[:, None])[0]) if len(y) else 1.0
    gain, shift = 1.0, 0.0
    keep = np.full(len(x), True)
    for _ in range(3):
        gain, shift = np.polyfit(x[keep], y[keep], 1)
        left = np.abs(y - gain * x - shift)
        keep = left <= max(4.0 * 1.4826 * float(np.median(left)), 1e-12)
    return float(gain), float(np.sqrt(np.mean(left[keep] ** 2)))
