"""Robust least squares that finds which unknowns the data determine, and how well.

Sources: output error, Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., ch. 4, and
Ljung, *System Identification*, 2nd ed., ch. 7 and 9; Huber's loss, Huber and Ronchetti, *Robust
Statistics*, 2nd ed., ch. 7; the uncertainty of what is held fixed ("consider" covariance), Tapley,
Schutz and Born, *Statistical Orbit Determination*, ch. 6.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify.covariance import (
    HUBER,
    RIDGE,
    Information,
    choose,
    deviations,
    information,
    inverse,
    sandwich,
)
from steersman.studies.identify.misses import Misses, Selection
from steersman.studies.identify.unknowns import SIGMAS
from steersman.types import FloatArray

# Rounds of dropping unknowns, and of adapting weights within each.
_ROUNDS, _WEIGHTINGS = 4, 3
# Evaluations of one least-squares search.
_QUICK, _MOST = 5, 30
# What held unknowns add to an interval is noted beyond this share of its allowed width.
_MATTERS = 0.2
# A search that begins on a bound hardly leaves it.
_INSIDE = 0.02


class Estimate(NamedTuple):
    """Result; unknowns that are not determined stand where they are held."""

    z: FloatArray
    determined: Any
    """(p,) bool."""
    covariance: FloatArray
    """(p, p) of those determined, the uncertainty of the held ones included; 0 elsewhere."""
    given: list[int]
    """For each unknown the held one that causes most of its uncertainty, or -1."""
    possible: FloatArray
    """(p,) standard deviation that each would have if all wanted ones were searched."""
    scales: FloatArray
    """(channels,) of the residuals."""


def estimate(misses: Misses, start: FloatArray, how: Selection) -> Estimate:
    """Search from ``start``, dropping the unknowns that the data do not determine."""
    active = np.array(how.wanted)
    z = np.where(active, start, how.rest)
    for _ in range(_ROUNDS):
        z, scales = search(misses, z, active)
        of = information(misses, z, scales)
        kept = choose(of, misses.need, active)
        if (kept == active).all():
            break
        active = kept
        z = np.where(active, z, how.rest)
    return _judged(of, active, misses.need, how)


def judge(misses: Misses, z: FloatArray, determined: Any, how: Selection) -> Estimate:
    """The estimate at ``z``; of the unknowns ``determined`` so far, those that are not are held."""
    of = information(misses, z, misses.scales(z))
    return _judged(of, choose(of, misses.need, determined), misses.need, how)


def _judged(of: Information, active: Any, need: FloatArray, how: Selection) -> Estimate:
    """The estimate with ``active`` determined; its covariance includes that of the held ones."""
    p = len(of.z)
    covariance, given = np.zeros((p, p)), [-1] * p
    free, held = np.flatnonzero(active), np.flatnonzero(~active)
    if free.size:
        own = sandwich(of, free)
        shifts = -inverse(of, free) @ of.bread[np.ix_(free, held)] * how.unsure[held]
        covariance[np.ix_(free, free)] = own + shifts @ shifts.T
        for row, i in enumerate(free):
            part, least = float(shifts[row] @ shifts[row]), (_MATTERS * need[i] / SIGMAS) ** 2
            if held.size and part > max(float(own[row, row]), least):
                given[i] = int(held[np.argmax(np.abs(shifts[row]))])
    z, possible = np.where(active, of.z, how.rest), deviations(of, how.wanted)
    return Estimate(z, active, covariance, given, possible, of.scales)


def cost(left: FloatArray, scales: FloatArray) -> float:
    """Half the sum of Huber's losses."""
    size = np.nan_to_num(np.abs(left / scales))
    return float(np.sum(np.where(size < HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER))))


def search(
    misses: Misses, z: FloatArray, active: Any, *, quick: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Huber's estimate of the active unknowns, and the scales of the channels.

    If ``quick``, a few steps with the scales of the start.
    """
    from scipy.optimize import least_squares

    scales = misses.scales(z)
    free = np.flatnonzero(active)
    if not free.size:
        return z, scales

    def full(part: FloatArray) -> FloatArray:
        whole = z.copy()
        whole[free] = part
        return whole

    for _ in range(1 if quick else _WEIGHTINGS):

        def residuals(part: FloatArray, scales: FloatArray = scales) -> FloatArray:
            weighted = misses(full(part)) / scales
            pulls = np.nan_to_num(weighted.ravel())
            return np.concatenate([pulls, RIDGE * part])

        def slopes(part: FloatArray, scales: FloatArray = scales) -> FloatArray:
            some = misses.derivative(full(part), free) / scales[:, None]
            flat = np.nan_to_num(some.reshape(-1, len(free)))
            return np.vstack([flat, RIDGE * np.eye(len(free))])

        limits = (misses.low[free], misses.high[free])
        inside = np.clip(z[free], limits[0] + _INSIDE, limits[1] - _INSIDE)
        found = least_squares(
            residuals, inside, jac=slopes, bounds=limits, loss="huber", f_scale=HUBER,
            x_scale="jac", xtol=1e-6, ftol=1e-6, gtol=1e-8, max_nfev=_QUICK if quick else _MOST,
        )  # fmt: skip
        z = full(found.x)
        before, scales = scales, misses.scales(z)
        if np.allclose(before, scales, rtol=0.03):
            break
    return z, scales
