"""The discrete Riccati equation, and the gains of its regulator."""

from __future__ import annotations

import numpy as np

from steersman.kernels import linear_system as kernel
from steersman.types import FloatArray


def riccati(a: FloatArray, b: FloatArray, q: FloatArray, r: float) -> FloatArray:
    """P (n, n) of the least sum of x'qx + r u^2 for x(k+1) = a x + b u.

    Args:
        a: (n, n).
        b: (n,) effect of its one input.
        q: (n, n) weights of the state.
        r: weight of the input, greater than 0.

    Raises:
        LinAlgError: it does not converge: what cannot be stabilised, or is not finite.
    """
    n = len(b)
    p = np.empty((n, n))
    sides, work = np.empty((n, 2 * n)), np.empty((kernel.RICCATI_WORK, n, n))
    if not kernel.riccati(a, b, q, r, p, sides, work):
        raise np.linalg.LinAlgError("the Riccati equation has no stabilising solution")
    return p


def regulators(a: FloatArray, b: FloatArray, q: FloatArray, r: float) -> FloatArray:
    """Gains K (s, n) of the best u = -K x for each of s systems.

    Args:
        a: (s, n, n).
        b: (s, n).
        q: (n, n) weights of the state.
        r: weight of the input, greater than 0.

    Raises:
        LinAlgError: one of them has none.
    """
    n, gains = b.shape[1], np.empty(b.shape)
    sides, work = np.empty((n, 2 * n)), np.empty((kernel.RICCATI_WORK, n, n))
    if not kernel.regulators(a, b, q, r, gains, sides, work):
        raise np.linalg.LinAlgError("the Riccati equation has no stabilising solution")
    return gains
