"""How well the data determine the unknowns: the covariance, and which of them to search.

Sources: Huber's loss and its covariance, Huber and Ronchetti, *Robust Statistics*, 2nd ed., ch. 7;
covariance with coloured residuals, Morelli and Klein, *Accuracy of aerodynamic model parameters*,
J. Guidance 20(1), 1997.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify.misses import Misses
from steersman.studies.identify.unknowns import SIGMAS
from steersman.types import FloatArray

# Beyond so many deviations a residual pulls no harder (95 % efficient with normal noise).
HUBER = 1.345
# Weight of the prior: keeps unknowns that the data do not determine from running away.
RIDGE = 0.05
# Residuals are taken for correlated over no more than this share of the rows, and so many rows.
_LAGS, _MOST_LAGS = 0.02, 60
# Mean square of Huber's normal residuals: less is no sign of a better sensor.
_NORMAL = 0.7


class Information(NamedTuple):
    """Bread and meat of the sandwich estimate of the covariance at ``z``, (p, p) each."""

    z: FloatArray
    scales: FloatArray
    bread: FloatArray
    white: FloatArray
    """The meat if residuals were uncorrelated."""
    meat: FloatArray


def information(misses: Misses, z: FloatArray, scales: FloatArray) -> Information:
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
    return Information(z, scales, bread, white, white + extra)


def inverse(of: Information, free: Any) -> FloatArray:
    """Covariance of the free unknowns if the noise had unit variance."""
    inner = of.bread[np.ix_(free, free)] + RIDGE**2 * np.eye(len(free))
    return np.asarray(np.linalg.inv(inner))


def sandwich(of: Information, free: Any) -> FloatArray:
    """Covariance of the free unknowns, never narrower than with uncorrelated residuals."""
    inner, ridge, at = inverse(of, free), RIDGE**2 * np.eye(len(free)), np.ix_(free, free)
    white, full = (inner @ (meat[at] + ridge) @ inner for meat in (of.white, of.meat))
    factor = np.sqrt(np.maximum(np.diag(white) / np.diag(full), 1.0))
    return np.asarray(full * np.outer(factor, factor))


def deviations(of: Information, active: Any) -> FloatArray:
    """(p,) standard deviations if all active ones are searched, infinity elsewhere."""
    out = np.full(len(of.bread), np.inf)
    free = np.flatnonzero(active)
    if free.size:
        out[free] = np.sqrt(np.diag(sandwich(of, free)))
    return out


def choose(of: Information, need: FloatArray, wanted: Any) -> Any:
    """Drop the least certain unknown until the rest is determined; of equals the later one."""
    active = np.array(wanted)
    while active.any():
        wide = np.where(active, SIGMAS * deviations(of, active) / need, 0.0)
        worst = len(wide) - 1 - int(np.argmax(wide[::-1]))
        if wide[worst] <= 1.0:
            break
        active[worst] = False
    return active
