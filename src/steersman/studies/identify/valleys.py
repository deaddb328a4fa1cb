"""Valleys of the lateral fit: delay, lag, slow rates and inertia look alike, gradients get stuck.

So they are decided one after the other: the delay in whole steps of the integration all over, a
lag only if it clearly explains more, rates only if they limit. All work on z, see
:mod:`steersman.studies.identify.estimate`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from steersman.studies.identify.estimate import Estimate, Misses, cost, estimate, judge, search
from steersman.studies.identify.unknowns import SIGMAS
from steersman.types import FloatArray

# Delays that are tried in earnest, in steps of the integration.
_TRIED = (0, 4, 8, 12, 16, 20, 25, 30, 40)
# The search for a lag begins with one of so many prior deviations, off the bound; one of half a
# step of the integration is none.
_A_LAG, _LEAST_LAG = 0.6, 0.1
RATES = ("steer_rate_up", "steer_rate_down")


def with_lag_or_without(
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
    without = snapped(misses, without, rest, need, wanted, unsure, names, step)
    begin = without.z.copy()
    begin[lag] = start[lag] if start[lag] > _LEAST_LAG else _A_LAG
    begin[lag - 1] = max(begin[lag - 1] - begin[lag], misses.low[lag - 1])
    with_lag = estimate(misses, begin, rest, need, np.full(len(start), True))
    gain = explained(misses, with_lag, without)
    deviation = float(np.sqrt(with_lag.covariance[lag, lag]))
    clear = with_lag.z[lag] > max(SIGMAS * deviation, _LEAST_LAG)
    if with_lag.told[lag] and clear and gain > 0.5 * SIGMAS**2:
        return with_lag
    if with_lag.told[lag]:
        unsure[lag] = min(deviation, 1.0)
        without = judge(misses, without.z, without.told, need, wanted, unsure, rest)
    possible = np.array(without.possible)
    possible[lag] = unsure[lag] if with_lag.told[lag] else np.inf
    return without._replace(possible=possible)


def explained(misses: Misses, one: Estimate, other: Estimate) -> float:
    """How much more ``one`` explains, in the units of ``other``'s residuals."""
    return cost(misses(other.z), other.scales) - cost(misses(one.z), other.scales)


def without_rates(
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
    rates = [names.index(name) for name in RATES]
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
        open_to = judge(misses, trial.z, trial.told, need, wanted, unsure, rest).possible
        if (SIGMAS * open_to[rates] > need[rates]).all():
            found = trial
    found.possible[held] = unsure[held]
    return found


def snapped(
    misses: Misses,
    found: Estimate,
    rest: FloatArray,
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
    return found if z is None else judge(misses, z, found.told, need, wanted, unsure, rest)


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
