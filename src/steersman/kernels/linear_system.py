"""Linear systems of a few states: held inputs, and the discrete Riccati equation by doubling."""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# Terms of the exponential's series, enough for a matrix whose rows add up to a half.
_TERMS, _SMALL = 18, 0.5
# Squarings, enough for rows that add up to 5e11.
_MOST_SQUARINGS = 40
# Doublings: each squares what is left of the error, so that a dozen is usual. After so many a
# closed loop whose slowest motion takes 1e8 steps would still be found.
_MOST = 30
_EXACT, _FADED = 1e-15, 1e-3
# Matrices (n, n) that the exponential and a regulator take as scratch.
EXPONENTIAL_WORK, RICCATI_WORK = 2, 6


@kernel
def product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """``out`` (n, m) = ``a`` (n, k) times ``b`` (k, m)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@kernel
def unit(out: FloatArray) -> None:
    """Fill ``out`` (n, n) with the unit matrix."""
    n = out.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = 1.0 if i == j else 0.0


@kernel
def _halvings(a: FloatArray) -> int:
    """How often to halve a matrix until its rows add up to no more than a half."""
    size = 0.0
    for i in range(a.shape[0]):
        row = 0.0
        for j in range(a.shape[1]):
            row += abs(a[i, j])
        size = max(size, row)
    count = 0
    while size > _SMALL and count < _MOST_SQUARINGS:
        size *= 0.5
        count += 1
    return count


@kernel
def exponential(a: FloatArray, out: FloatArray, work: FloatArray) -> None:
    """``out`` (n, n) = exp(``a``), by its series for ``a`` / 2^s, squared s times.

    Golub and Van Loan, Matrix Computations, 4th ed., 2013, sec. 9.3. What is not finite gives what
    is not finite. ``work`` (EXPONENTIAL_WORK, n, n) is scratch.
    """
    n, squarings = a.shape[0], _halvings(a)
    scaled, term = work[0], work[1]
    for i in range(n):
        for j in range(n):
            scaled[i, j] = a[i, j] * 0.5**squarings
    unit(out)
    for k in range(_TERMS, 0, -1):
        product(scaled, out, term)
        for i in range(n):
            for j in range(n):
                out[i, j] = term[i, j] / k
            out[i, i] += 1.0
    for _ in range(squarings):
        product(out, out, term)
        for i in range(n):
            for j in range(n):
                out[i, j] = term[i, j]


@kernel
def _swap(rows: FloatArray, a: int, b: int) -> None:
    """Let two rows change places."""
    for j in range(rows.shape[1]):
        rows[a, j], rows[b, j] = rows[b, j], rows[a, j]


@kernel
def _eliminate(matrix: FloatArray, sides: FloatArray) -> bool:
    """Turn ``matrix`` (n, n) into a triangle with row pivots; False where it is singular."""
    n = matrix.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if not abs(matrix[best, k]) > 0.0:
            return False
        _swap(matrix, k, best)
        _swap(sides, k, best)
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= factor * matrix[k, j]
            for j in range(sides.shape[1]):
                sides[i, j] -= factor * sides[k, j]
    return True


@kernel
def solve(matrix: FloatArray, sides: FloatArray) -> bool:
    """Replace ``sides`` (n, m) by the solution X of ``matrix`` (n, n) X = ``sides``.

    Gaussian elimination with row pivots, in place; False where the matrix is singular.
    """
    if not _eliminate(matrix, sides):
        return False
    n = matrix.shape[0]
    for i in range(n - 1, -1, -1):
        for j in range(sides.shape[1]):
            total = sides[i, j]
            for k in range(i + 1, n):
                total -= matrix[i, k] * sides[k, j]
            sides[i, j] = total / matrix[i, i]
    return True


@kernel
def _doubled(
    power: FloatArray, g: FloatArray, p: FloatArray, sides: FloatArray, work: FloatArray
) -> bool:
    """One doubling of a power of the closed loop, of ``g`` and of ``p``.

    True where what is left of the error no longer counts.
    """
    n = power.shape[0]
    inner, turned, more = work[0], work[1], work[2]
    product(g, p, inner)
    for i in range(n):
        inner[i, i] += 1.0
        for j in range(n):
            sides[i, j], sides[i, n + j] = power[i, j], g[i, j]
            turned[i, j] = power[j, i]
    if not solve(inner, sides):
        p[0, 0] = math.nan
        return False
    # The first half of the sides is (I + G P)^-1 A, the second (I + G P)^-1 G.
    product(turned, p, inner)
    product(inner, sides[:, :n], more)
    product(power, sides[:, n:], inner)
    largest, change, left = 0.0, 0.0, 0.0
    for i in range(n):
        for j in range(n):
            for k in range(n):
                g[i, j] += inner[i, k] * turned[k, j]
            p[i, j] += more[i, j]
            largest, change = max(largest, abs(p[i, j])), max(change, abs(more[i, j]))
    product(power, sides[:, :n], inner)
    for i in range(n):
        for j in range(n):
            power[i, j] = inner[i, j]
            left = max(left, abs(inner[i, j]))
    return left <= _FADED and change <= _EXACT * largest


@kernel
def riccati(
    a: FloatArray, b: FloatArray, q: FloatArray, r: float, p: FloatArray, sides: FloatArray,
    work: FloatArray,
) -> bool:  # fmt: skip
    """Fill ``p`` (n, n): x'px is the least sum of x'qx + r u^2 for x(k+1) = a x + b u.

    The structure-preserving doubling of Chu, Fan, Lin and Wang, Structure-preserving algorithms
    for periodic discrete-time algebraic Riccati equations, Int. J. Control 77 (2004) 767-788.

    Args:
        a: (n, n).
        b: (n,) effect of the one input.
        q: (n, n) weights of the state.
        r: weight of the input, greater than 0.
        p: the solution.
        sides: (n, 2 n) scratch.
        work: (RICCATI_WORK, n, n) scratch.

    Returns False where it does not converge: what cannot be stabilised, or is not finite.
    """
    n = a.shape[0]
    power, g = work[3], work[4]
    for i in range(n):
        for j in range(n):
            power[i, j], g[i, j] = a[i, j], b[i] * b[j] / r
            p[i, j] = q[i, j]
    for _ in range(_MOST):
        done = _doubled(power, g, p, sides, work)
        for i in range(n):
            for j in range(n):
                if not math.isfinite(p[i, j]):
                    return False
        if done:
            for i in range(n):
                for j in range(i):
                    p[i, j] = p[j, i] = 0.5 * (p[i, j] + p[j, i])
            return True
    return False


@kernel
def gain(a: FloatArray, b: FloatArray, p: FloatArray, r: float, out: FloatArray) -> float:
    """``out`` (n,): K of the best u = -K x, for the ``p`` of :func:`riccati`; r + b' p b."""
    n = a.shape[0]
    scale = r
    for i in range(n):
        for j in range(n):
            scale += b[i] * p[i, j] * b[j]
    for j in range(n):
        total = 0.0
        for i in range(n):
            for k in range(n):
                total += b[i] * p[i, k] * a[k, j]
        out[j] = total / scale
    return scale


@kernel
def regulators(
    a: FloatArray, b: FloatArray, q: FloatArray, r: float, gains: FloatArray,
    sides: FloatArray, work: FloatArray,
) -> bool:  # fmt: skip
    """Fill ``gains`` (s, n) of s systems ``a`` (s, n, n) and ``b`` (s, n); False: one has none."""
    for i in range(a.shape[0]):
        if not riccati(a[i], b[i], q, r, work[5], sides, work):
            return False
        gain(a[i], b[i], work[5], r, gains[i])
    return True
