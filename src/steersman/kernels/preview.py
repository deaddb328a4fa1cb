"""Reading the road from its waypoints: position and curvature at any arc length ahead."""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# Gap at which a point at a distance counts as not found [m].
_UNSETTLED = 1e-3
_HALVINGS = 50


@kernel
def lies_within(points: FloatArray, most: float) -> bool:
    """Whether no coordinate of the points (n, 2) is NaN or larger than ``most`` [m]."""
    for i in range(points.shape[0]):
        if not (abs(points[i, 0]) <= most and abs(points[i, 1]) <= most):
            return False
    return True


@kernel
def point_at(preview: FloatArray, spacing: float, u: float) -> tuple[float, float]:
    """Position at arc length ``u`` [m] after the first of the waypoints (n >= 4, 2).

    Cubic Lagrange interpolation over arc length; before the first and beyond the last waypoint
    the end's cubic goes on as its tangent.
    """
    n = preview.shape[0]
    inside = min(max(u, 0.0), (n - 1) * spacing)
    over = (u - inside) / spacing
    t = inside / spacing
    k = min(max(int(t) - 1, 0), n - 4)
    t -= k
    a, b, c, d = t, t - 1.0, t - 2.0, t - 3.0
    w0, w1 = -b * c * d / 6.0, a * c * d / 2.0
    w2, w3 = -a * b * d / 2.0, a * b * c / 6.0
    x = w0 * preview[k, 0] + w1 * preview[k + 1, 0] + w2 * preview[k + 2, 0]
    y = w0 * preview[k, 1] + w1 * preview[k + 1, 1] + w2 * preview[k + 2, 1]
    x += w3 * preview[k + 3, 0]
    y += w3 * preview[k + 3, 1]
    if over != 0.0:
        # Derivatives of the four weights, for the tangent at the end.
        g0, g1 = -(c * d + b * d + b * c) / 6.0, (c * d + a * d + a * c) / 2.0
        g2, g3 = -(b * d + a * d + a * b) / 2.0, (b * c + a * c + a * b) / 6.0
        x += over * (
            g0 * preview[k, 0]
            + g1 * preview[k + 1, 0]
            + g2 * preview[k + 2, 0]
            + g3 * preview[k + 3, 0]
        )
        y += over * (
            g0 * preview[k, 1]
            + g1 * preview[k + 1, 1]
            + g2 * preview[k + 2, 1]
            + g3 * preview[k + 3, 1]
        )
    return x, y


@kernel
def at_distance(
    preview: FloatArray, spacing: float, x: float, y: float, distance: float
) -> tuple[float, float]:
    """The road's point that lies ``distance`` [m] from (x, y), ahead of the first waypoint.

    If the road begins farther away or the waypoints end nearer, it is the first or the last one.
    """
    end = (preview.shape[0] - 1) * spacing
    u, p_x, p_y, gap = min(max(distance, 0.0), end), 0.0, 0.0, 0.0
    for _ in range(12):
        p_x, p_y = point_at(preview, spacing, u)
        gap = distance - math.hypot(p_x - x, p_y - y)
        # The distance grows at most as fast as the arc length, so that this step never overshoots
        # where the road leads away from the point.
        after = min(max(u + gap, 0.0), end)
        if abs(gap) < 1e-9 or after == u:
            return p_x, p_y
        u = after
    # Where waypoints lie farther apart than along the road it may, and does not settle.
    return _crossing(preview, spacing, x, y, distance) if abs(gap) > _UNSETTLED else (p_x, p_y)


@kernel
def _crossing(
    preview: FloatArray, spacing: float, x: float, y: float, distance: float
) -> tuple[float, float]:
    """The same by bisection, before the first waypoint that is not nearer."""
    n, k = preview.shape[0], 1
    for i in range(1, n):
        k = i
        if math.hypot(preview[i, 0] - x, preview[i, 1] - y) >= distance:
            break
    near, far, p_x, p_y = (k - 1) * spacing, k * spacing, 0.0, 0.0
    for _ in range(_HALVINGS):
        p_x, p_y = point_at(preview, spacing, 0.5 * (near + far))
        if math.hypot(p_x - x, p_y - y) < distance:
            near = 0.5 * (near + far)
        else:
            far = 0.5 * (near + far)
    return p_x, p_y


@kernel
def curvature_of(preview: FloatArray, i: int) -> float:
    """Curvature at waypoint ``i`` of the circle through it and both its neighbours [1/m].

    Menger's curvature: four times the triangle's area over the product of its sides.
    """
    x_1, y_1 = preview[i, 0] - preview[i - 1, 0], preview[i, 1] - preview[i - 1, 1]
    x_2, y_2 = preview[i + 1, 0] - preview[i, 0], preview[i + 1, 1] - preview[i, 1]
    sides = math.hypot(x_1, y_1) * math.hypot(x_2, y_2) * math.hypot(x_1 + x_2, y_1 + y_2)
    return float(2.0 * (x_1 * y_2 - y_1 * x_2) / max(sides, 1e-12))


@kernel
def curvature_at(preview: FloatArray, spacing: float, beside: float, u: float) -> float:
    """Curvature at arc length ``u`` [m] after the first waypoint, linear between waypoints.

    ``beside`` is the curvature at the first one [1/m]; beyond the last but one, its value holds.
    """
    t = min(max(u / spacing, 0.0), preview.shape[0] - 2.0)
    i = min(int(t), preview.shape[0] - 3)
    before = beside if i == 0 else curvature_of(preview, i)
    return float(before + (t - i) * (curvature_of(preview, i + 1) - before))


@kernel
def fitted_curvature(points: FloatArray, first: int, count: int, spacing: float) -> float:
    """Curvature at the middle of the parabola x(u), y(u) that fits ``count`` points best [1/m].

    The points (n, 2) from ``first`` on, ``spacing`` [m] apart; three at least.
    """
    # u is symmetric, so slope and bend have a least-squares fit of their own.
    mean = spacing * spacing * (count * count - 1.0) / 12.0
    slopes, bends = 0.0, 0.0
    x_1, y_1, x_2, y_2 = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        u = spacing * (i - 0.5 * (count - 1))
        bend = u * u - mean
        x, y = points[first + i, 0], points[first + i, 1]
        slopes += u * u
        bends += bend * bend
        x_1 += u * x
        y_1 += u * y
        x_2 += 2.0 * bend * x
        y_2 += 2.0 * bend * y
    x_1, y_1, x_2, y_2 = x_1 / slopes, y_1 / slopes, x_2 / bends, y_2 / bends
    curvature: float = (x_1 * y_2 - y_1 * x_2) / max((x_1 * x_1 + y_1 * y_1) ** 1.5, 1e-12)
    return curvature
