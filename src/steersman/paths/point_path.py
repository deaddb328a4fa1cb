"""Paths through points: a cubic spline through what was recorded, drawn or planned."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field, field_validator

from steersman.config import Built, param
from steersman.errors import DataError
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.course import Cleaning, cleaned
from steersman.paths.points import Points
from steersman.paths.segments import MAX_LENGTH, from_samples
from steersman.paths.smoothing import chords
from steersman.types import FloatArray

Smoothing: TypeAlias = Annotated[float, Field(ge=0.0, le=100.0)] | Literal["auto"]
SMOOTHING = "RMS distance that the curve may keep from the points; auto: chosen from their noise"

_SPACING = 1.0
_TURN = 0.1
_PROBES = 8
_SHARPEST = 10.0
# Pieces of a curve: 250 km of straight road, or what a spline makes of one wrong position.
_MOST_PIECES = 250_000


class PointPath(PathComponent):
    """A cubic spline through points, which are thinned, closed and smoothed before."""

    loop: bool | None = param(
        None, "-", "whether the end joins the start; null: if it is near, or passes it"
    )
    spacing: float = param(
        0.0, "m", "points closer to the last one than this are left out", ge=0.0, le=50.0
    )
    smoothing: Smoothing = param(0.0, "m", SMOOTHING)

    @abstractmethod
    def recorded(self, *, speeds: bool = False) -> Points:
        """The points as they were recorded; with ``speeds`` also the speeds there, if known."""

    def cleaned(self, *, speeds: bool = False) -> Points:
        """The points that the curve goes through."""
        smoothing = None if self.smoothing == "auto" else self.smoothing
        by = Cleaning(self.loop, self.spacing, smoothing)
        return cleaned(self.recorded(speeds=speeds), by)

    @cached_property
    def course(self) -> Built[Points]:
        """The points that the curve goes through, made when first used."""
        return Built(self.cleaned())

    def build_table(self) -> PathTable:
        """Short clothoids through positions and tangents of the spline.

        Raises:
            DataError: the file cannot be used; one line says where and what to do.
        """
        return table_through(self.course.value)

    def notes(self) -> tuple[str, ...]:
        """What was assumed about the file, and what was changed."""
        return self.course.value.notes

    def cure(self) -> str:
        """Smoothing, or more of it."""
        if self.smoothing == 0.0:
            return "path.smoothing=auto smooths it by the noise of its points"
        more = 2.0 * self.smoothing if isinstance(self.smoothing, float) else 0.5
        return f"path.smoothing={more:g} lets the curve keep {more:g} m (RMS) from its points"

    def whereabouts(self, s: float) -> str:
        """The point of the file that is nearest to an arc length."""
        points, at = self.course.value, self.at(s)
        row = int(np.argmin(np.hypot(points.x - at.x, points.y - at.y)))
        return f"{points.counted} {points.lines[row]}"

    def speeds(self) -> tuple[FloatArray, FloatArray] | None:
        """Arc lengths [m] of the file's points and their speeds [m/s], if it has a column of them.

        Raises:
            DataError: a speed is no number, or negative.
        """
        points = self.cleaned(speeds=True)
        if points.speed is None:
            return None
        at, s = [0.0], 0.0
        gaps = chords(points.place, closed=False)
        for x, y, gap in zip(points.x[1:], points.y[1:], gaps, strict=True):
            s = self.project(float(x), float(y), s + float(gap))[0]
            at.append(s)
        return np.array(at), points.speed


class _Curve(NamedTuple):
    """A plane curve over a parameter: position and its first two derivatives, each (2, n)."""

    knots: FloatArray
    evaluate: Callable[[FloatArray, int], FloatArray]


class RecordedPath(PointPath):
    """A line out of a recording, which holds the time of each point."""

    loop: bool | None = param(
        None,
        "-",
        "whether it is a lap; null: if a driven line passes its start again, where it is then cut, "
        "or if a planned one's end is near its start",
    )
    window: tuple[float, float] | None = param(
        None, "s", "part of the recording, [from, to] since its first row or message"
    )

    @field_validator("window")
    @classmethod
    def _ordered(cls, window: tuple[float, float] | None) -> tuple[float, float] | None:
        if window is not None and not window[0] < window[1]:
            raise ValueError(f"{list(window)} is not allowed; from must be before to [s]")
        return window


def table_through(points: Points) -> PathTable:
    """Short clothoids through positions and tangents of a cubic spline.

    Raises:
        DataError: the curve is too long, or turns too sharply.
    """
    curve = _spline(points)
    t = _samples(points, curve)
    (x, y), (dx, dy) = curve.evaluate(t, 0), curve.evaluate(t, 1)
    closed = bool(points.closed)
    if closed:
        x[-1], y[-1], dx[-1], dy[-1] = x[0], y[0], dx[0], dy[0]
    try:
        return from_samples(x, y, np.arctan2(dy, dx), closed=closed)
    except DataError as error:
        raise points.error(f"{error}; set smoothing to auto") from None


def _spline(points: Points) -> _Curve:
    """The spline over the cumulated chord length."""
    # Imported here because it takes a while, which only this kind of path should cost.
    from scipy.interpolate import CubicSpline

    place, closed = points.place, bool(points.closed)
    knots = np.concatenate(([0.0], np.cumsum(chords(place, closed))))
    if knots[-1] > MAX_LENGTH:
        raise points.error(
            f"the path is {knots[-1]:.3g} m long, the most is {MAX_LENGTH:.0f} m;"
            f" give positions in metres"
        )
    if closed:
        place = np.concatenate((place, place[:1]))
    spline = CubicSpline(knots, place.T, axis=1, bc_type="periodic" if closed else "not-a-knot")
    return _Curve(knots, lambda t, order: np.asarray(spline(t, order)))


def _samples(points: Points, curve: _Curve) -> FloatArray:
    """Parameters of the pieces' ends: all knots, and between them as many as bends need."""
    width = np.diff(curve.knots)
    probes = curve.knots[:-1, None] + width[:, None] * np.linspace(0.0, 1.0, _PROBES + 1)
    first, second = (
        curve.evaluate(probes.ravel(), order).reshape(2, *probes.shape) for order in (1, 2)
    )
    speed = np.hypot(*first)
    bend = np.abs(first[0] * second[1] - first[1] * second[0]) / np.maximum(speed, 1e-9) ** 3
    sharp = np.flatnonzero(np.max(bend, axis=1) > _SHARPEST)
    if sharp.size:
        row = int(sharp[0])
        radius = 1.0 / float(np.max(bend[row]))
        raise points.fault(
            row,
            f"after this point the curve turns with a radius of {radius:.2g} m;"
            f" set smoothing to auto, or mend the points",
        )
    need = np.maximum(np.max(speed, axis=1) / _SPACING, np.max(bend * speed, axis=1) / _TURN)
    count = np.maximum(np.ceil(need * width), 1.0).astype(np.int64)
    if count.sum() > _MOST_PIECES:
        row = int(np.argmax(count))
        raise points.fault(
            row,
            f"after this point the curve takes {count[row]} of its {count.sum()} pieces, the most"
            f" is {_MOST_PIECES}; are the positions there right, and in metres?",
        )
    which = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    inner = curve.knots[which] + width[which] * nth / count[which]
    return np.append(inner, curve.knots[-1])
