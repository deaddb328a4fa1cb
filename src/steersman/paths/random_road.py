"""Random roads of straights, clothoids and arcs, all decided by a seed."""

from __future__ import annotations

import math

import numpy as np
from pydantic import model_validator

from steersman.bounds import in_order
from steersman.config import param, register
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, from_segments, turned

# Corners that turn less are not worth the name; also keeps every corner's length above zero.
_LEAST_TURN = 0.1
_SHORTEST = 1e-3


@register("path", "random_road")
class RandomRoad(PathComponent):
    """A random open road with continuous curvature, from the origin along +x.

    Corner follows corner: a clothoid, an arc (if the corner turns far enough), a clothoid, and a
    straight whose mean length gives the wanted share. Each corner turns to a new heading, drawn
    within ``max_heading`` of +x; below a quarter turn the road therefore never crosses itself.
    """

    seed: int = param(0, "-", "decides the road", ge=0)
    distance: float = param(1000.0, "m", "length of the road", ge=1.0, le=1e5)
    min_radius: float = param(15.0, "m", "smallest radius", ge=1.0, le=1e4)
    max_radius: float = param(200.0, "m", "largest radius of an arc", ge=1.0, le=1e5)
    straights: float = param(0.25, "-", "share of the length that is straight", ge=0.0, le=1.0)
    min_clothoid: float = param(8.0, "m", "shortest clothoid", ge=0.5, le=1e3)
    max_clothoid: float = param(35.0, "m", "longest clothoid", ge=0.5, le=1e3)
    max_heading: float = param(1.4, "rad", "largest heading away from +x", ge=0.2, le=6.3)

    @model_validator(mode="after")
    def _check(self) -> RandomRoad:
        for name in ("radius", "clothoid"):
            in_order(self, f"min_{name}", f"max_{name}", "m")
        return self

    def segments(self) -> list[Segment]:
        """The segments of the road; the last one is cut to the road's length."""
        rng = np.random.default_rng(self.seed)
        out: list[Segment] = []
        left, psi = self.distance, 0.0
        while left > _SHORTEST:
            all_straight = self.straights >= 1.0
            corner = [Segment(left, 0.0, 0.0)] if all_straight else self._corner(rng, psi)
            psi += sum(turned(*segment[:3]) for segment in corner)
            for segment in (*corner, *self._straight(rng, corner)):
                if left > _SHORTEST:
                    out.append(_cut(segment, left))
                    left -= out[-1].length
        # What was left over is too short for a segment: the last one takes it.
        out[-1] = out[-1]._replace(length=out[-1].length + left)
        return out

    def build_table(self) -> PathTable:
        """All segments, open."""
        return from_segments(self.segments())

    def _corner(self, rng: np.random.Generator, psi: float) -> list[Segment]:
        turn = rng.uniform(-self.max_heading, self.max_heading) - psi
        if abs(turn) < _LEAST_TURN:
            turn = -math.copysign(_LEAST_TURN, psi)
        # Radii are drawn evenly in their logarithm, so that sharp corners are not rare.
        low, high = math.log(self.min_radius), math.log(self.max_radius)
        kappa = math.exp(-rng.uniform(low, high))
        size = rng.uniform(self.min_clothoid, self.max_clothoid)
        # Both clothoids together turn kappa x size: a smaller turn has no arc and a lower peak.
        kappa = math.copysign(min(kappa, abs(turn) / size), turn)
        arc = turn / kappa - size
        middle = [Segment(arc, kappa, kappa)] if arc > _SHORTEST else []
        return [Segment(size, 0.0, kappa), *middle, Segment(size, kappa, 0.0)]

    def _straight(self, rng: np.random.Generator, corner: list[Segment]) -> list[Segment]:
        if not 0.0 < self.straights < 1.0:
            return []
        share = self.straights / (1.0 - self.straights)
        length = rng.uniform(0.2, 1.8) * share * sum(segment.length for segment in corner)
        return [Segment(length, 0.0, 0.0)] if length > _SHORTEST else []


def _cut(segment: Segment, length: float) -> Segment:
    """The first ``length`` metres of a segment."""
    if length >= segment.length:
        return segment
    part = length / segment.length
    end = segment.kappa_start + part * (segment.kappa_end - segment.kappa_start)
    return Segment(length, segment.kappa_start, end, segment.name)
