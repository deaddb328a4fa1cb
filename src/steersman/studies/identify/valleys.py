"""Valleys of the lateral fit: delay, lag, slow rates and inertia look alike, gradients get stuck.

So they are decided one after the other: the delay in whole steps of the integration all over, a
lag only if it clearly explains more, rates only if they limit. All work on z, see
:mod:`steersman.studies.identify.estimate`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from steersman.studies.identify.estimate import Estimate, cost, estimate, judge, search
from steersman.studies.identify.misses import Misses, Selection
from steersman.studies.identify.unknowns import SIGMAS
from steersman.types import FloatArray

# Delays that are tried in earnest, in steps of the integration.
_TRIED = (0, 4, 8, 12, 16, 20, 25, 30, 40)
# The search for a lag begins with one of so many prior deviations, off the bound; one of half a
# step of the integration is none.
_A_LAG, _LEAST_LAG = 0.6, 0.1
RATES = ("steer_rate_up", "steer_rate_down")


def delay_of(names: Sequence[str]) -> int:
    """Where the delay stands: of the command, or of the measured angle."""
    return next(i for i, name in enumerate(names) if name in {"steer_delay", "clock[wheel_angle]"})


def with_lag_or_without(
    misses: Misses, begun: FloatArray, at: float, how: Selection, step: float
) -> Estimate:
    """The fit without a lag, unless the one with a lag explains clearly more.

    The search begins at ``begun``, that for a lag at its z ``at`` if that is one.

    A lag that cannot be told from none is none: the simpler model explains as much. The fit with
    it begins where the other ended, part of the delay (the unknown before it) exchanged for it.
    ``step`` is that of the integration, as a difference of the delay's z.
    """
    lag = misses.names.index("steer_lag")
    without_lag = how.without(lag)
    without = estimate(misses, begun, without_lag)
    without = snapped(misses, without, without_lag, step)
    begin = without.z.copy()
    begin[lag] = at if at > _LEAST_LAG else _A_LAG
    begin[lag - 1] = max(begin[lag - 1] - begin[lag], misses.low[lag - 1])
    with_lag = estimate(misses, begin, how)
    gain = explained(misses, with_lag, without)
    deviation = float(np.sqrt(with_lag.covariance[lag, lag]))
    clear = with_lag.z[lag] > max(SIGMAS * deviation, _LEAST_LAG)
    if with_lag.determined[lag] and clear and gain > 0.5 * SIGMAS**2:
        return with_lag
    most = np.inf
    if with_lag.determined[lag]:
        most = without_lag.unsure[lag] = min(deviation, 1.0)
        without = judge(misses, without.z, without.determined, without_lag)
    without.possible[lag] = most
    return without


def explained(misses: Misses, one: Estimate, other: Estimate) -> float:
    """How much more ``one`` explains, in the units of ``other``'s residuals."""
    return cost(misses(other.z), other.scales) - cost(misses(one.z), other.scales)


def without_rates(misses: Misses, found: Estimate, how: Selection) -> Estimate:
    """The estimate, or one with the rates held if it explains as much and they limit nothing there.

    Slow rates that look like a lag are a valley of their own, out of which this leads.
    """
    rates = [misses.names.index(name) for name in RATES]
    if not found.determined[rates].any():
        return found
    held, begin, rest = ~how.wanted, found.z.copy(), how.rest
    how = how._replace(unsure=np.where(held, np.minimum(found.possible, 1.0), 1.0))
    begin[rates] = rest[rates]
    trial = estimate(misses, begin, how.without(rates))
    gain = -explained(misses, trial, found)
    if gain < -1.0:
        found = estimate(misses, np.where(trial.determined, trial.z, begin), how)
    elif gain <= len(rates) * 0.5 * SIGMAS**2:
        open_to = judge(misses, trial.z, trial.determined, how).possible
        if (SIGMAS * open_to[rates] > misses.need[rates]).all():
            found = trial
    found.possible[held] = how.unsure[held]
    return found


def snapped(misses: Misses, found: Estimate, how: Selection, step: float) -> Estimate:
    """The estimate, or one whose delay is a whole number of steps nearby if that is better."""
    delay = delay_of(misses.names)
    others = np.array(found.determined)
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
    return found if z is None else judge(misses, z, found.determined, how)


def whole_delay(misses: Misses, z: FloatArray, how: Selection, step: float) -> FloatArray:
    """The best whole number of integration steps as delay, everything else searched at each.

    A command that jumps from row to row makes the acceleration jump at the very row or not,
    depending on the delay, and slow rates and inertia look like delays: the sum of squares has
    kinks and valleys, in which gradients get stuck. So delays are tried all over, then downhill.
    """
    delay = delay_of(misses.names)
    others = how.without(delay).wanted
    begin = np.where(how.wanted, z, 0.0)
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
