"""Arithmetic of the condensed linear MPC: the reference from waypoints, what a plan is made of."""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.linear_system import product, unit
from steersman.types import FloatArray


@kernel
def respond(
    a: FloatArray, b: FloatArray, free: FloatArray, forced: FloatArray, work: FloatArray
) -> None:
    """The first state over the horizon, by ``a`` (n, n) and ``b`` (n, 1) of a period.

    ``free`` (N, n) becomes its response to the state, ``forced`` (N, N) that to the inputs;
    ``work`` (2, n, n) is scratch.
    """
    n, horizon = a.shape[0], forced.shape[0]
    power, after = work[0], work[1]
    unit(power)
    for i in range(horizon):
        impulse = 0.0
        for k in range(n):
            impulse += power[0, k] * b[k, 0]
        for j in range(horizon):
            if j >= i:
                forced[j, j - i] = impulse
            else:
                forced[j, horizon - i + j] = 0.0
        product(a, power, after)
        for j in range(n):
            free[i, j] = after[0, j]
            for k in range(n):
                power[k, j] = after[k, j]


@kernel
def reference(preview: FloatArray, spacing: float, distance: float, out: FloatArray) -> None:
    """Lateral position of the path at distances ``distance``, 2 ``distance``, ... [m].

    Cubic Lagrange interpolation of the waypoints (n, 2) over arc length; beyond the last
    waypoint the last cubic's end tangent goes on.
    """
    n = preview.shape[0]
    end = (n - 1) * spacing
    for i in range(out.shape[0]):
        u = (i + 1) * distance
        over = max(u - end, 0.0)
        t = (u - over) / spacing
        k = min(max(int(t) - 1, 0), n - 4)
        t -= k
        y0, y1, y2, y3 = preview[k, 1], preview[k + 1, 1], preview[k + 2, 1], preview[k + 3, 1]
        a, b, c, d = t, t - 1.0, t - 2.0, t - 3.0
        outer = a * b * c * y3 - b * c * d * y0
        inner = a * c * d * y1 - a * b * d * y2
        y = outer / 6.0 + inner / 2.0
        slope = (11.0 * y3 - 18.0 * y2 + 9.0 * y1 - 2.0 * y0) / (6.0 * spacing)
        out[i] = y + over * slope


@kernel
def gradient(  # noqa: PLR0917 - numba takes no keyword-only arguments
    preview: FloatArray,
    spacing: float,
    distance: float,
    beta: float,
    yaw_rate: float,
    free: FloatArray,
    weight: FloatArray,
    ref: FloatArray,
    out: FloatArray,
) -> None:
    """Fill ``ref`` with the free response minus the reference, ``out`` with ``weight`` times that.

    By the QP's weight (N, N) that is its linear term, by its gain its optimum without limits.

    ``free`` (N, 2) is the response of y to the initial side-slip and yaw rate; y and yaw start
    at zero because everything is expressed in the vehicle's frame.
    """
    reference(preview, spacing, distance, ref)
    n = ref.shape[0]
    for i in range(n):
        ref[i] = free[i, 0] * beta + free[i, 1] * yaw_rate - ref[i]
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += weight[i, j] * ref[j]
        out[i] = total


@kernel
def all_finite(values: FloatArray) -> bool:
    """Whether no element is NaN or infinite."""
    for i in range(values.shape[0]):
        if not math.isfinite(values[i]):
            return False
    return True
