"""Statistics over few seeds: interquartile means, quartiles, bootstrap intervals, times to reach.

Sources: R. Agarwal et al., "Deep reinforcement learning at the edge of the statistical
precipice", *NeurIPS* 2021 (interquartile mean, stratified bootstrap); P. Royston and M. Parmar,
"Restricted mean survival time", *BMC Medical Research Methodology* 13, 2013.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ddpg_mpc_pid.results import SeedInterval

REPETITIONS = 2000
# Ends of the 95 % intervals.
_LEVEL = 0.95
_ENDS = (0.5 * (1.0 - _LEVEL), 0.5 * (1.0 + _LEVEL))


def iqm(values: ArrayLike) -> float:
    """Interquartile mean: the mean without the lowest and the highest quarter (rounded down).

    >>> iqm([1.0, 2.0, 3.0, 4.0, 100.0])
    3.0
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    cut = ordered.size // 4
    return float(ordered[cut : ordered.size - cut].mean()) if ordered.size else math.nan


def quartiles(values: ArrayLike) -> tuple[float, float, float]:
    """25th, 50th and 75th percentile; infinite values count as larger than all others.

    >>> quartiles([1.0, 2.0, 3.0, 4.0, 5.0])
    (2.0, 3.0, 4.0)
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    if not ordered.size:
        return (math.nan,) * 3
    low, middle, high = (_at(ordered, q) for q in (0.25, 0.5, 0.75))
    return low, middle, high


def _at(ordered: NDArray[np.float64], q: float) -> float:
    """Linear between order statistics, without inf - inf."""
    place = q * (ordered.size - 1)
    i = math.floor(place)
    share = place - i
    if share == 0.0:
        return float(ordered[i])
    return float(ordered[i] * (1.0 - share) + ordered[i + 1] * share)


def bootstrap(
    statistic: Callable[..., float],
    *groups: ArrayLike,
    repetitions: int = REPETITIONS,
    seed: int = 0,
) -> SeedInterval:
    """95 % percentile interval of ``statistic(*groups)``, each group resampled within itself.

    Returns:
        The value of the groups themselves, and the interval's ends; None where there is no data.

    With five seeds in a group the interval is rough: it cannot reach beyond what was seen.
    """
    arrays = [np.asarray(g, dtype=np.float64) for g in groups]
    if any(not a.size for a in arrays):
        return SeedInterval(value=None, low=None, high=None)
    rng = np.random.default_rng(seed)
    draws = np.array(
        [statistic(*(a[rng.integers(a.size, size=a.size)] for a in arrays))
         for _ in range(repetitions)]
    )  # fmt: skip
    draws = draws[np.isfinite(draws)]
    low, high = np.quantile(draws, _ENDS) if draws.size else (math.nan, math.nan)
    return SeedInterval(value=float(statistic(*arrays)), low=float(low), high=float(high))


def first_reach(at: Sequence[float], errors: Sequence[float], threshold: float) -> float:
    """The first of the places ``at`` whose error is at most ``threshold``; infinite if none is.

    >>> first_reach([10, 20, 30], [3.0, 1.0, 2.0], 1.5)
    20.0
    """
    pairs = zip(at, errors, strict=True)
    return next((float(x) for x, error in pairs if error <= threshold), math.inf)


def restricted_mean(times: ArrayLike, horizon: float) -> float:
    """Mean of min(time, horizon): what a run that never arrives (infinite) is charged.

    >>> restricted_mean([10.0, float("inf")], 50.0)
    30.0
    """
    return float(np.minimum(np.asarray(times, dtype=np.float64), horizon).mean())


def saving(alone: ArrayLike, helped: ArrayLike, horizon: float) -> float:
    """Share of the restricted mean time that help saves; negative if it costs.

    >>> saving([40.0, 60.0], [10.0, 40.0], 100.0)
    0.5
    """
    base = restricted_mean(alone, horizon)
    return 1.0 - restricted_mean(helped, horizon) / base if base > 0.0 else math.nan
