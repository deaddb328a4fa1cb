"""The longitudinal fit: the throttle map, drag within it, and the brakes.

The car is let go with its own speed for some seconds again and again, under the recorded pedals
and steering; the speed at each start is looked for beside. Initial values come from the starting
vehicle: as long as the car stays near its recorded speed, the answer is linear in the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify import stretch_replay
from steersman.studies.identify.estimate import Misses, estimate
from steersman.studies.identify.lateral import Fitted
from steersman.studies.identify.recording import RESOLUTION, Log
from steersman.studies.identify.stretch_replay import Stretch
from steersman.studies.identify.unknowns import Unknown, guess_at, pedals, vehicle_at
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Time from one start to the next [s].
SEGMENT = 5.0
# A knot has to be near for so long in all [s] to be looked for, and a brake pressed.
_LEAST = 0.05
_PRESSED = 0.02


class Segments(NamedTuple):
    """Starts of a stretch: steps of the grid, recorded speeds there [m/s], segment of each row."""

    starts: Any
    speeds: FloatArray
    of_row: Any


def segments(stretch: Stretch) -> Segments:
    """Starts every ``SEGMENT``."""
    step = round(SEGMENT / stretch_replay.H)
    starts = np.arange(0, max(len(stretch.speed) - step // 2, 1), step, dtype=np.int64)
    of_row = np.searchsorted(starts * stretch_replay.H, stretch.time + 1e-9, side="right") - 1
    return Segments(starts, stretch.speed[starts], of_row)


def _start_speed(n: int) -> Unknown:
    return Unknown("start_speed", (n,), "m/s", 0.0, False, 0.2, 100.0, -20.0, 20.0)


class _Free(Misses):
    """Misses of the speed; all starts of a stretch are moved at once, since they are apart."""

    def __init__(
        self,
        vehicle: Vehicle,
        log: Log,
        stretches: Sequence[Stretch],
        unknowns: Sequence[Unknown],
        use: Any,
    ) -> None:
        self._figures = [u for u in unknowns if u.field != "start_speed"]
        self._vehicle, self._stretches = vehicle, stretches
        self._segments = [segments(stretch) for stretch in stretches]
        self._bases = [stretch_replay.lateral(vehicle, stretch) for stretch in stretches]
        upset = np.full(len(log.time), True)
        for stretch, parts in zip(stretches, self._segments, strict=True):
            # A segment in which the car slides tells nothing of pedals.
            slid = parts.of_row[~stretch.steady & (stretch.time >= stretch_replay.WARM_UP)]
            upset[stretch.rows] = np.isin(parts.of_row, slid)
        self._speed = np.where(use & ~upset, log.signals["v_x"], np.nan)
        self._prior = unknowns[-1].prior
        low, high = np.array([u.bounds() for u in unknowns]).T
        super().__init__(self._simulate, low, high, np.array([RESOLUTION["v_x"]]))

    def _simulate(self, z: FloatArray) -> FloatArray:
        figures = len(self._figures)
        guess = guess_at(self._vehicle, self._figures, z[:figures])
        out = np.full((len(self._speed), 1), np.nan)
        at = figures
        for stretch, parts, base in zip(self._stretches, self._segments, self._bases, strict=True):
            count = len(parts.starts)
            speeds = np.maximum(parts.speeds + self._prior * z[at : at + count], 0.0)
            at += count
            free = stretch_replay.free(guess, stretch, base, parts.starts, speeds)
            out[stretch.rows, 0] = free - self._speed[stretch.rows]
        return out

    def derivative(self, z: FloatArray, which: Any = None, *, wide: bool = False) -> FloatArray:
        """(rows, 1, len(which))."""
        which = np.arange(len(z)) if which is None else np.asarray(which)
        figures = len(self._figures)
        of_figures = which[which < figures]
        out = np.zeros((len(self._speed), 1, len(which)))
        if of_figures.size:
            out[..., : len(of_figures)] = super().derivative(z, of_figures, wide=wide)
        step = 1e-3
        shift = np.where(np.arange(len(z)) >= figures, step, 0.0)
        slope = (self(z + shift) - self(z))[:, 0] / step
        at = figures
        for stretch, parts in zip(self._stretches, self._segments, strict=True):
            for i in range(len(parts.starts)):
                column = np.flatnonzero(which == at + i)
                rows = np.flatnonzero(parts.of_row == i) + stretch.rows.start
                if column.size:
                    out[rows, 0, column[0]] = slope[rows]
            at += len(parts.starts)
        return out


def fit(
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], use: Any
) -> tuple[Fitted, list[Stretch]]:
    """Search the map's knots near which the car was, and the brakes if they were pressed.

    Returns also the stretches with what that tells of speed and pedals.
    """
    brake = log.get("brake")
    pressed = brake is not None and float(np.nanmax(brake)) > _PRESSED
    figures = pedals(vehicle, brake=pressed)
    starts = sum(len(segments(stretch).starts) for stretch in stretches)
    unknowns = [*figures, *(_start_speed(n) for n in range(starts))]
    misses = _Free(vehicle, log, stretches, unknowns, use)
    near = visited(vehicle, log, stretches, use)
    wanted = np.array(
        [u.field != "map_acceleration" or near[u.at] >= _LEAST for u in unknowns], dtype=bool
    )
    need, zero = np.array([u.need_z for u in unknowns]), np.zeros(len(unknowns))
    found = estimate(misses, zero, zero, need, wanted)
    count = len(figures)
    fitted = Fitted(
        figures,
        found._replace(
            z=found.z[:count],
            told=found.told[:count],
            covariance=found.covariance[:count, :count],
            alone=found.alone[:count],
            given=[g if g < count else -1 for g in found.given[:count]],
            possible=found.possible[:count],
        ),
        vehicle_at(vehicle, figures, found.z[:count]),
        zero[:count],
    )
    return fitted, _refined(fitted.vehicle, log, stretches, unknowns[-1].prior * found.z[count:])


def _refined(
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], shifts: FloatArray
) -> list[Stretch]:
    """Stretches with the commanded pedals, and the speed that model and measurement agree on.

    What the model leaves is smooth, so that more of the sensor's noise can be averaged.
    """
    out, at = [], 0
    for stretch in stretches:
        parts, base = segments(stretch), stretch_replay.lateral(vehicle, stretch)
        count = len(parts.starts)
        speeds = np.maximum(parts.speeds + shifts[at : at + count], 0.0)
        at += count
        free = stretch_replay.free_grid(vehicle, stretch, base, parts.starts, speeds)
        out.append(stretch_replay.corrected(log, stretch, free))
    return out


def speeds(vehicle: Vehicle, log: Log, stretches: Sequence[Stretch]) -> FloatArray:
    """(rows,) simulated speed [m/s], let go from the recorded one every ``SEGMENT``."""
    out = np.full(len(log.time), np.nan)
    for stretch in stretches:
        parts, base = segments(stretch), stretch_replay.lateral(vehicle, stretch)
        out[stretch.rows] = stretch_replay.free(vehicle, stretch, base, parts.starts, parts.speeds)
    return out


def visited(vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], use: Any) -> FloatArray:
    """Time spent near each knot of the map without braking [s], (throttles, speeds)."""
    levels, knots = np.array(vehicle.map_throttle), np.array(vehicle.map_speed)
    out = np.zeros((len(levels), len(knots)))
    for stretch in stretches:
        if stretch.pedals is None:
            continue
        grid = stretch_replay.H * np.arange(len(stretch.pedals))
        row = np.clip(np.searchsorted(stretch.time, grid, side="right") - 1, 0, None)
        counts = use[stretch.rows][row] & (stretch.pedals[:, 1] < _PRESSED)
        by_level = _hats(levels, stretch.pedals[counts, 0])
        by_speed = _hats(knots, stretch.speed[:-1][counts])
        out += stretch_replay.H * by_level @ by_speed.T
    return out


def _hats(knots: FloatArray, x: FloatArray) -> FloatArray:
    """Weights of piecewise linear interpolation, (knots, x)."""
    return np.array([np.interp(x, knots, row) for row in np.eye(len(knots))])
