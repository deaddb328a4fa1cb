"""Paths from the user's own files: a cubic spline through the points of a CSV file."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import ClassVar, NamedTuple

import numpy as np

from steersman.config import param, register, required
from steersman.errors import DataError
from steersman.kernels.path import PathTable
from steersman.paths.base import PathComponent
from steersman.paths.points import Points, read_points
from steersman.paths.segments import MAX_LENGTH, from_samples
from steersman.types import FloatArray

_SPACING = 1.0
_TURN = 0.1
_PROBES = 8
_SHARPEST = 10.0
_LEAST_TO_SMOOTH = 4


class _Curve(NamedTuple):
    """A plane curve over a parameter: position and its first two derivatives, each (2, n)."""

    knots: FloatArray
    evaluate: Callable[[FloatArray, int], FloatArray]


@register("path", "csv")
class CsvPath(PathComponent):
    """A cubic spline through the points of a CSV file.

    The header is ``x,y``, or that of the TUM racetrack database
    (``# x_m,y_m,w_tr_right_m,w_tr_left_m``). A column of speeds (``vx_mps``, ``v``, ``speed``,
    ``velocity``, ...) is what ``speed=path`` drives; other columns are not read.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".csv",)

    file: FilePath = required("-", "CSV file with the columns x,y or x_m,y_m [m]")
    loop: bool | None = param(None, "-", "whether the end joins the start; null: if it is near")
    smoothing: float = param(
        0.0, "m", "RMS distance that the curve may keep from the points", ge=0.0, le=100.0
    )

    def build_table(self) -> PathTable:
        """Short clothoids through positions and tangents of the spline.

        Raises:
            DataError: the file cannot be used; one line says where and what to do.
        """
        return table_through(read_points(self.file, self.loop), self.smoothing)

    def speeds(self) -> tuple[FloatArray, FloatArray] | None:
        """Arc lengths [m] of the file's points and their speeds [m/s], if it has a column of them.

        Raises:
            DataError: a speed is no number, or negative.
        """
        points = read_points(self.file, self.loop, speeds=True)
        if points.speed is None:
            return None
        at, s = [0.0], 0.0
        gaps = np.hypot(np.diff(points.x), np.diff(points.y))
        for x, y, gap in zip(points.x[1:], points.y[1:], gaps, strict=True):
            s = self.project(float(x), float(y), s + float(gap))[0]
            at.append(s)
        return np.array(at), points.speed


def table_through(points: Points, smoothing: float) -> PathTable:
    """Short clothoids through positions and tangents of a cubic spline.

    ``smoothing``: RMS distance that the spline may keep from the points [m].

    Raises:
        DataError: there is no such curve, or it turns too sharply.
    """
    curve = _spline(points, smoothing)
    t = _samples(points, curve)
    (x, y), (dx, dy) = curve.evaluate(t, 0), curve.evaluate(t, 1)
    if points.closed:
        x[-1], y[-1], dx[-1], dy[-1] = x[0], y[0], dx[0], dy[0]
    try:
        return from_samples(x, y, np.arctan2(dy, dx), closed=points.closed)
    except DataError as error:
        raise DataError(f"{points.file}: {error}; set smoothing or thin the points out") from None


def _spline(points: Points, smoothing: float) -> _Curve:
    """The spline over the cumulated chord length."""
    # Imported here because it takes a while, which only this kind of path should cost.
    from scipy.interpolate import CubicSpline, splev, splprep

    place = np.stack((points.x, points.y))
    if points.closed:
        place = np.append(place, place[:, :1], axis=1)
    knots = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(place, axis=1)))))
    if knots[-1] > MAX_LENGTH:
        raise DataError(
            f"{points.file}: the path is {knots[-1]:.3g} m long, the most is {MAX_LENGTH:.0f} m;"
            f" give positions in metres"
        )
    if smoothing == 0.0:
        spline = CubicSpline(
            knots, place, axis=1, bc_type="periodic" if points.closed else "not-a-knot"
        )
        return _Curve(knots, lambda t, order: np.asarray(spline(t, order)))
    if len(knots) < _LEAST_TO_SMOOTH:
        raise DataError(f"{points.file}: smoothing needs at least {_LEAST_TO_SMOOTH} points")
    allowed = len(knots) * smoothing**2
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            tck, _ = splprep(place, u=knots, s=allowed, per=int(points.closed))
        except (RuntimeWarning, ValueError):
            raise DataError(
                f"{points.file}: no curve keeps {smoothing} m from the points; change smoothing"
            ) from None
    return _Curve(knots, lambda t, order: np.asarray(splev(t, tck, der=order)))


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
            f" mend the points, thin them out or set smoothing",
        )
    need = np.maximum(np.max(speed, axis=1) / _SPACING, np.max(bend * speed, axis=1) / _TURN)
    count = np.maximum(np.ceil(need * width), 1.0).astype(np.int64)
    which = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    inner = curve.knots[which] + width[which] * nth / count[which]
    return np.append(inner, curve.knots[-1])
