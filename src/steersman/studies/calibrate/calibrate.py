"""Drive the manoeuvres on a plant, fit a vehicle to them, and write it as a file."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import NamedTuple

from pydantic import ValidationError

from steersman.errors import PlantError
from steersman.messages import config_error
from steersman.paths.analytic import Straight
from steersman.protocols import Plant
from steersman.provenance import provenance
from steersman.studies.calibrate import identify, manoeuvres
from steersman.studies.calibrate.identify import Fit
from steersman.studies.calibrate.manoeuvres import ManoeuvreDriver, Tell
from steersman.studies.vehicle_file import write_vehicle
from steersman.vehicles import Vehicle

# Enough for a throttle run to the top speed [m].
PLANE = 900.0
WIDTH = 160.0
"""Room that the steps of the steering take to both sides together [m]."""
USUAL = {
    "steering rate": 0.05,
    "steering curve": 0.02,
    "throttle map": 0.1,
    "tyres and inertia": 0.01,
}
"""RMS errors, in the units of the fits, beyond which the model does not describe the car."""


class Calibration(NamedTuple):
    """A vehicle that explains what a plant did."""

    before: Vehicle
    """What was known of it."""
    vehicle: Vehicle
    fits: dict[str, Fit]
    """By what was fitted."""


def calibrate(plant: Plant, tell: Tell) -> Calibration:
    """Drive, and fit; about three minutes of simulated time.

    The figures that are fitted: lock, offset, rates and curve of the steering, throttle map, axle
    stiffnesses, yaw inertia. All others are what the plant knows of its vehicle.

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
    fits: dict[str, Fit] = {"steering rate": identify.steering_rates(rest, before)}
    vehicle = _explained(before, fits, "steering rate")
    fits["steering curve"] = identify.steering_curve(
        rest, manoeuvres.curve_runs(driver, vehicle), vehicle
    )
    vehicle = _explained(vehicle, fits, "steering curve")
    throttles = manoeuvres.throttle_runs(driver, vehicle)
    fits["throttle map"] = identify.throttle_map(throttles, vehicle)
    vehicle = _explained(vehicle, fits, "throttle map")
    steps = manoeuvres.step_runs(driver, vehicle)
    fits["tyres and inertia"] = identify.tyres_and_inertia(steps, vehicle)
    vehicle = _explained(vehicle, fits, "tyres and inertia")
    return Calibration(before, vehicle, fits)


def _explained(vehicle: Vehicle, fits: dict[str, Fit], name: str) -> Vehicle:
    """The vehicle with the figures of a fit.

    Raises:
        PlantError: no car of ours has such figures.
    """
    try:
        return vehicle.replace(**fits[name].figures)
    except ValidationError as error:
        why = config_error(type(vehicle), error)
        raise PlantError(f"calibrate: {name}: the fit is no car's: {why}") from None


def write(found: Calibration, file: FilePath, source: str) -> None:
    """Write the vehicle as a file that ``vehicle=file vehicle.file=...`` reads.

    Raises:
        DataError: it cannot be written.
    """
    head = [f"Calibrated on {source}, commit {provenance()['commit']}. What the fits leave:"]
    head += [f"  {name}: {fit.error:.3g} {fit.unit}" for name, fit in found.fits.items()]
    write_vehicle(found.vehicle, file, head)
