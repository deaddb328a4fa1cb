"""Fusing a noisy sensor's road over time, by the car's own motion.

Scalar and two-state Kalman filters whose measurement noise is estimated on the way, so that exact
measurements pass unchanged; docs/controllers.md has the equations.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.preview import point_at
from steersman.types import FloatArray

# What the filter keeps of scalars.
D, HEADING, P_DD, P_DH, P_HH, R_D, R_H, R_POINTS, COUNT = range(9)
N_MEMORY = 9
# What dead reckoning adds over a period to the standard deviation of a point [m], of the lateral
# error [m] and of the heading error [rad].
_POINT_DRIFT, _D_DRIFT, _HEADING_DRIFT = 1e-3, 1e-3, 3e-4
# Standard deviation of the rate at which a road's curvature changes [1/m^2].
_CURVATURE_RATE = 1e-3
# Sum of the squared coefficients of a third difference.
_THIRD_SQUARES = 20.0
# Variances never vanish: a division by them must stay finite.
_TINY = 1e-14


@kernel
def reckon_errors(
    v_x: float, v_y: float, rate: float, kappa: float, dt: float, memory: FloatArray
) -> float:
    """Move lateral and heading error on by one period; returns the way along the road [m]."""
    heading = memory[HEADING]
    for _ in range(2):  # the second time with the heading in the middle of the period
        beside = max(1.0 - kappa * memory[D], 0.2)
        along = (v_x * math.cos(heading) - v_y * math.sin(heading)) / beside
        turned = (rate - kappa * along) * dt
        heading = memory[HEADING] + 0.5 * turned
    memory[D] += dt * (v_x * math.sin(heading) + v_y * math.cos(heading))
    memory[HEADING] += turned
    way = v_x * dt
    memory[P_DD] += way * (2.0 * memory[P_DH] + way * memory[P_HH]) + _D_DRIFT * _D_DRIFT
    memory[P_DH] += way * memory[P_HH]
    memory[P_HH] += _HEADING_DRIFT * _HEADING_DRIFT
    return float(along * dt)


@kernel
def correct_errors(d: float, heading: float, share: float, memory: FloatArray) -> None:
    """Blend measured errors into those reckoned.

    ``share`` of what is new goes into the noise: the expected square of what a measurement differs
    from the truth, given the blend (one step of expectation maximisation), which stays positive.
    """
    # Lateral error first, then heading: independent measurements may follow each other.
    s = memory[P_DD] + memory[R_D]
    gain, other, surprise = memory[P_DD] / s, memory[P_DH] / s, d - memory[D]
    memory[D] += gain * surprise
    memory[HEADING] += other * surprise
    memory[P_HH] -= other * memory[P_DH]
    memory[P_DH] *= 1.0 - gain
    memory[P_DD] *= 1.0 - gain
    left = (1.0 - gain) * surprise
    memory[R_D] += share * (left * left + memory[P_DD] - memory[R_D])
    s = memory[P_HH] + memory[R_H]
    turn = heading - memory[HEADING]
    turn -= 2.0 * math.pi * math.ceil(turn / (2.0 * math.pi) - 0.5)
    gain, other = memory[P_HH] / s, memory[P_DH] / s
    memory[HEADING] += gain * turn
    memory[D] += other * turn
    memory[P_DD] -= other * memory[P_DH]
    memory[P_DH] *= 1.0 - gain
    memory[P_HH] *= 1.0 - gain
    left = (1.0 - gain) * turn
    memory[R_H] += share * (left * left + memory[P_HH] - memory[R_H])
    memory[R_D], memory[R_H] = max(memory[R_D], _TINY), max(memory[R_H], _TINY)


@kernel
def fuse_points(  # noqa: PLR0917 - numba takes no keyword-only arguments
    preview: FloatArray,
    spacing: float,
    shift_x: float,
    shift_y: float,
    turn: float,
    way: float,
    share: float,
    old: FloatArray,
    spread: FloatArray,
    memory: FloatArray,
    out: FloatArray,
    spread_out: FloatArray,
) -> None:
    """Waypoints (n, 2) of the last period, moved into the present frame, blended with new ones.

    The car moved by ``shift`` (in its old frame) and ``turn``, ``way`` [m] along the road.
    ``spread`` (n,) are the points' variances over that of one measurement.
    """
    n = preview.shape[0]
    end = (n - 1) * spacing
    noise = memory[R_POINTS]
    drift = _POINT_DRIFT * _POINT_DRIFT / noise
    c, s = math.cos(turn), math.sin(turn)
    total, count = 0.0, 0
    for i in range(n):
        u = i * spacing + way
        if not 0.0 <= u <= end:
            out[i, 0], out[i, 1], spread_out[i] = preview[i, 0], preview[i, 1], 1.0
            continue
        k = min(int(u / spacing), n - 2)
        w = u / spacing - k
        x, y = point_at(old, spacing, u)
        x, y = x - shift_x, y - shift_y
        x, y = c * x + s * y, c * y - s * x
        before = (1.0 - w) * spread[k] + w * spread[k + 1] + drift
        gain = before / (before + 1.0)
        new_x, new_y = preview[i, 0] - x, preview[i, 1] - y
        out[i, 0], out[i, 1] = x + gain * new_x, y + gain * new_y
        spread_out[i] = gain
        total += 0.5 * (new_x * new_x + new_y * new_y) - before * noise
        count += 1
    if count > 0:
        memory[R_POINTS] = max(noise + share * (total / count - noise), _TINY)


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
    points: FloatArray,
    spacing: float,
    spread: FloatArray,
    noise: float,
    factor: FloatArray,
    out: FloatArray,
) -> None:
    """The road (n, 2) nearest to ``points`` whose third differences are those of a road.

    Minimises sum |out - point|^2 / variance + sum |third difference|^2 / (rate spacing^3)^2
    (Whittaker's smoother), with ``noise`` x ``spread`` the variances. ``factor`` (n, n) is scratch.
    """
    n = points.shape[0]
    share = noise / (_CURVATURE_RATE * spacing * spacing * spacing) ** 2
    _stiffness(spread, share, factor)
    _cholesky(factor)
    for axis in range(2):
        for i in range(n):
            out[i, axis] = 0.0
        for m in range(n - 3):
            bend = 0.0
            for i in range(4):
                bend += _third(i) * points[m + i, axis]
            for i in range(4):
                out[m + i, axis] -= _third(i) * bend * math.sqrt(spread[m + i] * share)
        _solve(factor, out, axis)
        for i in range(n):
            out[i, axis] = points[i, axis] + out[i, axis] * math.sqrt(spread[i] * share)


@kernel
def _stiffness(spread: FloatArray, share: float, out: FloatArray) -> None:
    """The smoother's matrix I + r T'T r, with r = sqrt(spread share) and T third differences.

    Scaled by the variances on both sides, so that without noise it is the identity.
    """
    n = out.shape[0]
    for i in range(n):
        for j in range(n):
            out[i, j] = 1.0 if i == j else 0.0
    for m in range(n - 3):
        for i in range(4):
            for j in range(4):
                root = math.sqrt(spread[m + i] * spread[m + j])
                out[m + i, m + j] += _third(i) * _third(j) * root * share


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
