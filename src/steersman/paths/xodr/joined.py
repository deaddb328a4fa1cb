"""Curves of lanes, one behind the other, as the samples of one smooth path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from steersman.errors import DataError
from steersman.paths.xodr.lane_line import Curve
from steersman.types import FloatArray

MAX_ASIDE = 0.1
"""A lane whose next one begins further to the side [m] does not go on there: it ends or merges."""
MAX_AHEAD = 0.5
"""... or further ahead or behind [m]."""
MAX_KINK = 0.2
"""... or in a direction that differs by more [rad]."""
# Shorter curves only repeat what their neighbours say, with more rounding [m].
_SHORTEST = 0.02
# Samples are at least so far apart [m]: closer, rounded figures would pass for bends.
_CLOSEST = 0.05
# A step to the side is spread over both lanes so that it bends them by no more than this [1/m],
# within these distances [m].
_EASE_BEND, _EASE_LEAST, _EASE_MOST = 0.005, 1.0, 10.0
_EXACT = 1e-6


class Gap(NamedTuple):
    """How one curve's beginning lies seen from another's end."""

    ahead: float
    aside: float
    """Left positive [m]."""
    kink: float
    """Change of direction [rad]."""

    @property
    def passable(self) -> bool:
        """Whether it is small enough to be driven as a joint."""
        return (
            abs(self.ahead) <= MAX_AHEAD
            and abs(self.aside) <= MAX_ASIDE
            and abs(self.kink) <= MAX_KINK
        )


def gap(a: Curve, b: Curve) -> Gap:
    """The gap between the end of ``a`` and the beginning of ``b``."""
    dx, dy, psi = b.x[0] - a.x[-1], b.y[0] - a.y[-1], a.psi[-1]
    c, s = math.cos(psi), math.sin(psi)
    kink = math.remainder(float(b.psi[0] - psi), math.tau)
    return Gap(float(dx * c + dy * s), float(dy * c - dx * s), kink)


def joined(curves: Sequence[Curve], closed: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions and directions along all curves, as ``segments.from_samples`` takes them.

    Where two curves meet but for a little, the path goes through the middle of both ends, in
    the mean direction; a step to the side is eased into both lanes.

    Raises:
        DataError: neighbouring curves do not meet.
    """
    rows = [curve for curve in curves if curve.length > _EXACT]
    # An open path begins and ends where its first and last curve do, however short they are.
    ends = (0, len(rows) - 1) if not closed else ()
    rows = [row for i, row in enumerate(rows) if row.length > _SHORTEST or i in ends]
    if sum(row.length for row in rows) < _SHORTEST:
        raise DataError("the path is shorter than 2 cm")
    pairs = [(i, (i + 1) % len(rows)) for i in range(len(rows) - (not closed))]
    gaps = [gap(rows[i], rows[j]) for i, j in pairs]
    for found in gaps:
        if not found.passable:
            raise DataError(
                f"the lane's next piece begins {found.ahead:.2f} m ahead, {found.aside:.2f} m to"
                f" the left, turned by {found.kink:.2f} rad; the map does not join here"
            )
    steps = {i: found.aside for i, found in enumerate(gaps) if abs(found.aside) > _EXACT}
    return _thinned(*_nodes(_eased(rows, steps, closed) if steps else rows, closed))


def _eased(rows: list[Curve], steps: dict[int, float], closed: bool) -> list[Curve]:
    """The rows with each step to the left after row i spread over both sides of it.

    Over the distance 2 w the step is made as 3 z^2 - 2 z^3 with z from 0 to 1, which bends the
    rows by at most 6 step / (2 w)^2.
    """
    ends = np.cumsum([row.length for row in rows])
    total = float(ends[-1])
    out = []
    for row, end in zip(rows, ends, strict=True):
        run = end - row.length + np.concatenate(([0.0], np.cumsum(row.steps)))
        # A row's ends belong to its own side of a step.
        run = np.clip(run, run[0] + _EXACT, run[-1] - _EXACT)
        shift, slope = np.zeros_like(run), np.zeros_like(run)
        for i, step in steps.items():
            away = run - ends[i]
            room = max(min(ends[i], total - ends[i]), _CLOSEST)
            if closed:  # the beginning is ahead of the end
                away, room = away - total * np.round(away / total), total / 2.0
            wide = math.sqrt(1.5 * abs(step) / _EASE_BEND)
            wide = min(max(wide, _EASE_LEAST), _EASE_MOST, room)
            z = np.clip(0.5 + 0.5 * away / wide, 0.0, 1.0)
            shift += step * (z * z * (3.0 - 2.0 * z) - (away > 0.0))
            slope += step * 3.0 * z * (1.0 - z) / wide
        x = row.x - shift * np.sin(row.psi)
        y = row.y + shift * np.cos(row.psi)
        out.append(Curve(x, y, row.psi + np.arctan(slope), row.s))
    return out


def _nodes(rows: list[Curve], closed: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """All samples, those of two ends that meet as one between them."""
    x, y, psi = rows[0][:3]
    for row in rows[1:]:
        between = _between((x[-1], y[-1], psi[-1]), (row.x[0], row.y[0], row.psi[0]))
        columns = zip((x, y, psi), between, row[:3], strict=True)
        x, y, psi = (np.concatenate((a[:-1], [m], b[1:])) for a, m, b in columns)
    if closed:
        x, y, psi = x.copy(), y.copy(), psi.copy()
        middle = _between((x[-1], y[-1], psi[-1]), (x[0], y[0], psi[0]))
        for column, value in zip((x, y, psi), middle, strict=True):
            column[0] = column[-1] = value
    return x, y, psi


def _between(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    turn = math.remainder(b[2] - a[2], math.tau)
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), a[2] + 0.5 * turn


def _thinned(
    x: FloatArray, y: FloatArray, psi: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Without samples that come too close after another; the ends stay."""
    kept = [0]
    for i in range(1, len(x) - 1):
        last = kept[-1]
        ahead = (x[i] - x[last]) * math.cos(psi[last]) + (y[i] - y[last]) * math.sin(psi[last])
        if ahead >= _CLOSEST:
            kept.append(i)
    end = len(x) - 1
    if len(kept) > 1 and math.hypot(x[end] - x[kept[-1]], y[end] - y[kept[-1]]) < _CLOSEST:
        kept.pop()
    kept.append(end)
    return x[kept], y[kept], psi[kept]
