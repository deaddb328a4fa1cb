"""Random roads for benchmark and tuning, each by another method than ``random_road``.

What is learned on ``random_road`` and tuned on ``harmonic_road`` is tested on the three others:
they have no law of their shape in common with those two or with each other. All are open, begin at
the origin along +x, have continuous curvature, and swing about +x. A generator's kind is part of
what it draws from, so that equal seeds of two generators have nothing in common.
"""

from __future__ import annotations

import hashlib
import math
from abc import abstractmethod
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import model_validator

from steersman.bounds import in_order
from steersman.config import param, register
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, from_segments
from steersman.types import FloatArray

# Distance between knots of the curvature where it does not come in clothoids [m].
_STEP = 1.0
# A road that has turned so far from +x turns back [rad].
_FAR = 1.2


class GeneratedRoad(PathComponent):
    """An open road whose curvature is drawn as a function of arc length, linear between knots."""

    ranges: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Pairs of fields, the ends of what is drawn between them [m]."""

    seed: int = param(0, "-", "decides the road, together with the kind", ge=0)
    distance: float = param(600.0, "m", "length of the road", ge=50.0, le=1e5)
    min_radius: float = param(15.0, "m", "smallest radius", ge=1.0, le=1e4)

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for low, high in self.ranges:
            in_order(self, low, high, "m")
        return self

    @abstractmethod
    def curvature(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Arc lengths of the knots from 0 to beyond ``distance`` [m], and curvature there [1/m]."""

    def build_table(self) -> PathTable:
        """Clothoids between the knots; curvature is limited to that of the smallest radius."""
        word = int.from_bytes(hashlib.sha256(self.kind.encode()).digest()[:4], "big")
        s, kappa = self.curvature(np.random.default_rng([word, self.seed]))
        inside = s < self.distance
        ends = np.append(s[inside], self.distance)
        most = 1.0 / self.min_radius
        bends = np.clip(np.interp(ends, s, kappa), -most, most)
        rows = zip(np.diff(ends).tolist(), bends[:-1].tolist(), bends[1:].tolist(), strict=True)
        return from_segments([Segment(*row) for row in rows])


@register("path", "harmonic_road")
class HarmonicRoad(GeneratedRoad):
    """A sum of sines over arc length, with random wavelengths and phases, is the curvature."""

    ranges: ClassVar = (("shortest", "longest"),)

    waves: int = param(6, "-", "number of sines", ge=1, le=100)
    shortest: float = param(40.0, "m", "shortest wavelength", ge=5.0, le=1e5)
    longest: float = param(250.0, "m", "longest wavelength", ge=5.0, le=1e5)

    def curvature(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """The largest curvature of the road is that of the smallest radius."""
        s = np.arange(0.0, self.distance + 2.0 * _STEP, _STEP)
        wavelength = np.exp(
            rng.uniform(math.log(self.shortest), math.log(self.longest), self.waves)
        )
        phase = rng.uniform(0.0, math.tau, self.waves)
        size = rng.uniform(0.5, 1.0, self.waves)
        total = size @ np.sin(math.tau * s / wavelength[:, None] + phase[:, None])
        return s, total / (np.max(np.abs(total)) * self.min_radius)


@register("path", "clothoid_road")
class ClothoidRoad(GeneratedRoad):
    """Clothoid follows clothoid between curvatures that are drawn: it never stops changing."""

    ranges: ClassVar = (("shortest", "longest"), ("min_radius", "max_radius"))

    max_radius: float = param(300.0, "m", "largest radius at a knot", ge=1.0, le=1e5)
    shortest: float = param(12.0, "m", "shortest clothoid", ge=1.0, le=1e3)
    longest: float = param(45.0, "m", "longest clothoid", ge=1.0, le=1e3)

    def curvature(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Radii are drawn evenly in their logarithm; bends turn a road back that swings out."""
        s, kappa, psi = [0.0], [0.0], 0.0
        low, high = math.log(self.min_radius), math.log(self.max_radius)
        while s[-1] <= self.distance:
            size = math.exp(-rng.uniform(low, high))
            side = -psi if abs(psi) > _FAR else rng.uniform(-1.0, 1.0)
            # The next clothoid alone must not turn it too far.
            step = min(rng.uniform(self.shortest, self.longest), 1.0 / max(size, abs(kappa[-1])))
            kappa.append(math.copysign(size, side))
            s.append(s[-1] + max(step, self.shortest))
            psi += 0.5 * (kappa[-1] + kappa[-2]) * (s[-1] - s[-2])
        return np.array(s), np.array(kappa)


@register("path", "spline_road")
class SplineRoad(GeneratedRoad):
    """A cubic spline through random points, as a road is drawn by hand on a map."""

    ranges: ClassVar = (("shortest", "longest"),)

    shortest: float = param(18.0, "m", "shortest distance between points", ge=1.0, le=1e3)
    longest: float = param(45.0, "m", "longest distance between points", ge=1.0, le=1e3)
    turn: float = param(0.45, "rad", "SD of the turn at a point", gt=0.0, le=1.5)

    def curvature(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """That of the spline, over its own arc length."""
        from scipy.interpolate import CubicSpline  # it takes a while to import

        count = math.ceil(self.distance / self.shortest) + 3
        gaps = rng.uniform(self.shortest, self.longest, count)
        psi = np.zeros(count)
        for i, turn in enumerate(rng.normal(0.0, self.turn, count - 1)):
            psi[i + 1] = 0.8 * psi[i] + turn
        place = np.cumsum(gaps * np.array([np.cos(psi), np.sin(psi)]), axis=1)
        knots = np.cumsum(gaps)
        spline = CubicSpline(knots, place, axis=1)
        t = np.arange(knots[0], knots[-1], 0.25 * _STEP)
        return _of_curve(spline(t), spline(t, 1), spline(t, 2))


@register("path", "surveyed_road")
class SurveyedRoad(GeneratedRoad):
    """A road as a survey leaves it: straights and arcs, measured point by point, smoothed.

    The straights and arcs join without transitions; points along them are measured with an error;
    a smoothing spline that keeps that error from them is the road.
    """

    ranges: ClassVar = (("min_radius", "max_radius"),)

    max_radius: float = param(250.0, "m", "largest radius of an arc", ge=1.0, le=1e5)
    longest: float = param(80.0, "m", "longest straight", ge=1.0, le=1e5)
    spacing: float = param(10.0, "m", "distance between points", ge=1.0, le=100.0)
    error: float = param(0.03, "m", "SD of a point in x and in y", gt=0.0, le=1.0)

    def curvature(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """That of the smoothing spline, over its own arc length."""
        from scipy.interpolate import splev, splprep  # it takes a while to import

        true = self._points(rng)
        measured = true + rng.normal(0.0, self.error, true.shape)
        knots = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(measured, axis=1)))))
        allowed = 2.0 * knots.size * self.error**2
        tck, _ = splprep(measured, u=knots, s=allowed)
        t = np.arange(0.0, knots[-1], 0.25 * _STEP)
        return _of_curve(*(np.array(splev(t, tck, der=order)) for order in range(3)))

    def _points(self, rng: np.random.Generator) -> FloatArray:
        """Points (2, n) at even distances along straights and arcs."""
        bends: list[float] = []
        psi = 0.0
        low, high = math.log(self.min_radius), math.log(self.max_radius)
        while len(bends) * _STEP <= self.distance + 3.0 * self.spacing:
            kappa = math.exp(-rng.uniform(low, high))
            turn = rng.uniform(-_FAR, _FAR) - psi
            bends += [0.0] * math.ceil(rng.uniform(0.0, self.longest) / _STEP)
            bends += [math.copysign(kappa, turn)] * math.ceil(abs(turn) / kappa / _STEP)
            psi = float(np.sum(bends)) * _STEP
        angle = np.cumsum(bends) * _STEP
        place = np.cumsum([np.cos(angle), np.sin(angle)], axis=1) * _STEP
        points: FloatArray = place[:, :: round(self.spacing / _STEP)]
        return points


def _of_curve(place: Any, first: Any, second: Any) -> tuple[FloatArray, FloatArray]:
    """Arc length and curvature at points of a curve, from its derivatives, each (2, n)."""
    s = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(place, axis=1)))))
    kappa = (first[0] * second[1] - first[1] * second[0]) / np.hypot(*first) ** 3
    every = max(1, round(_STEP / float(s[1])))
    return s[::every], kappa[::every]
