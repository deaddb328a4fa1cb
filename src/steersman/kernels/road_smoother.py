"""Smoothing a noisy sensor's road: Whittaker's smoother, as strong as the points are noisy.

Source: Whittaker, On a new method of graduation, Proc. Edinburgh Mathematical Society 41, 1922.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# Standard deviation of the rate at which a road's curvature changes [1/m^2].
_CURVATURE_RATE = 1e-3
# Sum of the squared coefficients of a third difference.
_THIRD_SQUARES = 20.0


@kernel
def roughness(points: FloatArray) -> float:
    """Variance of white noise that the third differences of points (n >= 4, 2) are those of [m^2].

    One sum in one order, so that C has the same to the last bit.
    """
    total = 0.0
    for i in range(points.shape[0] - 3):
        for j in range(2):
            third = (points[i + 3, j] - points[i, j]) - 3.0 * (points[i + 2, j] - points[i + 1, j])
            total += third * third
    variance: float = total / (2.0 * (points.shape[0] - 3) * _THIRD_SQUARES)
    return variance


@kernel
def smooth_points(
    points: FloatArray, spacing: float, noise: float, factor: FloatArray, out: FloatArray
) -> None:
    """The road (n, 2) nearest to ``points`` whose third differences are those of a road.

    Minimises sum |out - point|^2 / noise + sum |third difference|^2 / (rate spacing^3)^2
    (Whittaker's smoother), with ``noise`` the points' variance [m^2]. ``factor`` (n, n) is scratch.
    """
    _stiffness(noise / (_CURVATURE_RATE * spacing * spacing * spacing) ** 2, factor)
    _cholesky(factor)
    for axis in range(2):
        for i in range(points.shape[0]):
            out[i, axis] = points[i, axis]
        _solve(factor, out, axis)


@kernel
def _stiffness(share: float, out: FloatArray) -> None:
    """The smoother's matrix I + share T'T, with T third differences; the identity without noise."""
    n = out.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = 1.0 if i == j else 0.0
    for m in range(n - 3):
        for i in range(4):
            for j in range(4):
                out[m + i, m + j] += share * _third(i) * _third(j)


@kernel
def _third(i: int) -> float:
    """Coefficients of a third difference."""
    if i == 0:
        return -1.0
    if i == 1:
        return 3.0
    if i == 2:
        return -3.0
    return 1.0


@kernel
def _cholesky(matrix: FloatArray) -> None:
    """Lower factor of a banded positive definite matrix (three beside the diagonal), in place."""
    for i in range(matrix.shape[0]):
        for j in range(max(i - 3, 0), i + 1):
            value = matrix[i, j]
            for k in range(max(i - 3, 0), j):
                value -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = math.sqrt(value)
            else:
                matrix[i, j] = value / matrix[j, j]


@kernel
def _solve(factor: FloatArray, values: FloatArray, axis: int) -> None:
    """Column ``axis`` of ``values`` becomes the solution of factor factor' x = values."""
    n = factor.shape[0]
    for i in range(n):
        for k in range(max(i - 3, 0), i):
            values[i, axis] -= factor[i, k] * values[k, axis]
        values[i, axis] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, min(i + 4, n)):
            values[i, axis] -= factor[k, i] * values[k, axis]
        values[i, axis] /= factor[i, i]
