"""Height and banking along a way over lanes.

ASAM OpenDRIVE 1.8, chapter 10.5: elevation, superelevation; crossfall: 1.3 to 1.5.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from steersman.kernels import path as kernel
from steersman.kernels.path import PathTable
from steersman.paths.xodr.lane_line import Curve, at_place
from steersman.paths.xodr.lanes import Place
from steersman.paths.xodr.model import Cubic, Relief, RoadRecord
from steersman.paths.xodr.reference import points
from steersman.paths.xodr.ways import Ways
from steersman.types import FloatArray, Surface

_FLAT = Relief()


def surface_along(ways: Ways, way: Sequence[Place], table: PathTable) -> Surface | None:
    """Height and banking of the path that was laid along a way; None where all roads are flat."""
    roads = [ways.network.roads[place.road] for place in way]
    if all(road.relief == _FLAT for road in roads):
        return None
    rows = [
        (*each, 1.0 if ways.graph.forward(place) else -1.0)
        for place, road in zip(way, roads, strict=True)
        for curve in ways.line(place)
        for each in zip(curve.x, curve.y, *_relief(road, curve), strict=True)
    ]
    x, y, height, bank, sign = np.array(rows).T
    if not (height.any() or bank.any()):
        return None
    length, closed = table.meta[0, kernel.LENGTH], table.meta[0, kernel.CLOSED] > 0.0
    steps = np.hypot(np.diff(x, prepend=x[0]), np.diff(y, prepend=y[0]))
    near, places = 0.0, []
    for here, step in zip(zip(x, y, strict=True), steps, strict=True):
        s = kernel.project_near(table, 0, *here, near + step)[0]
        # Of a lap, the last place is ahead of the first by its length.
        near = s + length * round((near + step - s) / length) if closed else s
        places.append(near)
    order, kept = np.unique(places, return_index=True)
    return Surface(order, height[kept], (sign * bank)[kept])


def _relief(road: RoadRecord, curve: Curve) -> tuple[FloatArray, FloatArray]:
    """Height [m] and banking [rad], left side up seen along the road, under a lane's centre."""
    relief, s = road.relief, curve.s
    low, high = min(s[0], s[-1]), max(s[0], s[-1])
    geometry = at_place(road.geometries, 0.5 * (low + high)) or road.geometries[0]
    line = points(geometry, s - geometry.s)
    aside = (curve.y - line.y) * np.cos(line.psi) - (curve.x - line.x) * np.sin(line.psi)
    left, right = (_evaluated(each, s) for each in relief.fall)
    fall = np.where(aside > 0.0, left, right)
    bank = _evaluated(relief.bank, s)
    height = _evaluated(relief.height, s) + aside * np.sin(bank) - np.abs(aside) * np.sin(fall)
    return height, bank - np.sign(aside) * fall


def _evaluated(rows: Sequence[Cubic], s: FloatArray) -> FloatArray:
    """The value at ``s`` of the record that begins last before it; 0 before the first."""
    if not rows:
        return np.zeros_like(s)
    table = np.array(rows)
    which = np.searchsorted(table[:, 0], s, side="right") - 1
    start, a, b, c, d = table[np.maximum(which, 0)].T
    u = s - start
    return np.where(which >= 0, a + u * (b + u * (c + u * d)), 0.0)
