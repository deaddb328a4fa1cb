"""Smoothing splines through noisy points, as strong as the user says or as the noise asks for.

A smoothing spline minimises  sum |p_i - f(u_i)|^2 + lambda integral of |f''|^2. With the
second divided differences Q and the Gram matrix R of their hat functions, (R + lambda Q'Q) c = Q'p,
and p - f = lambda Q c at the points (Green and Silverman, *Nonparametric Regression and Generalized
Linear Models*, 1994, 2.3; on a closed path the indices go around). ``auto`` takes the lambda
with the least generalised cross-validation n RSS / trace(I - 1.4 H)^2 (Craven and Wahba,
*Numerische Mathematik* 31, 1979; 1.4 keeps it from following noise: Kim and Gu, *J. R. Statist.
Soc. B* 66, 2004), the trace from random signs (Girard, *Numerische Mathematik* 56, 1989) where
points are many.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.errors import DataError
from steersman.types import FloatArray

LEAST = 5
"""Fewest points that can be smoothed."""
# Decades of lambda over the cube of the usual spacing: next to nothing to a straight line.
_LOWEST, _HIGHEST, _STEP = -6.0, 9.0, 1.0
# Factor on trace(H).
_INFLATED = 1.4
# All traces up to this many points; for more, so many random numbers.
_EXACT, _DRAWN = 100, 6000
# Noise makes a line of chords longer. Merging half as many points again shortens it by less.
_LONGER, _COARSER = 1.03, 1.5
_LEAST_GROUPS, _MOST_GROUPS = 12, 20_000


class Smooth(NamedTuple):
    """Smoothed points."""

    place: FloatArray
    """Of each point, shape (n, 2) [m]."""
    noise: float
    """RMS distance of the points from the curve, had it not been fitted to them [m].

    Noise along the path is mostly taken for uneven distances, which it cannot be told from.
    """


def smoothed(place: FloatArray, closed: bool, rms: float | None) -> Smooth:
    """The points on a smoothing spline over the cumulated length of chords.

    Args:
        place: points, shape (n, 2) [m].
        closed: whether the last one is followed by the first.
        rms: distance that the curve keeps from the points [m]; None: by cross-validation.

    Raises:
        DataError: there are too few points, or no curve keeps that distance.
    """
    from scipy.optimize import brentq, minimize_scalar

    if len(place) < LEAST:
        raise DataError(f"smoothing needs at least {LEAST} points")
    gaps = chords(place, closed)
    unit = 3.0 * math.log10(float(np.median(gaps)))
    fit = _fits(place, gaps, closed)

    def freedom(trace: float) -> float:
        return len(place) - _INFLATED * (len(place) - trace)

    def validation(power: float) -> float:
        residual, trace = fit(power)
        free = freedom(trace)
        return float(np.sum(residual**2)) / free**2 if free > 0.0 else math.inf

    def excess(power: float) -> float:
        return _rms(fit(power)[0]) - float(rms or 0.0)

    low, high = unit + _LOWEST, unit + _HIGHEST
    if rms is None:
        grid = np.arange(low, high, _STEP)
        best = float(grid[int(np.argmin([validation(power) for power in grid]))])
        weakest = best - _STEP
        if math.isinf(validation(weakest)):  # parabolas through infinite values are none
            weakest = float(brentq(lambda power: freedom(fit(power)[1]), weakest, best))
        around = (weakest, best + _STEP)
        best = float(minimize_scalar(validation, bounds=around, options={"xatol": 0.02}).x)
    elif excess(high) < 0.0:
        raise DataError(f"no curve keeps {rms:g} m from the points; change smoothing")
    else:
        best = low if excess(low) > 0.0 else float(brentq(excess, low, high, xtol=1e-3))
    residual, trace = fit(best)
    return Smooth(place - residual, math.sqrt(float(np.sum(residual**2)) / max(trace, 1e-9)))


def _rms(residual: FloatArray) -> float:
    return math.sqrt(float(np.sum(residual**2)) / len(residual))


def _fits(
    place: FloatArray, gaps: FloatArray, closed: bool
) -> Callable[[float], tuple[FloatArray, float]]:
    """A function of log10 lambda: the residuals, and the trace of I - H."""
    from scipy.sparse.linalg import splu

    bends, gram = _matrices(len(place), gaps, closed)
    stiff, right = (bends.T @ bends).tocsc(), bends.T @ place
    count = len(place)
    looked = bends.T @ _probes(count)

    def fit(power: float) -> tuple[FloatArray, float]:
        weight = 10.0**power
        try:
            solve = splu((gram + weight * stiff).tocsc()).solve
        except RuntimeError:  # singular, but for rounding it would not be
            raise DataError(
                f"points that lie {gaps.min():.3g} m and others that lie {gaps.max():.3g} m apart"
                " cannot be smoothed together; take stray points out, or set smoothing=0"
            ) from None
        return weight * (bends @ solve(right)), weight * float(np.sum(looked * solve(looked)))

    return fit


def _probes(count: int) -> FloatArray:
    """Vectors z with the mean of z z' one, for traces: all of them, or random signs."""
    if count <= _EXACT:
        return np.eye(count)
    columns = math.ceil(_DRAWN / count)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (count, columns))
    return np.asarray(signs / math.sqrt(columns), dtype=np.float64)


def _matrices(count: int, gaps: FloatArray, closed: bool) -> tuple[Any, Any]:
    """Second divided differences Q, (n, m), and the Gram matrix R, (m, m)."""
    from scipy.sparse import csc_matrix

    middle = np.arange(count) if closed else np.arange(1, count - 1)
    before, after = gaps[middle - 1], gaps[middle]
    row = np.arange(len(middle))
    rows = np.concatenate(((middle - 1) % count, middle, (middle + 1) % count))
    values = np.concatenate((1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after))
    bends = csc_matrix((values, (rows, np.tile(row, 3))), shape=(count, len(row)))
    beside = row if closed else row[:-1]
    following = (beside + 1) % len(row)
    places = (np.concatenate((row, beside, following)), np.concatenate((row, following, beside)))
    share = after[beside] / 6.0
    gram = csc_matrix((np.concatenate(((before + after) / 3.0, share, share)), places))
    return bends, gram


def merged(place: FloatArray, least: float) -> NDArray[np.int64]:
    """The group of each point, so that the means of groups lie in the order of driving.

    Where noise is as large as the way between points, they go back and forth, and the line of their
    chords is longer than the path. Groups grow until larger ones would not shorten that line; a
    car that stands leaves one group.

    Args:
        place: points, shape (n, 2) [m].
        least: points within this of the first of a group are of it, whatever their noise [m].
    """
    gaps = chords(place, closed=False)
    least = max(least, float(np.sum(gaps)) / _MOST_GROUPS if len(place) > _MOST_GROUPS else 0.0)
    groups = _groups(place, least)
    length = _length(means(place, groups))
    wide = max(_COARSER * least, _COARSER * float(np.median(gaps)))
    while True:
        coarser = _groups(place, wide)
        if coarser[-1] + 1 < _LEAST_GROUPS:
            return groups
        shorter = _length(means(place, coarser))
        if length < _LONGER * shorter:
            return groups
        groups, length, wide = coarser, shorter, wide * _COARSER


def means(values: FloatArray, groups: NDArray[np.int64]) -> FloatArray:
    """The mean of each group, rows for groups."""
    flat = values.reshape(len(values), -1)
    sums = [np.bincount(groups, column) for column in flat.T]
    found = np.stack(sums, axis=1) / np.bincount(groups)[:, None]
    return found.reshape(-1, *values.shape[1:])


def _groups(place: FloatArray, wide: float) -> NDArray[np.int64]:
    """Groups of points that are nearer than ``wide`` to the first of the group [m]."""
    out = np.empty(len(place), dtype=np.int64)
    group, first = 0, place[0].tolist()
    for row, point in enumerate(place.tolist()):
        if math.dist(point, first) >= wide:
            group, first = group + 1, point
        out[row] = group
    return out


def _length(place: FloatArray) -> float:
    """Length of the line of chords, and half a chord beyond its ends, where groups begin [m]."""
    gaps = chords(place, closed=False)
    return float(np.sum(gaps)) * len(place) / len(gaps) if len(gaps) else 0.0


def chords(place: FloatArray, closed: bool) -> FloatArray:
    """Lengths of the chords; the last one of a closed line leads to its first point [m]."""
    line = np.concatenate((place, place[:1])) if closed else place
    out: FloatArray = np.hypot(*np.diff(line, axis=0).T)
    return out
