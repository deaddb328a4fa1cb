"""Robust least squares that finds which unknowns the data determine, and how well.

Sources: output error, Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., ch. 4, and
Ljung, *System Identification*, 2nd ed., ch. 7 and 9; Huber's loss and its covariance, Huber and
Ronchetti, *Robust Statistics*, 2nd ed., ch. 7; covariance with coloured residuals, Morelli and
Klein, *Accuracy of aerodynamic model parameters*, J. Guidance 20(1), 1997; the uncertainty of
what is held fixed ("consider" covariance), Tapley, Schutz and Born, *Statistical Orbit
Determination*, ch. 6.

Unknowns are z, standardised: 0 is the prior value, 1 is one prior standard deviation above it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify.unknowns import SIGMAS, Unknown
from steersman.types import FloatArray

# Beyond so many deviations a residual pulls no harder (95 % efficient with normal noise).
HUBER = 1.345
# Weight of the prior: keeps unknowns that the data do not determine from running away.
_RIDGE = 0.05
_STEP = 1e-3
# Residuals are taken for correlated over no more than this share of the rows, and so many rows.
_LAGS, _MOST_LAGS = 0.02, 60
# Rounds of dropping unknowns, and of adapting weights within each.
_ROUNDS, _WEIGHTINGS = 4, 3
# Evaluations of one least-squares search.
_QUICK, _MOST = 5, 30
# What held unknowns add to an interval is noted beyond this share of its allowed width.
_MATTERS = 0.2
# A search that begins on a bound hardly leaves it.
_INSIDE = 0.02
# Mean square of Huber's normal residuals: less is no sign of a better sensor.
_NORMAL = 0.7


class Misses:
    """Simulated minus measured signals of a vehicle at z, and how they change with z."""

    def __init__(
        self,
        of: Callable[[FloatArray], FloatArray],
        unknowns: Sequence[Unknown],
        least: FloatArray,
    ) -> None:
        """Bind z to what is compared.

        Args:
            of: z -> (rows, channels) simulated minus measured, NaN where nothing compares.
            unknowns: what the elements of z (p,) are.
            least: (channels,) standard deviations below which no residual is taken for noise.
        """
        self._of, self._least = of, least
        self.low, self.high = np.array([u.bounds() for u in unknowns]).T
        self.need = np.array([u.need_z for u in unknowns])
        """(p,) half width of the 95 % interval beyond which an unknown is not determined."""
        self.names = [u.name for u in unknowns]
        self._coarse = np.array([u.coarse for u in unknowns])

    def __call__(self, z: FloatArray) -> FloatArray:
        """(rows, channels)."""
        return self._of(z)

    def scales(self, z: FloatArray) -> FloatArray:
        """Standard deviation of each channel's residuals, by their median: (channels,)."""
        return np.maximum(scale_of(self(z)), self._least)

    def derivative(self, z: FloatArray, which: Any = None, *, wide: bool = False) -> FloatArray:
        """(rows, channels, len(which)) by small differences away from the nearer bound.

        If ``wide``, to both sides, and over as much as the unknowns' ``coarse``, for intervals.
        """
        here, columns = self(z), []
        for i in np.arange(len(z)) if which is None else which:
            ends = [(z[i], here)]
            up = self.high[i] - z[i] > z[i] - self.low[i]
            step = max(self._coarse[i], _STEP) if wide else _STEP
            for side in (-1.0, 1.0) if wide else (1.0 if up else -1.0,):
                moved = z.copy()
                moved[i] = min(max(z[i] + side * step, self.low[i]), self.high[i])
                ends.append((moved[i], self(moved)))
            (low, before), (high, after) = ends[-2:]
            columns.append((after - before) / (high - low))
        return np.stack(columns, axis=-1)


class Selection(NamedTuple):
    """Which unknowns are searched, and where and how uncertain the held ones are."""

    wanted: Any
    """(p,) bool: those that are searched."""
    rest: FloatArray
    """(p,) z of those that are held, or not determined."""
    unsure: FloatArray
    """(p,) standard deviation of those that are held."""

    @classmethod
    def of(cls, misses: Misses, rest: FloatArray | None = None) -> Selection:
        """All unknowns; what is not determined returns to ``rest`` or the prior."""
        p = len(misses.need)
        return cls(np.full(p, True), np.zeros(p) if rest is None else rest, np.ones(p))

    def without(self, which: Any) -> Selection:
        """The same, but with the unknowns at ``which`` held."""
        wanted = np.array(self.wanted)
        wanted[which] = False
        return Selection(wanted, self.rest, self.unsure.copy())


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
        of = _information(misses, z, scales)
        kept = _choose(of, misses.need, active)
        if (kept == active).all():
            break
        active = kept
        z = np.where(active, z, how.rest)
    return _judged(of, active, misses.need, how)


def judge(misses: Misses, z: FloatArray, determined: Any, how: Selection) -> Estimate:
    """The estimate at ``z``; of the unknowns ``determined`` so far, those that are not are held."""
    of = _information(misses, z, misses.scales(z))
    return _judged(of, _choose(of, misses.need, determined), misses.need, how)


def _judged(of: _Information, active: Any, need: FloatArray, how: Selection) -> Estimate:
    """The estimate with ``active`` determined; its covariance includes that of the held ones."""
    p = len(of.z)
    covariance, given = np.zeros((p, p)), [-1] * p
    free, held = np.flatnonzero(active), np.flatnonzero(~active)
    if free.size:
        own = _sandwich(of, free)
        shifts = -_inverse(of, free) @ of.bread[np.ix_(free, held)] * how.unsure[held]
        covariance[np.ix_(free, free)] = own + shifts @ shifts.T
        for row, i in enumerate(free):
            part, least = float(shifts[row] @ shifts[row]), (_MATTERS * need[i] / SIGMAS) ** 2
            if held.size and part > max(float(own[row, row]), least):
                given[i] = int(held[np.argmax(np.abs(shifts[row]))])
    z, possible = np.where(active, of.z, how.rest), _deviations(of, how.wanted)
    return Estimate(z, active, covariance, given, possible, of.scales)


def cost(left: FloatArray, scales: FloatArray) -> float:
    """Half the sum of Huber's losses."""
    size = np.nan_to_num(np.abs(left / scales))
    return float(np.sum(np.where(size < HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER))))


def scale_of(misses: FloatArray) -> FloatArray:
    """Standard deviation of each channel's residuals, by their median: (channels,)."""
    out = np.ones(misses.shape[1])
    for k, column in enumerate(misses.T):
        known = column[np.isfinite(column)]
        if known.size:
            spread = 1.4826 * float(np.median(np.abs(known - np.median(known))))
            out[k] = spread
    return out


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
            return np.concatenate([pulls, _RIDGE * part])

        def slopes(part: FloatArray, scales: FloatArray = scales) -> FloatArray:
            some = misses.derivative(full(part), free) / scales[:, None]
            flat = np.nan_to_num(some.reshape(-1, len(free)))
            return np.vstack([flat, _RIDGE * np.eye(len(free))])

        limits = (misses.low[free], misses.high[free])
        inside = np.clip(z[free], limits[0] + _INSIDE, limits[1] - _INSIDE)
        found = least_squares(
            residuals, inside, jac=slopes, bounds=limits, loss="huber", f_scale=HUBER,
            x_scale="jac", xtol=1e-7, ftol=1e-7, gtol=1e-8, max_nfev=_QUICK if quick else _MOST,
        )  # fmt: skip
        z = full(found.x)
        before, scales = scales, misses.scales(z)
        if np.allclose(before, scales, rtol=0.03):
            break
    return z, scales


class _Information(NamedTuple):
    """Bread and meat of the sandwich estimate of the covariance at ``z``, (p, p) each."""

    z: FloatArray
    scales: FloatArray
    bread: FloatArray
    white: FloatArray
    """The meat if residuals were uncorrelated."""
    meat: FloatArray


def _information(misses: Misses, z: FloatArray, scales: FloatArray) -> _Information:
    """Sums over rows and channels; the meat with the residuals' autocovariance.

    The window and the autocovariance are both positive semi-definite, and so is the meat.
    """
    jacobian, left = misses.derivative(z, wide=True), misses(z)
    known = np.isfinite(left)
    size = np.where(known, left, 0.0) / scales
    slopes = np.nan_to_num(jacobian) / scales[:, None] * known[..., None]
    pull, linear = np.clip(size, -HUBER, HUBER), known & (np.abs(size) < HUBER)
    p = len(z)
    bread, white, extra = np.zeros((p, p)), np.zeros((p, p)), np.zeros((p, p))
    for c in range(size.shape[1]):
        count = int(known[:, c].sum())
        if not count:
            continue
        j, r = slopes[:, c], pull[:, c]
        square = j.T @ j
        bread += square * float(linear[:, c].sum()) / count
        white += square * max(float(r @ r) / count, _NORMAL)
        lags = min(int(_LAGS * count) + 1, _MOST_LAGS)
        for lag in range(1, lags):
            weight = (1.0 - lag / lags) * float(r[lag:] @ r[:-lag]) / count
            product = j[lag:].T @ j[:-lag]
            extra += weight * (product + product.T)
    return _Information(z, scales, bread, white, white + extra)


def _inverse(of: _Information, free: Any) -> FloatArray:
    inner = of.bread[np.ix_(free, free)] + _RIDGE**2 * np.eye(len(free))
    return np.asarray(np.linalg.inv(inner))


def _sandwich(of: _Information, free: Any) -> FloatArray:
    """Covariance of the free unknowns, never narrower than with uncorrelated residuals."""
    inverse, ridge, at = _inverse(of, free), _RIDGE**2 * np.eye(len(free)), np.ix_(free, free)
    white, full = (inverse @ (meat[at] + ridge) @ inverse for meat in (of.white, of.meat))
    factor = np.sqrt(np.maximum(np.diag(white) / np.diag(full), 1.0))
    return np.asarray(full * np.outer(factor, factor))


def _deviations(of: _Information, active: Any) -> FloatArray:
    """(p,) standard deviations if all active ones are searched, infinity elsewhere."""
    out = np.full(len(of.bread), np.inf)
    free = np.flatnonzero(active)
    if free.size:
        out[free] = np.sqrt(np.diag(_sandwich(of, free)))
    return out


def _choose(of: _Information, need: FloatArray, wanted: Any) -> Any:
    """Drop the least certain unknown until the rest is determined; of equals the later one."""
    active = np.array(wanted)
    while active.any():
        wide = np.where(active, SIGMAS * _deviations(of, active) / need, 0.0)
        worst = len(wide) - 1 - int(np.argmax(wide[::-1]))
        if wide[worst] <= 1.0:
            break
        active[worst] = False
    return active
