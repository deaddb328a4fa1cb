"""Where waypoints of a road lie that is known by its curvature, and how that depends on the state.

The road is a row of curvatures at nodes ``h`` metres apart, linear in between. The walk begins
beside the car and carries the displacement of the road under a small change of each column of the
state along, in the road's own frame: direction t, normal n and along a obey
t' = change of curvature, n' = t - kappa a, a' = kappa n (variation of the Frenet equations).
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# Columns of the mean and of its covariance; docs/equations/estimated.md has their meaning.
D, HEADING, OFFSET, VX, VY, RATE, AX = range(7)
LACK_Y, LACK_RATE, BIAS_VY, BIAS_RATE, SCALE, POSE_D, POSE_HEADING, NODES = range(7, 15)
# Number of columns that change by the motion.
N_MOVED = POSE_D


@kernel
def node_curvature(mean: FloatArray, h: float, u: float) -> float:
    """Curvature at ``u`` [m] behind the first node [1/m]; held beyond the ends."""
    last = mean.shape[0] - NODES - 1
    t = min(max(u / h, 0.0), float(last))
    i = min(int(t), last - 1)
    w = t - i
    return float((1.0 - w) * mean[NODES + i] + w * mean[NODES + i + 1])


@kernel
def _piece(  # noqa: PLR0917 - numba takes no keyword-only arguments
    mean: FloatArray,
    h: float,
    u: float,
    step: float,
    cell: int,
    place: FloatArray,
    turn: FloatArray,
    across: FloatArray,
    along: FloatArray,
) -> None:
    """Walk ``step`` [m] within one cell from ``u`` on; ``place`` is x, y, direction."""
    w0, w1 = u / h - cell, (u + step) / h - cell
    first, second = mean[NODES + cell], mean[NODES + cell + 1]
    k0, k1 = first + w0 * (second - first), first + w1 * (second - first)
    theta = place[2]
    middle = theta + step * (0.375 * k0 + 0.125 * k1)
    end = theta + 0.5 * step * (k0 + k1)
    # Simpson's rule.
    place[0] += step / 6.0 * (math.cos(theta) + 4.0 * math.cos(middle) + math.cos(end))
    place[1] += step / 6.0 * (math.sin(theta) + 4.0 * math.sin(middle) + math.sin(end))
    place[2] = end
    bend = 0.5 * (k0 + k1)
    for j in range(NODES + cell + 2):
        a = along[j]
        along[j] += step * bend * (across[j] + 0.5 * step * turn[j])
        across[j] += step * (turn[j] - bend * a)
    j, square = NODES + cell, step * step
    across[j] += square * ((1.0 - w0) / 3.0 + (1.0 - w1) / 6.0)
    across[j + 1] += square * (w0 / 3.0 + w1 / 6.0)
    turn[j] += step * (1.0 - 0.5 * (w0 + w1))
    turn[j + 1] += step * 0.5 * (w0 + w1)
    across[OFFSET] += step * (k1 - k0) * 0.5
    turn[OFFSET] += k1 - k0


@kernel
def walk(
    mean: FloatArray,
    h: float,
    spacing: float,
    points: FloatArray,
    directions: FloatArray,
    jacobian: FloatArray,
    work: FloatArray,
) -> None:
    """Waypoints (n, 2), the road's directions (n,) there and the normals' derivatives (n, N).

    Everything in the car's frame. ``work`` (3, N + 1) is scratch.
    """
    n, size = points.shape[0], mean.shape[0]
    turn, across, along, place = work[0], work[1], work[2], work[3]
    for j in range(size):
        turn[j] = across[j] = along[j] = 0.0
    d, e = mean[D], mean[HEADING]
    place[0], place[1], place[2] = -d * math.sin(e), -d * math.cos(e), -e
    across[D], turn[HEADING], along[HEADING] = -1.0, -1.0, -d
    u, last = mean[OFFSET], size - NODES - 2
    cell = min(max(int(u / h), 0), last)
    for i in range(n):
        target = mean[OFFSET] + i * spacing
        while target - u > 1e-9:
            end = target if cell == last else min(target, (cell + 1) * h)
            if end > u:
                _piece(mean, h, u, end - u, cell, place, turn, across, along)
            u = end
            if cell < last and u >= (cell + 1) * h - 1e-12:
                cell += 1
        points[i, 0], points[i, 1], directions[i] = place[0], place[1], place[2]
        for j in range(size):
            jacobian[i, j] = across[j]
        # White errors of the measured pose act as lateral and heading error do.
        jacobian[i, POSE_D], jacobian[i, POSE_HEADING] = across[D], across[HEADING]
