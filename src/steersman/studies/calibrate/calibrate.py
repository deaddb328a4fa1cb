"""Drive manoeuvres on a plant, fit a vehicle to them by least squares, and write it as a file.

Sources: identification by output error and by least squares, Ljung, *System Identification*,
2nd ed., ch. 7; stiffness from steady turns and inertia from the response to a step of steering,
Rajamani, *Vehicle Dynamics and Control*, 2nd ed., sec. 2.3 and 3.3, here through the whole
four-wheel model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.errors import ConfigError, PlantError
from steersman.paths.analytic import Straight
from steersman.protocols import Plant
from steersman.provenance import provenance
from steersman.studies.calibrate import manoeuvres
from steersman.studies.calibrate.manoeuvres import Manoeuvre, ManoeuvreDriver, Tell, inner_angle
from steersman.studies.calibrate.replayed import Fit, brakes, tyres_and_inertia
from steersman.studies.vehicle_file import write_vehicle
from steersman.types import FloatArray
from steersman.vehicles import Vehicle

# Enough for a throttle run to the top speed [m].
PLANE = 900.0
WIDTH = 160.0
"""Room that the steps of the steering take to both sides together [m]."""
USUAL = {
    "steering rate": 0.05,
    "steering curve": 0.02,
    "throttle map": 0.1,
    "brakes": 0.1,
    "tyres and inertia": 0.01,
}
"""RMS errors, in the units of the fits, beyond which the model does not describe the car."""
# Shares of full lock between which a ramp is a ramp.
_RAMP = (0.02, 0.98)
# An offset of the steering that differs by less is the same [rad].
_ALIGNED = 1e-4
# Largest difference of a pedal that has reached its command [-].
_PEDAL = 1e-3
# Knots of a curve with fewer samples than this keep their values.
_FEWEST = 3


class Calibration(NamedTuple):
    """A vehicle that explains what a plant did."""

    before: Vehicle
    """The plant's vehicle."""
    vehicle: Vehicle
    fits: dict[str, Fit]
    """By what was fitted."""


def calibrate(plant: Plant, tell: Tell) -> Calibration:
    """Drive, and fit; about three minutes of simulated time.

    The figures that are fitted: lock, offset, rates and curve of the steering, throttle map, brake
    force, axle stiffnesses, yaw inertia. All others are those of the plant's vehicle.

    Args:
        plant: anything with a wide straight road; it is left open.
        tell: called with the name of each manoeuvre.

    Raises:
        PlantError: the plant fails.
    """
    plant.enter(Straight(distance=PLANE))
    driver = ManoeuvreDriver(plant, tell)
    rest = manoeuvres.lock_at_rest(driver)
    before: Vehicle = plant.vehicle  # read from the server only now
    fits: dict[str, Fit] = {"steering rate": steering_rates(rest, before)}
    vehicle = _explained(before, fits, "steering rate")
    fits["steering curve"] = steering_curve(rest, manoeuvres.curve_runs(driver, vehicle), vehicle)
    vehicle = _explained(vehicle, fits, "steering curve")
    throttles = manoeuvres.throttle_runs(driver, vehicle)
    fits["throttle map"] = throttle_map(throttles, vehicle)
    vehicle = _explained(vehicle, fits, "throttle map")
    fits["brakes"] = brakes(manoeuvres.brake_runs(driver), vehicle)
    vehicle = _explained(vehicle, fits, "brakes")
    steps = manoeuvres.step_runs(driver, vehicle)
    fits["tyres and inertia"] = tyres_and_inertia(steps, vehicle)
    vehicle = _explained(vehicle, fits, "tyres and inertia")
    return Calibration(before, vehicle, fits)


def _explained(vehicle: Vehicle, fits: dict[str, Fit], name: str) -> Vehicle:
    """The vehicle with the figures of a fit.

    Raises:
        PlantError: such figures are not allowed for a vehicle.
    """
    try:
        return vehicle.replace(**fits[name].figures)
    except ConfigError as error:
        raise PlantError(
            f"calibrate: {name}: the fitted figures are not allowed: {error}"
        ) from None


def write(found: Calibration, file: FilePath, source: str) -> None:
    """Write the vehicle as a file that ``vehicle=file vehicle.file=...`` reads.

    Raises:
        DataError: it cannot be written.
    """
    head = [f"Calibrated on {source}, commit {provenance()['commit']}. What the fits leave:"]
    head += [f"  {name}: {fit.error:.3g} {fit.unit}" for name, fit in found.fits.items()]
    write_vehicle(found.vehicle, file, head)


def steering_rates(run: Manoeuvre, vehicle: Vehicle) -> Fit:
    """Full lock and offset [rad], and the rates to lock and back [1/s], from full lock at rest.

    Raises:
        PlantError: the wheels did not move.
    """
    angles = np.array([inner_angle(vehicle, s.wheel_angle) for s in run.states])
    lock = float(np.max(angles))
    if lock < 0.05:  # noqa: PLR2004 - [rad]
        raise PlantError("calibrate: the wheels do not turn at standstill; is the car alive?")
    offset = float(angles[-1])  # by then the wheels stand where the command 0 has them
    if abs(offset - vehicle.steer_bias) < _ALIGNED:
        offset = vehicle.steer_bias
    lock -= offset
    share = (angles - offset) / lock
    half = len(share) // 2
    up, up_error = _slope(share[: half + 1], run.dt)
    down, down_error = _slope(share[half:], run.dt)
    figures = {"max_wheel_angle": lock, "steer_rate_up": up, "steer_rate_down": -down}
    figures["steer_bias"] = offset
    return Fit(figures, max(up_error, down_error), "-")


def _slope(share: FloatArray, dt: float) -> tuple[float, float]:
    """Slope of the ramp within a signal [1/s], and the RMS error of the line."""
    inside = (share > _RAMP[0]) & (share < _RAMP[1])
    rows = np.flatnonzero(inside)
    if rows.size == 0:
        # Faster than a control period: at least so fast.
        return float(np.sign(share[-1] - share[0])) / dt, 0.0
    if rows.size == 1:
        # The ramp began with the command, a control period before.
        return float(share[rows[0]] - share[max(rows[0] - 1, 0)]) / dt, 0.0
    times = dt * rows
    line = np.polyfit(times, share[inside], 1)
    return float(line[0]), float(np.sqrt(np.mean((np.polyval(line, times) - share[inside]) ** 2)))


def steering_curve(rest: Manoeuvre, runs: Sequence[Manoeuvre], vehicle: Vehicle) -> Fit:
    """Shares of the full wheel angle at the speeds of the vehicle's curve.

    Of each run the samples in which the steering has reached its command; at rest the
    factor is 1 by definition.
    """
    lock = vehicle.max_wheel_angle
    speeds, factors = [0.0] * _FEWEST, [1.0] * _FEWEST
    for run in runs:
        held = _held(run, vehicle)
        for k in held:
            angle = inner_angle(vehicle, run.states[k].wheel_angle)
            speeds.append(abs(run.states[k].v_x))
            factors.append(angle / (run.commands[k - 1].steer * lock + vehicle.steer_bias))
    values, error = _piecewise(
        np.array(vehicle.steer_curve_speed),
        np.array(speeds),
        np.array(factors),
        np.array(vehicle.steer_curve_factor),
    )
    return Fit({"steer_curve_factor": tuple(values.tolist())}, error, "-")


def _held(run: Manoeuvre, vehicle: Vehicle) -> list[int]:
    """Indices of the states that the same steering was held for, long enough to be reached."""
    found, since = [], 0
    for k, command in enumerate(run.commands):
        if k and command.steer != run.commands[k - 1].steer:
            since = k
        needed = abs(command.steer) / vehicle.steer_rate_up + 2.0 * run.dt
        if command.steer != 0.0 and (k + 1 - since) * run.dt > needed:
            found.append(k + 1)
    return found


def throttle_map(runs: Mapping[float, Sequence[Manoeuvre]], vehicle: Vehicle) -> Fit:
    """Net accelerations on a straight at the throttles and speeds of the vehicle's map [m/s^2]."""
    speeds = np.array(vehicle.map_speed)
    rows, errors = [], []
    for throttle, known in zip(vehicle.map_throttle, vehicle.map_acceleration, strict=True):
        v, a = [], []
        for run in runs[throttle]:
            for one, other in zip(run.states, run.states[1:], strict=False):
                if abs(one.throttle - throttle) < _PEDAL:
                    v.append(0.5 * (one.v_x + other.v_x))
                    a.append((other.v_x - one.v_x) / run.dt)
        values, error = _piecewise(speeds, np.array(v), np.array(a), np.array(known))
        rows.append(tuple(values.tolist()))
        errors.append(error)
    figures = {"map_acceleration": tuple(rows), "map_mass": None, "map_drag_area": None}
    return Fit(figures, float(np.sqrt(np.mean(np.square(errors)))), "m/s^2")


def _piecewise(
    knots: FloatArray, x: FloatArray, y: FloatArray, known: FloatArray
) -> tuple[FloatArray, float]:
    """Values at the knots of the piecewise linear curve through samples, and its RMS error.

    Knots beside which there are too few samples keep the values that are known, and so does the
    end of a curve that the samples do not reach: it is no matter of extrapolation.
    """
    inside = (x >= knots[0]) & (x <= knots[-1])
    x, y = x[inside], y[inside]
    hats = np.array([np.interp(x, knots, row) for row in np.eye(len(knots))]).T
    seen_knots = (hats > 0.3).sum(axis=0) >= _FEWEST  # noqa: PLR2004 - nearer than other knots, about
    if not seen_knots.any():
        return known, 0.0
    rest = y - hats[:, ~seen_knots] @ known[~seen_knots]
    # Samples between a knot with data and one without say nothing of either.
    clean = hats[:, ~seen_knots].sum(axis=1) < 1e-9  # noqa: PLR2004
    values = known.copy()
    values[seen_knots] = np.linalg.lstsq(hats[clean][:, seen_knots], rest[clean], rcond=None)[0]
    left = hats[clean] @ values - y[clean]
    return values, float(np.sqrt(np.mean(left**2)))
