"""The discrete Riccati equation of many regulators at once, by doubling."""

from __future__ import annotations

import numpy as np

from steersman.types import FloatArray

# Doublings: each squares what is left of the error, so that a dozen is usual. After so many a
# closed loop whose slowest motion takes 1e8 steps would still be found.
_MOST = 30
_EXACT, _FADED = 1e-15, 1e-3


def riccati(a: FloatArray, b: FloatArray, q: FloatArray, r: float) -> FloatArray:
    """P (..., n, n) of the least sum of x'qx + r u^2 for x(k+1) = a x + b u.

    The structure-preserving doubling of Chu, Fan, Lin and Wang, Structure-preserving algorithms
    for periodic discrete-time algebraic Riccati equations, Int. J. Control 77 (2004) 767-788.

    Args:
        a: (..., n, n), a system in each leading place.
        b: (..., n) effect of its one input.
        q: (n, n) weights of the state.
        r: weight of the input, greater than 0.

    Raises:
        LinAlgError: it does not converge: what cannot be stabilised, or is not finite.
    """
    n = a.shape[-1]
    p, g = np.broadcast_to(q, a.shape), b[..., :, None] * b[..., None, :] / r
    with np.errstate(over="ignore", invalid="ignore"):  # what does not converge says so below
        for _ in range(_MOST):
            inner = np.eye(n) + g @ p
            solved = np.linalg.solve(inner, np.concatenate([a, g], axis=-1))
            turned = np.swapaxes(a, -1, -2)
            more = turned @ p @ solved[..., :n]
            g = g + a @ solved[..., n:] @ turned
            a, p = a @ solved[..., :n], p + more
            if not np.isfinite(p).all():
                break
            # The closed loop's power of so many steps, which fades where it is stable.
            fades = np.all(np.abs(a) <= _FADED)
            if fades and np.all(np.abs(more) <= _EXACT * np.abs(p).max((-2, -1), keepdims=True)):
                return np.asarray(0.5 * (p + np.swapaxes(p, -1, -2)))
    raise np.linalg.LinAlgError("the Riccati equation has no stabilising solution")


def gain(a: FloatArray, b: FloatArray, p: FloatArray, r: float) -> FloatArray:
    """(..., n) K of the best u = -K x, for the solution ``p`` of :func:`riccati`."""
    weighted = np.einsum("...i,...ij->...j", b, p)
    scale = r + np.einsum("...i,...i->...", weighted, b)
    return np.asarray(np.einsum("...i,...ij->...j", weighted, a) / scale[..., None])
