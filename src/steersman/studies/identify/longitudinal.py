"""The longitudinal fit: the throttle map, drag within it, and the brakes.

The car is let go with its own speed for some seconds again and again, under the recorded pedals
and steering; the speed at each start is another unknown. Initial values come from the starting
vehicle: as long as the car stays near its recorded speed, the answer is linear in the map.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.studies.identify import stretch_replay
from steersman.studies.identify.estimate import estimate
from steersman.studies.identify.in_range import WARM_UP
from steersman.studies.identify.lateral import Fitted
from steersman.studies.identify.misses import Misses, Selection
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
    """A stretch, and where its car is let go: every ``SEGMENT``."""

    stretch: Stretch
    starts: Any
    """(k,) steps of the grid, int64."""
    speeds: FloatArray
    """(k,) recorded there [m/s]."""
    of_row: Any
    """(n,) segment of each row."""
    base: FloatArray
    """States of :func:`stretch_replay.lateral`."""
    clock: float
    """Delay of the measured steering [s]."""

    def released(self, vehicle: Vehicle, speeds: FloatArray) -> FloatArray:
        """Speeds on the grid [m/s] if the car drives on its own from ``speeds`` at the starts."""
        stretch, base, starts = self.stretch, self.base, self.starts
        return stretch_replay.free(vehicle, stretch, base, starts, speeds, self.clock)


def segments(vehicle: Vehicle, stretches: Sequence[Stretch], clock: float = 0.0) -> list[Segments]:
    """The segments of each stretch, laterally driven by ``vehicle``."""
    out, step = [], round(SEGMENT / stretch_replay.H)
    for stretch in stretches:
        starts = np.arange(0, max(len(stretch.speed) - step // 2, 1), step, dtype=np.int64)
        of_row = np.searchsorted(starts * stretch_replay.H, stretch.time + 1e-9, side="right") - 1
        base = stretch_replay.lateral(vehicle, stretch, clock)
        out.append(Segments(stretch, starts, stretch.speed[starts], of_row, base, clock))
    return out


def _shifted(
    vehicle: Vehicle, parts: Sequence[Segments], shifts: FloatArray
) -> Iterator[tuple[Stretch, FloatArray]]:
    """Each stretch with its car's speed on the grid, the starts' speeds shifted [m/s]."""
    at = 0
    for part in parts:
        speeds = np.maximum(part.speeds + shifts[at : at + len(part.starts)], 0.0)
        at += len(part.starts)
        yield part.stretch, part.released(vehicle, speeds)


def _start_speed(n: int) -> Unknown:
    return Unknown("start_speed", (n,), "m/s", 0.0, False, 0.2, 100.0, -20.0, 20.0)


class _Free(Misses):
    """Misses of the speed; all starts of a stretch are moved at once, since they are apart."""

    def __init__(
        self,
        vehicle: Vehicle,
        log: Log,
        parts: Sequence[Segments],
        figures: list[Unknown],
        use: Any,
    ) -> None:
        self._vehicle, self._parts, self._figures = vehicle, parts, figures
        upset, self._start = np.full(len(log.time), True), np.full(len(log.time), -1)
        starts: list[Unknown] = []
        for part in parts:
            stretch = part.stretch
            # A segment in which the car slides says nothing of pedals.
            slid = part.of_row[~stretch.steady & (stretch.time >= WARM_UP)]
            upset[stretch.rows] = np.isin(part.of_row, slid)
            self._start[stretch.rows] = len(starts) + part.of_row
            starts += [_start_speed(len(starts) + k) for k in range(len(part.starts))]
        self._speed = np.where(use & ~upset, log.signals["v_x"], np.nan)
        self.start_prior = starts[-1].prior
        super().__init__(self._simulate, [*figures, *starts], np.array([RESOLUTION["v_x"]]))

    def _simulate(self, z: FloatArray) -> FloatArray:
        count = len(self._figures)
        guess = guess_at(self._vehicle, self._figures, z[:count])
        out = np.full((len(self._speed), 1), np.nan)
        for stretch, speed in _shifted(guess, self._parts, self.start_prior * z[count:]):
            at_rows = stretch_replay.at_rows(stretch, speed)
            out[stretch.rows, 0] = at_rows - self._speed[stretch.rows]
        return out

    def derivative(self, z: FloatArray, which: Any = None, *, wide: bool = False) -> FloatArray:
        """(rows, 1, len(which))."""
        which = np.arange(len(z)) if which is None else np.asarray(which)
        count = len(self._figures)
        of_figures = which[which < count]
        out = np.zeros((len(self._speed), 1, len(which)))
        if of_figures.size:
            out[..., : len(of_figures)] = super().derivative(z, of_figures, wide=wide)
        step = 1e-3
        shift = np.where(np.arange(len(z)) >= count, step, 0.0)
        slope = (self._simulate(z + shift) - self(z))[:, 0] / step
        for column in np.flatnonzero(which >= count):
            out[:, 0, column] = np.where(self._start == which[column] - count, slope, 0.0)
        return out


def fit(
    vehicle: Vehicle, log: Log, stretches: Sequence[Stretch], use: Any, clock: float = 0.0
) -> tuple[Fitted, list[Stretch]]:
    """Search the map's knots near which the car was, and the brakes if they were pressed.

    Returns also the stretches with the commanded pedals, and the speed that model and measurement
    agree on: what the model leaves is smooth, so that more of the sensor's noise is averaged.
    """
    brake = log.get("brake")
    pressed = brake is not None and float(np.nanmax(brake)) > _PRESSED
    figures = pedals(vehicle, brake=pressed)
    count = len(figures)
    misses = _Free(vehicle, log, segments(vehicle, stretches, clock), figures, use)
    near = visited(vehicle, log, stretches, use)
    everything = Selection.of(misses)
    far = [i for i, u in enumerate(figures) if u.at and near[u.at] < _LEAST]
    found = estimate(misses, everything.rest, everything.without(far))
    fitted = Fitted(
        figures,
        found._replace(
            z=found.z[:count],
            determined=found.determined[:count],
            covariance=found.covariance[:count, :count],
            given=[g if g < count else -1 for g in found.given[:count]],
            possible=found.possible[:count],
        ),
        vehicle_at(vehicle, figures, found.z[:count]),
        everything.rest[:count],
    )
    parts, shifts = segments(fitted.vehicle, stretches, clock), misses.start_prior * found.z[count:]
    refined = _shifted(fitted.vehicle, parts, shifts)
    return fitted, [stretch_replay.corrected(log, stretch, speed) for stretch, speed in refined]


def speeds(vehicle: Vehicle, log: Log, stretches: Sequence[Stretch]) -> FloatArray:
    """(rows,) simulated speed [m/s], let go from the recorded one every ``SEGMENT``."""
    out = np.full(len(log.time), np.nan)
    for part in segments(vehicle, stretches):
        speed = part.released(vehicle, part.speeds)
        out[part.stretch.rows] = stretch_replay.at_rows(part.stretch, speed)
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
