"""Drive a vehicle with a controller along a path, and record the Episode."""

from __future__ import annotations

from collections.abc import Callable
from tempfile import SpooledTemporaryFile
from typing import Annotated

import numpy as np
from pydantic import field_validator, model_validator

from steersman import episode as ending
from steersman.config import Of, Settings, param
from steersman.controllers.base import ControllerComponent, designed, timed_step, warm_up
from steersman.controllers.estimated import in_front
from steersman.controllers.mpc_pid import MpcPid
from steersman.disturbances import DisturbanceComponent
from steersman.episode import Episode
from steersman.episode_rows import N_MORE, columns_of
from steersman.errors import ConfigError, ControllerError, PlantError
from steersman.estimators.base import EstimatorComponent, PredictorComponent
from steersman.faults import Fault
from steersman.kernels.world import (
    CLOCK_DISTANCE,
    GOAL_REACHED,
    RUNNING,
    TIME_UP,
    find_end,
)
from steersman.lead import Lead
from steersman.naming import names_of
from steersman.outcome import ENDS, OUTCOMES, Attempt, Interrupted, PlantFailure, RunError
from steersman.paths.base import PathComponent, Start
from steersman.plants.base import PlantComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.profiles import stack_profiles
from steersman.provenance import provenance
from steersman.run_length import goal
from steersman.sensing import WaypointSensor
from steersman.speed import ConstantThrottle, SpeedComponent
from steersman.types import Decision, FloatArray
from steersman.vehicles import CarlaModel3, Vehicle
from steersman.world import Simulation

# Bytes of a drive's record that are kept in memory (a longer one waits in a temporary file), and
# steps of it that are read at once.
IN_MEMORY, BLOCK = 8_000_000, 10_000
_Progress = Callable[[float], None] | None
_Ended = tuple[str, ControllerError | PlantError | None]


class RunConfig(Settings):
    """One closed loop: controller, vehicle, path, speed and length of the run."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        MpcPid(), "-", "Lateral controller."
    )
    estimator: Annotated[EstimatorComponent | None, Of("estimator", optional=True)] = param(
        None, "-", "State estimator in front of the controller; null: none."
    )
    predictor: Annotated[PredictorComponent | None, Of("predictor", optional=True)] = param(
        None, "-", "Predictor in front of the controller, for delays; null: none."
    )
    path: Annotated[PathComponent, Of("path")] = param("circle", "-", "Path to follow.")
    speed: Annotated[SpeedComponent, Of("speed")] = param(
        ConstantThrottle(), "-", "Source of throttle and brake."
    )
    vehicle: Annotated[Vehicle, Of("vehicle")] = param(CarlaModel3(), "-", "Vehicle.")
    nominal: Annotated[Vehicle | None, Of("vehicle", optional=True)] = param(
        None, "-", "Nominal vehicle, which the controller computes with; null: the true one."
    )
    plant: Annotated[PlantComponent, Of("plant")] = param(SimulatorConfig(), "-", "Plant.")
    sensor: Annotated[WaypointSensor, Of("sensor")] = param(WaypointSensor(), "-", "Sensor.")
    lead: Lead | None = param(None, "-", "A car ahead in the own lane; null: none.")
    fault: Fault | None = param(None, "-", "What breaks on the way; null: nothing.")
    disturbances: tuple[Annotated[DisturbanceComponent, Of("disturbance")], ...] = param(
        (), "-", "Further disturbances."
    )
    duration: float | None = param(
        None,
        "s",
        "Length of the run; null with laps null: 60 s, or to the end of an open path.",
        gt=0,
    )
    laps: float | None = param(None, "-", "Laps of a closed path, instead of a duration.", gt=0)
    corridor: float = param(1.5, "m", "Half width of the corridor; leaving it ends the run.", gt=0)
    start: Start = param(Start(), "-", "Where the run starts; a number is the arc length [m].")
    seed: int = param(0, "-", "Seed of everything random.", ge=0)

    @field_validator("start", mode="before")
    @classmethod
    def _arc_length(cls, value: object) -> object:
        return {"s": value} if isinstance(value, float | int) else value

    @model_validator(mode="after")
    def _beside(self) -> RunConfig:
        if abs(self.start.offset) >= self.corridor:
            raise ConfigError(
                f"{self.start.offset:g} is not allowed; the corridor's half width is "
                f"{self.corridor:g} [m]",
                ("start", "offset"),
            )
        return self

    @model_validator(mode="after")
    def _length(self) -> RunConfig:
        if self.duration is not None and self.laps is not None:
            raise ConfigError("give laps or duration, not both", ("laps",))
        return self


def run(config: RunConfig, progress: _Progress = None) -> Episode:
    """Drive one configuration and return its record, with the configuration inside.

    Args:
        config: what to drive.
        progress: called now and then with the share of the run that is done.

    Raises:
        RunError: the controller failed; the error carries the episode so far.
        PlantFailure: the plant failed in mid-run; so does this one.
        PlantError: the plant cannot be reached.
        ConfigError: the configuration's parts do not fit together.
        Interrupted: Ctrl-C; it carries the episode so far.
    """
    tried = attempt(config, progress)
    if tried.error is not None:
        raise tried.error
    return tried.episode


def attempt(config: RunConfig, progress: _Progress = None) -> Attempt:
    """Drive one configuration and return what came of it, failures included.

    Args:
        config: what to drive.
        progress: called now and then with the share of the run that is done.

    Raises:
        PlantError: the plant cannot be reached.
        ConfigError: the configuration's parts do not fit together.
        Interrupted: Ctrl-C; it carries the episode so far and is a ``KeyboardInterrupt``.
    """
    drive = RunningDrive(config)
    try:
        end, error = drive.run(progress)
    except KeyboardInterrupt:
        raise Interrupted(drive.episode(ending.INTERRUPTED)) from None
    finally:
        drive.simulation.close()
    episode = drive.episode(end)
    if isinstance(error, PlantError):
        return Attempt("plant_failed", episode, PlantFailure(str(error), episode))
    if error is not None:
        failed = RunError(str(error), episode)
        failed.__cause__ = error.__cause__
        return Attempt("controller_failed", episode, failed)
    return Attempt(OUTCOMES.get(end, "finished"), episode)


class RunningDrive:
    """A fleet of one, its controller, and the record of what they do."""

    def __init__(self, config: RunConfig) -> None:
        """Put the vehicle at its start.

        Raises:
            PlantError: the plant cannot be reached or made ready.
            ConfigError: the path has no laps, or ends before the start.
        """
        self.config, path = config, config.path
        self.goal, self.limit = goal(path, config.start.s, config.duration, config.laps)
        profile = config.speed.profile()
        lead = config.lead.start() if config.lead else None
        more = () if config.fault is None else (config.fault,)
        disturbances = [one.make(1, config.seed) for one in (*config.disturbances, *more)]
        self.simulation = simulation = Simulation(
            config.plant,
            config.vehicle,
            config.sensor,
            (path,),
            stack_profiles([profile], [path]),
            corridor=config.corridor,
            disturbances=disturbances,
            seed=config.seed,
            fine=isinstance(config.plant, SimulatorConfig) and config.plant.record,
            wishes=True,
            lead=len(lead.times) if lead else 0,
        )
        try:
            start = config.start
            speed = config.speed.start_speed(path, start.s)
            simulation.begin(0, 0, start.s, start.pose(path), speed, profile, lead)
            simulation.limit(0, self.limit, self.goal)
        except BaseException:
            simulation.close()
            raise

    def run(self, progress: _Progress) -> _Ended:
        """Drive to the end; returns how it ended, and what failed."""
        with SpooledTemporaryFile(max_size=IN_MEMORY) as self._record:
            try:
                return self._run(progress)
            finally:
                self._columns, self._fine = self._read()

    def _run(self, progress: _Progress) -> _Ended:
        simulation, fleet = self.simulation, self.simulation.fleet
        controller = self.config.controller
        if self.config.fault is not None:
            controller = self.config.fault.within(controller)
        controller = in_front(controller, self.config.estimator, self.config.predictor)
        # Only now, since a server knows of its vehicle when it is there.
        nominal = self.config.nominal or simulation.mover.vehicle
        memory = designed(controller, nominal, simulation.dt)
        find_end(simulation.world, fleet, 0)
        if fleet.ended[0] == RUNNING:
            simulation.look(0)
            fresh = designed(controller, nominal, simulation.dt)
            warm_up(controller, fresh, simulation.observation(0))
        while fleet.ended[0] == RUNNING:
            time = simulation.time(0)
            observation = simulation.observation(0)
            try:
                decision, memory, took = timed_step(controller, memory, observation)
            except ControllerError as error:
                failed = ControllerError(f"{error}, at t = {time:.2f} s")
                failed.__cause__ = error.__cause__
                return ending.ERROR, failed
            fleet.speed_limit[0] = decision.speed_limit
            row = np.concatenate((fleet.state[0], fleet.tracking[0], fleet.lead[0]))
            try:
                simulation.step(np.array([decision.steer]))
            except PlantError as error:
                self._add(row, time, decision, took)
                return ending.ERROR, PlantError(f"{error}, at t = {time:.2f} s")
            self._add(row, time, decision, took)
            steps = round(simulation.time(0) / simulation.dt)
            if progress is not None and steps % 100 == 0:
                share = max(self.distance / self.goal, simulation.time(0) / self.limit)
                progress(min(share, 1.0))
        return self._end(int(fleet.ended[0])), None

    @property
    def distance(self) -> float:
        """Distance driven along the path [m]."""
        return float(self.simulation.fleet.clock[0, CLOCK_DISTANCE])

    def _add(self, row: FloatArray, time: float, decision: Decision, took: float) -> None:
        fleet = self.simulation.fleet
        how = took, float(decision.status), float(decision.driver), float(decision.reason)
        more = (time, fleet.sent[0], *fleet.command[0, 1:3], *how)
        self._record.write(np.concatenate((row, more, fleet.fine[0].ravel())).tobytes())

    def _end(self, code: int) -> str:
        """Name of the kernel's reason."""
        if code == GOAL_REACHED and self.config.path.closed:
            return ending.LAPS
        if code == TIME_UP:
            planned = self.config.laps is None and (self.config.duration or self.config.path.closed)
            return ending.DURATION if planned else ending.TIMEOUT
        return ENDS[code]

    def episode(self, end: str) -> Episode:
        """The record, with the configuration inside."""
        config, path, mover = self.config, self.config.path, self.simulation.mover
        shared = mover.shared
        fine = self._fine if shared is None else shared.plant.accelerations()
        source = config.plant.source() if shared is None else shared.plant.source
        made = {"seed": config.seed, "plant": source}
        driven = {"config": config.model_dump(mode="json"), "names": names_of(config)}
        meta = {**driven, **made, **provenance()}
        length, dt = path.length, self.simulation.dt
        return Episode(self._columns, end, self.distance, dt, length, path.closed, meta, fine)

    def _read(self) -> tuple[dict[str, FloatArray], FloatArray]:
        """The columns, and the accelerations of the integration steps (k, 2)."""
        fleet = self.simulation.fleet
        state, lead = fleet.state[0].size + fleet.tracking[0].size, fleet.lead[0].size
        width = state + lead + N_MORE + fleet.fine[0].size
        table, done = np.empty((width, self._record.tell() // (8 * width))), 0
        self._record.seek(0)
        while block := self._record.read(8 * width * BLOCK):
            rows = np.frombuffer(block).reshape(-1, width)
            table[:, done : done + len(rows)] = rows.T
            done += len(rows)
        rows, ahead, more, fine = np.split(table, np.cumsum([state, lead, N_MORE]))
        return columns_of(rows.T, more.T, ahead.T), fine.T.reshape(-1, 2)
