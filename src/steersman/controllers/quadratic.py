"""The optimum of a small quadratic program, for plans that are condensed anew at every step."""

from __future__ import annotations

import numpy as np

from steersman.kernels import active_set
from steersman.kernels.condensed_qp import all_finite
from steersman.types import FloatArray

# Lists to which the steps of every program are appended (-1: unsolved), while a caller counts them.
COUNTED: list[list[int]] = []


def optimum(
    hessian: FloatArray, linear: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray | None:
    """The x (n,) that minimises x' H x / 2 + linear' x with lower <= [x, rows x] <= upper.

    None if the Hessian is not positive definite, the limits contradict each other, or the method's
    largest number of steps is not enough.
    """
    inverse = np.empty_like(hessian)
    if not active_set.inverse_root(hessian, inverse):
        return None
    x, work = np.empty(len(linear)), np.empty(len(linear))
    active_set.unlimited(inverse, linear, x, work)
    return within(inverse, x, rows, lower, upper)


def within(
    inverse: FloatArray, x: FloatArray, rows: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray | None:
    """The same from the optimum without limits, ``x`` (n,), which becomes that within them.

    ``inverse`` is that of ``active_set.inverse_root`` of the Hessian.
    """
    n = len(x)
    work = np.empty((2 * n + active_set.ROWS, n))
    steps = active_set.solve(inverse, rows, lower, upper, x, work)
    for each in COUNTED:
        each.append(steps)
    return x if steps >= 0 and all_finite(x) else None
