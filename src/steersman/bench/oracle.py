"""What the best steering would cost that knows car, delay, road and future: the oracle.

For each scenario the steering of the whole drive is optimised on the true plant
(:mod:`steersman.kernels.optimal`), from the drive of a controller that knows the true car. It is a
local optimum: a drive that costs less may exist, one that costs less than the truth does not. The
cost is that of the tunings (:mod:`steersman.studies.objective`): the RMS lateral error plus a price
on the RMS steering rate. Without a price the best error within grip would be almost nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from steersman.bench.drive import digest
from steersman.bench.suite import Scenario
from steersman.controllers.base import ControllerComponent
from steersman.disturbances import FrictionPatch
from steersman.episode import Episode
from steersman.kernels import observe as obs
from steersman.kernels import optimal as kernel
from steersman.kernels import vehicle as car
from steersman.plants.simulator import SimulatorConfig
from steersman.plants.wind import Gusts
from steersman.rollout import RunConfig, RunningDrive, attempt
from steersman.sensing import WaypointSensor
from steersman.stored import SourcedResult
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

PRICE = 0.05
"""Of the RMS steering rate, in lateral error [m s]."""

_DIGITS = 12
_ROUNDS, _ENOUGH, _FIRMEST, _SOFTER, _MORE = 40, 1e-4, 1e6, 0.03, 40
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)
_LEAST_ERROR, _LEAST_CHANGE = 1e-5, 1e-6


class OracleCost(NamedTuple):
    """The oracle's drive."""

    rms_error: float
    """RMS lateral error [m]."""
    steer_change: float
    """RMS change of the command in a control step [-]."""

    def total(self, dt: float) -> float:
        """Its cost at a control period ``dt`` [s], see :func:`cost` [m]."""
        return cost(self.rms_error, self.steer_change, dt)


def cost(rms_error: float, steer_change: float, dt: float) -> float:
    """The cost of a drive [m]: its charged RMS error [m] and the price of its steering.

    >>> round(cost(0.01, 0.002, 0.05), 6)
    0.012
    """
    return rms_error + PRICE * steer_change / dt


class OracleCosts(SourcedResult):
    """The content of ``oracle.json``."""

    start: str
    """The controller from whose drives the optimisation started."""
    costs: dict[str, OracleCost | None]
    """By the beginning of the scenario's digest; None: no drive was found on the road."""


@cache
def stored() -> OracleCosts:
    """The costs that come with the package."""
    text = files("steersman.data").joinpath("oracle.json").read_text(encoding="utf-8")
    return OracleCosts.model_validate_json(text)


def known(scenarios: Iterable[Scenario]) -> dict[str, OracleCost]:
    """The oracle's costs of these scenarios by their names; those without are left out.

    They are found by all that a scenario is: costs of another suite's or car's are not taken.
    """
    found = {each.name: stored().costs.get(short(each)) for each in scenarios}
    return {name: one for name, one in found.items() if one is not None}


def short(scenario: Scenario) -> str:
    """The beginning of the digest of a scenario."""
    return digest(scenario)[:_DIGITS]


def oracle(scenario: Scenario, start: ControllerComponent) -> OracleCost | None:
    """The oracle's drive of a scenario; None if it leaves the road or rolls over.

    Args:
        scenario: what is driven, in the embedded simulator.
        start: the controller from whose drive the optimisation starts; it knows the true car.
    """
    return searched(scenario.run, start).result()


def searched(run: RunConfig, start: ControllerComponent) -> DriveSearch:
    """The optimisation of a drive, to be begun.

    Args:
        run: what is driven, in the embedded simulator.
        start: the controller from whose drive the optimisation starts; it knows the true car.
    """
    plant = run.plant
    assert isinstance(plant, SimulatorConfig)
    held, late = divmod(plant.delay_of(run.vehicle), plant.substeps())
    exact: dict[str, Any] = {
        "controller": start,
        "estimator": None,
        "predictor": None,
        "sensor": WaypointSensor(),
        "nominal": None,
        "disturbances": tuple(d for d in run.disturbances if d.make(1, 0).on_vehicle),
        "plant": plant.model_copy(update={"steering_delay": late * plant.h}),
        "vehicle": run.vehicle.replace(steer_delay=0.0),
    }
    return DriveSearch(run.model_copy(update=exact), held, late)


class Played(ControllerComponent):
    """Sends commands that are given before the drive, one in each control period."""

    commands: tuple[float, ...]
    """Normalised steering; the last is held."""

    def init(self, vehicle: Vehicle, dt: float) -> int:
        """The number of commands sent."""
        return 0

    def decide(self, state: int, observation: Observation) -> tuple[float, Status, int]:
        """The next command."""
        return self.commands[min(state, len(self.commands) - 1)], Status.SOLVED, state + 1


class DriveSearch:
    """The optimisation of one drive: exact sensors, and a delay below one control period."""

    def __init__(self, run: RunConfig, held: int, late: int) -> None:
        """Drive with the run's controller.

        Args:
            run: the drive.
            held: whole control periods before the first command acts.
            late: integration steps beyond them.
        """
        self.held, self._run, self._late = held, run, late
        self.first = attempt(run).of_controller()
        """The controller's drive, without whole periods of delay."""
        steering = self.first["steer_command"]
        self._simulation = RunningDrive(run).simulation
        self._start = {
            name: values.copy()
            for name, values in self._simulation.arrays().items()
            if isinstance(values, np.ndarray)
        }
        steps = len(steering) + _MORE
        self._air = _air(run, steps)
        self._plan = kernel.SteerPlan(np.zeros(steps), np.zeros((steps, kernel.N_SEEN)))
        self._work = kernel.make_sweep()
        self._trails = kernel.empty_trail(steps), kernel.empty_trail(steps)
        old = self._trails[0].command[:, 0]
        old[: len(steering)], old[len(steering) :] = steering, steering[-1]
        self._idle = float(self._simulation.fleet.state[0, car.STEER])

    def replayed(self) -> FloatArray:
        """Lateral errors [m] of the kernel's drive with the controller's steering."""
        steps, _ = self._drive(0.0)
        errors: FloatArray = self._trails[1].tracking[:steps, obs.D].copy()
        return errors

    def episode(self) -> Episode:
        """The drive with the cheapest steering found so far, without whole periods of delay."""
        commands = tuple(self._trails[0].command[self.held :, 0].tolist())
        played = self._run.model_copy(update={"controller": Played(commands=commands)})
        return attempt(played).of_controller()

    def _drive(self, share: float) -> tuple[int, OracleCost]:
        """Drive from the first trail's steering to the second trail."""
        simulation = self._simulation
        for name, values in simulation.arrays().items():
            if name in self._start:
                values[:] = self._start[name]
        old, new = self._trails
        # Nothing steers before the first command arrives.
        old.command[: self.held, 0] = self._idle
        world, fleet = simulation.world, simulation.fleet
        steps = kernel.drive(world, fleet, self._air, self.held, old, self._plan, share, new)
        errors = new.tracking[:steps, obs.D]
        sent = new.command[self.held : steps, 0]
        change = np.append(np.diff(sent), np.zeros(min(self.held, steps - 1)))
        rms = math.sqrt(float(np.mean(errors**2)))
        activity = float(np.sqrt(np.mean(change**2))) if change.size else 0.0
        return steps, OracleCost(rms, activity)

    def result(self) -> OracleCost | None:
        """The cheapest drive that is found."""
        dt = self._simulation.dt
        steps, best = self._drive(0.0)
        self._trails = self._trails[::-1]
        firm = 0.0
        for _ in range(_ROUNDS):
            error = max(best.rms_error, _LEAST_ERROR)
            change = max(best.steer_change, _LEAST_CHANGE)
            prices = 1.0 / (error * steps), PRICE / dt / (change * steps)
            kernel.sweep(
                self._simulation.world,
                self._trails[0],
                (self.held, steps),
                self._late,
                prices,
                firm * prices[1],
                self._work,
                self._plan,
            )
            before = best.total(dt)
            for share in _SHARES:
                count, found = self._drive(share)
                if found.total(dt) < best.total(dt):
                    steps, best = count, found
                    self._trails = self._trails[::-1]
                    break
            else:
                firm = 10.0 * max(firm, 0.1)
                if firm > _FIRMEST:
                    break
                continue
            firm *= _SOFTER
            if before - best.total(dt) < _ENOUGH * before:
                break
        trail, row = self._trails[0], self._simulation.world.vehicles.rows[0]
        lost = np.abs(trail.tracking[: steps + 1, obs.D]).max() > self._run.corridor
        rolled = any(car.rolls_over(row, load) for load in trail.state[: steps + 1, car.LOAD_AY])
        return None if lost or rolled else best


def _air(run: RunConfig, steps: int) -> kernel.Air:
    """Wind and patches of a run."""
    assert isinstance(run.plant, SimulatorConfig)
    wind, gusts = run.plant.wind, run.plant.wind.make(1, run.seed)
    blows = np.zeros(0)
    if isinstance(gusts, Gusts):
        gusts.restart(0)
        blows = np.array([gusts.at(0, k * run.plant.dt) for k in range(steps)])
    rows = [
        (d.begin, d.length, d.every or 0.0, d.left, d.right)
        for d in run.disturbances
        if isinstance(d, FrictionPatch)
    ]
    patches = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return kernel.Air(blows, *wind.figures(), patches)
