"""Small convex quadratic programs by the dual active-set method, in a bounded number of steps.

Goldfarb and Idnani, A numerically stable dual method for solving strictly convex quadratic
programs, Mathematical Programming 27, 1983: from the optimum without limits, the most violated
limit is added at each step, and those whose multiplier would become negative are dropped.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# Limits that are broken by less are kept [of the limits' unit].
TOLERANCE = 1e-6
# Steps in which a limit is added or dropped; beyond them the program counts as unsolved.
MOST_STEPS = 200
# Rows of the scratch that ``solve`` needs beyond twice the number of variables.
ROWS = 7
# A direction shorter than this has no part that the active limits leave free.
_FLAT = 1e-12


@kernel
def _inverted(root: FloatArray) -> None:
    """Turn a lower triangular factor into the transpose of its inverse, in place."""
    n = root.shape[0]
    for j in range(n):
        root[j, j] = 1.0 / root[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= root[i, k] * root[k, j]
            root[i, j] = total / root[i, i]
    for j in range(n):
        for i in range(j + 1, n):
            root[j, i] = root[i, j]
            root[i, j] = 0.0


@kernel
def inverse_root(hessian: FloatArray, root: FloatArray) -> bool:
    """Fill ``root`` (n, n), upper triangular, with root root' = inverse of ``hessian`` (n, n).

    Returns False where the Hessian is not positive definite.
    """
    n = hessian.shape[0]
    # The lower triangle holds the Cholesky factor until it is inverted in place.
    for j in range(n):
        for i in range(j, n):
            total = hessian[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                root[j, j] = math.sqrt(total)
            else:
                root[i, j] = total / root[j, j]
    _inverted(root)
    return True


@kernel
def _rotation(a: float, b: float) -> tuple[float, float, float]:
    """Cosine, sine and length of the rotation that turns (a, b) onto its first axis."""
    length = math.hypot(a, b)
    if length == 0.0:
        return 1.0, 0.0, 0.0
    return a / length, b / length, length


@kernel
def _turn_columns(matrix: FloatArray, j: int, c: float, s: float) -> None:
    """Rotate columns ``j`` and ``j`` + 1."""
    for i in range(matrix.shape[0]):
        a, b = matrix[i, j], matrix[i, j + 1]
        matrix[i, j] = c * a + s * b
        matrix[i, j + 1] = c * b - s * a


@kernel
def _along(rows: FloatArray, limit: int, x: FloatArray) -> float:
    """What a limit bounds: a variable, or a row times the variables."""
    n = x.shape[0]
    if limit < n:
        return float(x[limit])
    total = 0.0
    for i in range(n):
        total += rows[limit - n, i] * x[i]
    return total


@kernel
def _most_broken(
    rows: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    x: FloatArray,
    active: FloatArray,
    count: int,
) -> tuple[int, float, float]:
    """Limit that is broken most, side on which (1: below, -1: above) and by how much; -1: none."""
    worst, side, by = -1, 1.0, TOLERANCE
    for limit in range(lower.shape[0]):
        value = _along(rows, limit, x)
        below = lower[limit] - value
        above = value - upper[limit]
        if max(below, above) > by:
            held = False
            for k in range(count):
                held = held or int(active[k]) == limit
            if not held:
                worst, by = limit, max(below, above)
                side = 1.0 if below > above else -1.0
    return worst, side, by


@kernel
def _drop(k: int, count: int, root: FloatArray, r: FloatArray, lists: FloatArray) -> None:
    """Take active limit ``k`` out of the factors and of the lists."""
    for j in range(k, count - 1):
        for i in range(j + 2):
            r[i, j] = r[i, j + 1]
        for row in range(lists.shape[0]):
            lists[row, j] = lists[row, j + 1]
    for j in range(k, count - 1):
        c, s, length = _rotation(r[j, j], r[j + 1, j])
        r[j, j], r[j + 1, j] = length, 0.0
        for i in range(j + 1, count - 1):
            a, b = r[j, i], r[j + 1, i]
            r[j, i] = c * a + s * b
            r[j + 1, i] = c * b - s * a
        _turn_columns(root, j, c, s)


@kernel
def unlimited(inverse: FloatArray, linear: FloatArray, x: FloatArray, work: FloatArray) -> None:
    """Fill ``x`` (n,) with the minimum of x' H x / 2 + linear' x.

    Args:
        inverse: (n, n) of ``inverse_root``.
        linear: (n,).
        x: (n,) the minimum.
        work: (n,) scratch.
    """
    n = linear.shape[0]
    for j in range(n):
        total = 0.0
        for i in range(j + 1):
            total += inverse[i, j] * linear[i]
        work[j] = total
    for i in range(n):
        total = 0.0
        for j in range(i, n):
            total -= inverse[i, j] * work[j]
        x[i] = total


@kernel
def solve(  # noqa: C901, PLR0912 - one method, whose steps share their factors
    inverse: FloatArray,
    rows: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    x: FloatArray,
    work: FloatArray,
) -> int:
    """The minimum of a program with lower <= [x, rows x] <= upper, from that without limits.

    Args:
        inverse: (n, n) of ``inverse_root``.
        rows: (m, n).
        lower: (n + m,) of the variables, then of the rows; and so ``upper``.
        upper: (n + m,).
        x: (n,) the minimum without limits, in place.
        work: (2 n + ROWS, n) scratch.

    Returns the number of steps; -1 if the limits contradict each other or MOST_STEPS are not
    enough, and x is then not within them.
    """
    n = x.shape[0]
    root, r = work[:n], work[n : 2 * n]
    d, z, multipliers = work[2 * n], work[2 * n + 1], work[2 * n + 2]
    # Rows: multiplier, limit, its side.
    lists = work[2 * n + 3 : 2 * n + 6]
    normal = work[2 * n + 6]
    for i in range(n):
        for j in range(n):
            root[i, j] = inverse[i, j]
    count, limit, side, own, broken = 0, -1, 1.0, 0.0, 0.0
    for step in range(MOST_STEPS):
        if limit < 0:
            limit, side, broken = _most_broken(rows, lower, upper, x, lists[1], count)
            if limit < 0:
                return step
            own = 0.0
            for i in range(n):
                if limit < n:
                    normal[i] = side if i == limit else 0.0
                else:
                    normal[i] = side * rows[limit - n, i]
        # Directions of the variables and of the multipliers as the limit is approached.
        free = 0.0
        for j in range(n):
            total = 0.0
            for i in range(n):
                total += root[i, j] * normal[i]
            d[j] = total
            if j >= count:
                free += total * total
        for i in range(n):
            total = 0.0
            for j in range(count, n):
                total += root[i, j] * d[j]
            z[i] = total
        for j in range(count - 1, -1, -1):
            total = d[j]
            for k in range(j + 1, count):
                total -= r[j, k] * multipliers[k]
            multipliers[j] = total / r[j, j]
        longest, dropped = math.inf, -1
        for j in range(count):
            if multipliers[j] > 0.0 and lists[0, j] < longest * multipliers[j]:
                longest, dropped = lists[0, j] / multipliers[j], j
        whole = broken / free if free > _FLAT else math.inf
        length = min(longest, whole)
        if not length < math.inf:
            return -1
        own += length
        for j in range(count):
            lists[0, j] -= length * multipliers[j]
        if whole < math.inf:
            for i in range(n):
                x[i] += length * z[i]
            broken -= length * free
        if whole <= longest:
            for j in range(n - 2, count - 1, -1):
                c, s, total = _rotation(d[j], d[j + 1])
                d[j], d[j + 1] = total, 0.0
                _turn_columns(root, j, c, s)
            for j in range(count + 1):
                r[j, count] = d[j]
            lists[0, count], lists[1, count], lists[2, count] = own, limit, side
            count += 1
            limit = -1
        else:
            _drop(dropped, count, root, r, lists)
            count -= 1
    return -1
