"""Robust least squares that says which unknowns the data tell, and how well.

Sources: output error, Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., ch. 4, and
Ljung, *System Identification*, 2nd ed., ch. 7 and 9; Huber's loss and its covariance, Huber and
Ronchetti, *Robust Statistics*, 2nd ed., ch. 7; covariance with coloured residuals, Morelli and
Klein, *Accuracy of aerodynamic model parameters*, J. Guidance 20(1), 1997; the uncertainty of
what is held fixed ("consider" covariance), Tapley, Schutz and Born, *Statistical Orbit
Determination*, ch. 6.

Unknowns are z, standardised so that 0 is what was believed before and 1 its standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify.unknowns import SIGMAS
from steersman.types import FloatArray

# Beyond so many deviations a residual pulls no harder (95 % efficient with normal noise).
HUBER = 1.345
# Weight of what was believed before: keeps what the data do not tell from running away.
_RIDGE = 0.05
_STEP = 1e-3
# Residuals are taken for correlated over no more than this share of the rows.
_LAGS = 0.02
_MOST_LAGS = 60
# Another round when the told ones changed; and rounds of weights within each.
_ROUNDS = 4
_WEIGHTINGS = 3
# Evaluations of one least-squares search.
_QUICK, _MOST = 5, 30
# What the held ones add to an interval is worth a word beyond this share of its allowed width.
_MATTERS = 0.2
# A search that begins on a bound hardly leaves it.
_INSIDE = 0.02
# Mean square of Huber's normal residuals: less is no sign of a better sensor.
_NORMAL = 0.7


class Misses:
    """What a vehicle at z misses the measurements by, and how that changes with z."""

    def __init__(
        self,
        of: Callable[[FloatArray], FloatArray],
        low: FloatArray,
        high: FloatArray,
        least: FloatArray,
        coarse: FloatArray | None = None,
    ) -> None:
        """Bind z to what is compared.

        Args:
            of: z -> (rows, channels) simulated minus measured, NaN where nothing compares.
            low: least z (p,).
            high: largest z (p,).
            least: (channels,) standard deviations below which no residual is taken for noise.
            coarse: (p,) differences that intervals are taken from; 0: small ones.
        """
        self._coarse = np.zeros(len(low)) if coarse is None else coarse
        self._of = of
        self.low, self.high, self._least = low, high, least

    def __call__(self, z: FloatArray) -> FloatArray:
        """(rows, channels)."""
        return self._of(z)

    def scales(self, z: FloatArray) -> FloatArray:
        """Standard deviation of each channel's residuals, by their median: (channels,)."""
        return np.maximum(scale_of(self(z)), self._least)

    def derivative(self, z: FloatArray, which: Any = None, *, wide: bool = False) -> FloatArray:
        """(rows, channels, len(which)) by small differences away from the nearer bound.

        If ``wide``, to both sides, and over as much as ``coarse`` says: what intervals need.
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


class Estimate(NamedTuple):
    """Result; those that are not told stand where they rest."""

    z: FloatArray
    told: Any
    """(p,) bool."""
    covariance: FloatArray
    """(p, p) of those told, the uncertainty of the held ones included; 0 elsewhere."""
    alone: FloatArray
    """(p,) standard deviations if the held ones were known."""
    given: list[int]
    """For each unknown the held one to which it owes most of its uncertainty, or -1."""
    possible: FloatArray
    """(p,) standard deviation with which each would be told if all were looked for."""
    scales: FloatArray
    """(channels,) of the residuals."""


def estimate(
    misses: Misses,
    start: FloatArray,
    rest: FloatArray,
    need: FloatArray,
    wanted: Any,
    unsure: FloatArray | None = None,
) -> Estimate:
    """Search those ``wanted`` (p,) bool from ``start``, dropping what the data do not tell.

    What is dropped returns to ``rest``. ``need`` (p,) is the half width of the 95 % interval
    beyond which an unknown counts as not told, ``unsure`` (p,) the standard deviation of those
    that are held (1 each).
    """
    unsure = np.ones(len(start)) if unsure is None else unsure
    active = np.array(wanted)
    z = np.where(active, start, rest)
    for _ in range(_ROUNDS):
        z, scales = search(misses, z, active)
        of = _information(misses.derivative(z, wide=True), misses(z), scales)
        kept = _choose(of, need, active)
        if (kept == active).all():
            break
        active = kept
        z = np.where(active, z, rest)
    return _judged(of, z, active, scales, need, wanted, unsure)


def judge(
    misses: Misses,
    z: FloatArray,
    told: Any,
    need: FloatArray,
    wanted: Any,
    unsure: FloatArray,
    rest: FloatArray,
) -> Estimate:
    """The estimate that stands at ``z``; of those ``told``, who are not told there return."""
    scales = misses.scales(z)
    of = _information(misses.derivative(z, wide=True), misses(z), scales)
    still = _choose(of, need, told)
    return _judged(of, np.where(still, z, rest), still, scales, need, wanted, unsure)


def _judged(
    of: _Information,
    z: FloatArray,
    told: Any,
    scales: FloatArray,
    need: FloatArray,
    wanted: Any,
    unsure: FloatArray,
) -> Estimate:
    covariance, alone, given = _with_held(of, told, need, unsure)
    possible = _deviations(of, np.array(wanted))
    return Estimate(z, told, covariance, alone, given, possible, scales)


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
    """Huber's estimate of the active unknowns; the scales of the channels go with it.

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
    """Of all unknowns: bread and meat of the sandwich, (p, p) each."""

    bread: FloatArray
    white: FloatArray
    """The meat if residuals were uncorrelated."""
    meat: FloatArray


def _information(jacobian: FloatArray, left: FloatArray, scales: FloatArray) -> _Information:
    """Sums over rows and channels; the meat with the residuals' autocovariance.

    The window and the autocovariance are both positive semi-definite, and so is the meat.
    """
    known = np.isfinite(left)
    z = np.where(known, left, 0.0) / scales
    slopes = np.nan_to_num(jacobian) / scales[:, None] * known[..., None]
    pull, linear = np.clip(z, -HUBER, HUBER), known & (np.abs(z) < HUBER)
    p = jacobian.shape[2]
    bread, white, extra = np.zeros((p, p)), np.zeros((p, p)), np.zeros((p, p))
    for c in range(z.shape[1]):
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
    return _Information(bread, white, white + extra)


def _inverse(of: _Information, free: Any) -> FloatArray:
    inner = of.bread[np.ix_(free, free)] + _RIDGE**2 * np.eye(len(free))
    return np.asarray(np.linalg.inv(inner))


def _sandwich(of: _Information, free: Any) -> FloatArray:
    """Covariance of the free unknowns, never narrower than with uncorrelated residuals."""
    inverse, ridge = _inverse(of, free), _RIDGE**2 * np.eye(len(free))
    white, full = (
        inverse @ (meat[np.ix_(free, free)] + ridge) @ inverse for meat in (of.white, of.meat)
    )
    factor = np.sqrt(np.maximum(np.diag(white) / np.diag(full), 1.0))
    return np.asarray(full * np.outer(factor, factor))


def _deviations(of: _Information, active: Any) -> FloatArray:
    """(p,) standard deviations if all active ones are looked for, infinity elsewhere."""
    out = np.full(len(of.bread), np.inf)
    free = np.flatnonzero(active)
    if free.size:
        out[free] = np.sqrt(np.diag(_sandwich(of, free)))
    return out


def _choose(of: _Information, need: FloatArray, wanted: Any) -> Any:
    """Drop the worst told unknown until all that are left are told; of equals the later one."""
    active = np.array(wanted)
    while active.any():
        wide = np.where(active, SIGMAS * _deviations(of, active) / need, 0.0)
        worst = len(wide) - 1 - int(np.argmax(wide[::-1]))
        if wide[worst] <= 1.0:
            break
        active[worst] = False
    return active


def _with_held(
    of: _Information, active: Any, need: FloatArray, unsure: FloatArray
) -> tuple[FloatArray, FloatArray, list[int]]:
    """Covariance with the uncertainty of the held ones, without it, and whom it is owed to."""
    p = len(of.bread)
    covariance, alone, given = np.zeros((p, p)), np.zeros(p), [-1] * p
    free, held = np.flatnonzero(active), np.flatnonzero(~active)
    if not free.size:
        return covariance, alone, given
    own = _sandwich(of, free)
    alone[free] = np.sqrt(np.diag(own))
    shifts = -_inverse(of, free) @ of.bread[np.ix_(free, held)] * unsure[held]
    covariance[np.ix_(free, free)] = own + shifts @ shifts.T
    for row, i in enumerate(free):
        borrowed = float(shifts[row] @ shifts[row])
        if held.size and borrowed > max(float(own[row, row]), (_MATTERS * need[i] / SIGMAS) ** 2):
            given[i] = int(held[np.argmax(np.abs(shifts[row]))])
    return covariance, alone, given
