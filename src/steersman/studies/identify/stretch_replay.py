"""A stretch of a recording on the simulator's grid, and a vehicle's response to it.

The lateral side is driven at the recorded speed, so that its response depends on nothing
longitudinal, and errors of its start decay; the longitudinal side runs freely for some seconds from
each of many starts (output error in segments, a multiple shooting).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import recorded_response as kernel
from steersman.kernels import vehicle as car
from steersman.studies.identify.completion import low_pass
from steersman.studies.identify.in_range import Reasons, reasons, steady
from steersman.studies.identify.recording import Log, pieces
from steersman.studies.identify.unknowns import Sensors
from steersman.types import FloatArray
from steersman.vehicles import LONGEST_STEP, Vehicle

H = LONGEST_STEP
"""Step of the simulation [s], as the simulator's own."""
# Before a stretch, its first command was held for longer than any delay [s].
_BEFORE = 5.0
# Noise of a speed sensor at which half a second is averaged [m/s].
_NOISY = 0.05
_WINDOW, _LONG_WINDOW = 0.5, 2.0
# Speed samples that lie so many deviations off their neighbours are left out.
_OUTLIER = 6.0
_NEIGHBOURS = 3


class Stretch(NamedTuple):
    """Commands and speed every ``H`` from the first row's time on."""

    rows: slice
    time: FloatArray
    """Times of the rows since the first [s]."""
    speed: FloatArray
    """(m + 1,) smoothed [m/s]."""
    steer: tuple[FloatArray, FloatArray]
    """Times [s], and the integral of the held commands up to them [s]."""
    pedals: FloatArray | None
    """(m, 2) throttle and brake as commanded."""
    driven: FloatArray
    """(m, 2) throttle and brake that give the recorded acceleration."""
    yaw_rate: float
    """At the start [rad/s]."""
    left_out: Reasons
    """Rows that are out of the model's range, and why."""
    steady: Any
    """(n,) bool: rows by which the answer has forgotten its start and what is left out."""

    def without(self, upset: Any) -> Stretch:
        """The same with the rows ``upset`` (n,) bool left out."""
        why = self.left_out._replace(upset=upset)
        return self._replace(left_out=why, steady=self.range_of(why))

    def range_of(self, why: Reasons) -> Any:
        """(n,) bool: rows that would be steady if those of ``why`` were left out."""
        return steady(self.time, why)


def stretches(log: Log, vehicle: Vehicle) -> list[Stretch]:
    """The recording without its gaps; pedals that explain its speeds come from ``vehicle``."""
    return [of_rows(log, rows, vehicle) for rows in pieces(log)]


def of_rows(log: Log, rows: slice, vehicle: Vehicle) -> Stretch:
    """The stretch of those rows, which have no gap."""
    time = log.time[rows] - log.time[rows.start]
    count = int(np.ceil(time[-1] / H - 1e-6))
    grid = _grid(count + 1)
    speed = _smoothed(time, log.signals["v_x"][rows], grid)
    steer = _integral(time, log.signals["steer_command"][rows], measured=log.by_angle)
    throttle, brake = log.get("throttle"), log.get("brake")
    pedals = None
    if throttle is not None:
        given = [throttle, np.zeros_like(throttle) if brake is None else brake]
        pedals = np.column_stack([_held(_integral(time, p[rows]), grid, 0.0) for p in given])
    rate = log.signals["yaw_rate"][rows]
    first = rate[np.isfinite(rate)][:5]
    start = float(np.median(first)) if first.size else 0.0
    driven = _driven(vehicle, speed)
    why = reasons(np.interp(time, grid, speed), rate, vehicle.friction)
    return Stretch(rows, time, speed, steer, pedals, driven, start, why, steady(time, why))


def _smoothed(
    time: FloatArray, speed: FloatArray, grid: FloatArray, window: float = _WINDOW
) -> FloatArray:
    """Speed on the grid: outliers left out, quadratics through a window that fits the noise."""
    from scipy.signal import savgol_filter

    known = np.isfinite(speed)
    time, speed = time[known], speed[known]
    if len(speed) < _NEIGHBOURS:
        return np.zeros_like(grid)
    noise = noise_of(speed)
    near = np.lib.stride_tricks.sliding_window_view(
        np.pad(speed, _NEIGHBOURS, mode="edge"), 2 * _NEIGHBOURS + 1
    )
    off = np.abs(speed - np.median(near, axis=1)) > _OUTLIER * noise + 0.5
    even: FloatArray = np.interp(grid, time[~off], speed[~off])
    width = window * min(noise / _NOISY, 1.0) ** 0.4
    points = 2 * round(0.5 * width / H) + 1
    if points < 5 or points >= len(even):  # noqa: PLR2004 - too few for a quadratic
        return even
    return np.asarray(savgol_filter(even, points, 2))


def _grid(count: int) -> FloatArray:
    return np.asarray(H * np.arange(count), dtype=np.float64)


def noise_of(values: FloatArray) -> float:
    """Standard deviation of white noise on a smooth signal, from its second differences."""
    second = np.diff(values, 2)
    return float(1.4826 * np.median(np.abs(second)) / np.sqrt(6.0)) if second.size else 0.0


def _integral(
    time: FloatArray, command: FloatArray, *, measured: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Integral of a command that is held until the next row; an empty cell holds the one before.

    What is ``measured`` goes straight on to the next row instead.
    """
    known = np.flatnonzero(np.isfinite(command))
    if not known.size:
        return np.array([-_BEFORE, _BEFORE]), np.zeros(2)
    at = np.maximum(np.searchsorted(known, np.arange(len(command)), side="right") - 1, 0)
    held = command[known[at]]
    times = np.concatenate([[-_BEFORE], time, [time[-1] + _BEFORE]])
    after = np.concatenate([held, held[-1:]]) if measured else np.concatenate([held[:1], held])
    steps = np.diff(times) * (0.5 * (after + np.concatenate([held[:1], held])))
    return times, np.concatenate([[0.0], np.cumsum(steps)])


def _held(integral: tuple[FloatArray, FloatArray], grid: FloatArray, delay: float) -> FloatArray:
    """Mean of the command over each step of the grid, ``delay`` later; smooth in the delay."""
    total = np.interp(grid - delay, *integral)
    return np.asarray(np.diff(total) / H)


def _driven(vehicle: Vehicle, speed: FloatArray) -> FloatArray:
    """Throttle and brake (m, 2) whose acceleration on a straight is that of the speed."""
    wanted, middle = np.diff(speed) / H, 0.5 * (speed[1:] + speed[:-1])
    knots, rows = np.array(vehicle.map_speed), vehicle.map_acceleration
    levels = np.array([np.interp(middle, knots, row) for row in rows])
    throttle = np.full(len(wanted), vehicle.map_throttle[0])
    for i in range(1, len(levels)):
        low, high = levels[i - 1], levels[i]
        share = np.clip((wanted - low) / np.where(high > low, high - low, np.inf), 0.0, 1.0)
        gain = vehicle.map_throttle[i] - vehicle.map_throttle[i - 1]
        throttle = np.where(wanted > low, vehicle.map_throttle[i - 1] + share * gain, throttle)
    short = np.maximum(levels[0] - wanted, 0.0) * vehicle.mass
    brake = np.clip(short / max(vehicle.brake_force, 1.0), 0.0, 1.0)
    return np.column_stack([throttle, brake])


def lateral(vehicle: Vehicle, stretch: Stretch, clock: float = 0.0) -> FloatArray:
    """States (m + 1, N_STATE) at the recorded speed; ``clock`` [s] adds to the steering delay."""
    grid = _grid(len(stretch.speed))
    steer = _held(stretch.steer, grid, _whole(vehicle.steer_delay + clock))
    commands = np.column_stack([steer, stretch.driven])
    base = np.zeros((len(grid), car.N_STATE))
    base[:, car.VX] = stretch.speed
    base[0, [car.YAW_RATE, car.STEER]] = stretch.yaw_rate, steer[0]
    base[0, [car.THROTTLE, car.BRAKE]] = stretch.driven[0]
    return _replayed(vehicle, commands, np.zeros(1, dtype=np.int64), base, held=True)


def _replayed(
    vehicle: Vehicle, commands: FloatArray, starts: Any, base: FloatArray, *, held: bool
) -> FloatArray:
    states, work = np.zeros_like(base), np.zeros((3, car.N_MOTION))
    kernel.replay(vehicle.table, commands, starts, base, held, H, states, work)
    return states


def free(
    vehicle: Vehicle,
    stretch: Stretch,
    base: FloatArray,
    starts: Any,
    speeds: FloatArray,
    clock: float = 0.0,
) -> FloatArray:
    """Speeds on the grid (m + 1,) [m/s] if the car drives on its own from each start.

    Args:
        vehicle: the vehicle.
        stretch: with pedals.
        base: states of :func:`lateral`.
        starts: steps (k,) of the grid, int64, at which it starts anew, the first of them 0.
        speeds: at those starts [m/s].
        clock: delay of the steering besides the vehicle's [s].
    """
    if stretch.pedals is None:
        raise ValueError("needs pedals")
    base = base.copy()
    base[starts, car.VX] = speeds
    return np.asarray(replayed(vehicle, stretch, base, starts, clock)[:, car.VX])


def replayed(
    vehicle: Vehicle, stretch: Stretch, base: FloatArray, starts: Any, clock: float = 0.0
) -> FloatArray:
    """States (m + 1, N_STATE) under the recorded commands from ``base`` at each of ``starts``.

    Without pedals the speed is that of ``base`` throughout.
    """
    held = stretch.pedals is None
    pedals = stretch.driven if stretch.pedals is None else stretch.pedals
    base = base.copy()
    base[:-1, [car.THROTTLE, car.BRAKE]] = pedals
    steer = _held(stretch.steer, _grid(len(base)), _whole(vehicle.steer_delay + clock))
    return _replayed(vehicle, np.column_stack([steer, pedals]), starts, base, held=held)


def corrected(log: Log, stretch: Stretch, speed: FloatArray) -> Stretch:
    """The stretch with the commanded pedals, and a model's ``speed`` on the grid, corrected.

    What is left of the measured speed is averaged over a long window and added.
    """
    left = log.signals["v_x"][stretch.rows] - at_rows(stretch, speed)
    grid = _grid(len(speed))
    better = np.maximum(speed + _smoothed(stretch.time, left, grid, _LONG_WINDOW), 0.0)
    pedals = stretch.driven if stretch.pedals is None else stretch.pedals
    return stretch._replace(speed=better, driven=pedals)


def _whole(delay: float) -> float:
    """A delay without the part of a step that is left [s].

    The rest shifts the answer: a jump of the command within a step would act as from the step's
    beginning as long as the rate limits.
    """
    return float(np.floor(delay / H + 1e-9) * H)


def at_rows(stretch: Stretch, values: FloatArray, late: float = 0.0) -> FloatArray:
    """A signal of the grid at the times of the rows, ``late`` [s]."""
    return np.asarray(np.interp(stretch.time - late, _grid(len(values)), values))


_COLUMNS = {
    "yaw_rate": car.YAW_RATE,
    "a_y": car.AY,
    "v_y": car.VY,
    "wheel_angle": car.WHEEL,
    "steer": car.STEER,
}


def responses(
    vehicle: Vehicle,
    stretch: Stretch,
    states: FloatArray,
    names: Sequence[str],
    sensors: Sensors,
) -> FloatArray:
    """What sensors would measure of :func:`lateral` at the rows, (n, channels)."""
    delay = vehicle.steer_delay + sensors.clock
    late = delay - _whole(delay)
    out = []
    for name in names:
        column = states[:, _COLUMNS[name]]
        rate, arm = states[:, car.YAW_RATE], sensors.arms.get(name, 0.0)
        if name == "yaw_rate":
            column = low_pass(column, sensors.yaw_rate_lag, H)
        elif name == "v_y":
            askew = sensors.offsets.get(name, 0.0)
            column = column + arm * rate + askew * (stretch.speed - 1.0)
        elif name == "a_y" and arm != 0.0:
            column = column + arm * np.gradient(rate, H)
        out.append(at_rows(stretch, column, late) + sensors.offsets.get(name, 0.0))
    return np.column_stack(out)
