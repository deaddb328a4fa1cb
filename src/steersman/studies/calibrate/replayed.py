"""Fits by replaying: the figures with which the embedded simulator does what the plant did."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from steersman.plants.simulator import SimulatorConfig
from steersman.studies.calibrate.manoeuvres import Manoeuvre
from steersman.types import Command, FloatArray
from steersman.vehicles import Vehicle

# What weighs as much as each other in the response: yaw rate [rad/s] and side velocity [m/s].
_SCALES = np.array([0.02, 0.05])
_SPEED_SCALE = 0.1  # [m/s]
# Figures are looked for within these factors, and the brakes from at least so much on [m/s^2].
_FACTORS = (0.1, 10.0)
_LEAST_BRAKE = 1.0


class Fit(NamedTuple):
    """Figures of the vehicle, and the RMS error that they leave, in ``unit``."""

    figures: dict[str, Any]
    error: float
    unit: str


def tyres_and_inertia(runs: Sequence[Manoeuvre], vehicle: Vehicle) -> Fit:
    """Axle stiffnesses [N/rad] and yaw inertia [kg m^2] that reproduce steps of the steering.

    The same commands are driven on the embedded simulator; yaw rate and side velocity are to
    agree. The steady part of a step determines the stiffnesses, its beginning and end the inertia.
    """
    start = {name: getattr(vehicle, name) for name in ("c_f", "c_r", "yaw_inertia")}
    figures, left = _fitted(runs, vehicle, start, _response, _SCALES)
    return Fit(figures, float(np.sqrt(np.mean(left[:, 0] ** 2))), "rad/s")


def brakes(runs: Sequence[Manoeuvre], vehicle: Vehicle) -> Fit:
    """Brake force of all wheels [N] that reproduces how the car comes to a stop.

    What the tyres can carry, the shares of the axles and the pedals' rates are the vehicle's.
    """
    start = {"brake_force": max(vehicle.brake_force, _LEAST_BRAKE * vehicle.mass)}
    figures, left = _fitted(runs, vehicle, start, _speed, np.array([_SPEED_SCALE]))
    return Fit(figures, float(np.sqrt(np.mean(left**2))), "m/s")


def _fitted(
    runs: Sequence[Manoeuvre],
    vehicle: Vehicle,
    start: Mapping[str, float],
    response: Callable[[Sequence[Any]], FloatArray],
    scales: FloatArray,
) -> tuple[dict[str, float], FloatArray]:
    """Figures whose replays respond as the runs do, and what is left of the responses, (n, k).

    ``start`` are the figures to begin with, above 0; ``scales``, k of them, weigh as much as each
    other in the responses.
    """
    from scipy.optimize import least_squares

    first = np.array(list(start.values()))
    seen = [response(run.states) for run in runs]

    def of(logs: FloatArray) -> dict[str, float]:
        return dict(zip(start, (first * np.exp(logs)).tolist(), strict=True))

    def misses(logs: FloatArray) -> FloatArray:
        guess = vehicle.replace(**of(logs))
        parts = [
            (response(replay(run, guess)) - found) / scales
            for run, found in zip(runs, seen, strict=True)
        ]
        return np.concatenate([part.ravel() for part in parts])

    bounds = tuple(np.full(len(first), np.log(f)) for f in _FACTORS)
    nothing = np.zeros(len(first))
    found = least_squares(misses, nothing, bounds=bounds, x_scale=0.1, diff_step=1e-4)
    return of(found.x), misses(found.x).reshape(-1, len(scales)) * scales


def replay(run: Manoeuvre, vehicle: Vehicle) -> list[Any]:
    """The states that the embedded simulator goes through from the same start."""
    plant = SimulatorConfig(dt=run.dt).make(vehicle)
    first = run.states[0]
    plant.resume(first)
    return [first, *(plant.step(Command(*command)) for command in run.commands)]


def _response(states: Sequence[Any]) -> FloatArray:
    """Yaw rate and side velocity, (n, 2)."""
    return np.array([[s.yaw_rate, s.v_y] for s in states])


def _speed(states: Sequence[Any]) -> FloatArray:
    """Forward velocity, (n, 1)."""
    return np.array([[s.v_x] for s in states])
