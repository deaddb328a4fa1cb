"""The one verb: drive a plant with a controller along a path, and record the Episode."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import model_validator

from steersman import episode as ending
from steersman.config import Of, Settings, param
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_pid import MpcPid
from steersman.episode import COLUMNS, Episode
from steersman.errors import ConfigError, ControllerError, PlantError, one_line
from steersman.paths.base import PathComponent
from steersman.plants.base import PlantComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.protocols import Plant
from steersman.provenance import provenance
from steersman.sensing import Tracking, WaypointSensor, track
from steersman.speed import ConstantThrottle, SpeedComponent
from steersman.types import Command, Decision, Observation, Pose, VehicleState
from steersman.vehicles import CarlaModel3, Vehicle

# A run that is to end after laps or at the end of the road may take at most this long [s].
LONGEST = 7200.0
# Steps without effect before the first: a disturbance estimate needs one before it computes.
_WARM_UPS = 3


class RunConfig(Settings):
    """One closed loop: who drives what, where, how fast and for how long."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        MpcPid(), "-", "Lateral controller."
    )
    path: Annotated[PathComponent, Of("path")] = param("circle", "-", "Path to follow.")
    speed: Annotated[SpeedComponent, Of("speed")] = param(
        ConstantThrottle(), "-", "Source of throttle and brake."
    )
    vehicle: Annotated[Vehicle, Of("vehicle")] = param(CarlaModel3(), "-", "Vehicle.")
    nominal: Annotated[Vehicle | None, Of("vehicle", optional=True)] = param(
        None, "-", "Vehicle that the controller believes it steers; null: the true one."
    )
    plant: Annotated[PlantComponent, Of("plant")] = param(SimulatorConfig(), "-", "Plant.")
    sensor: Annotated[WaypointSensor, Of("sensor")] = param(WaypointSensor(), "-", "Sensor.")
    duration: float | None = param(
        None,
        "s",
        "Length of the run; null with laps null: 60 s, or to the end of an open path.",
        gt=0,
    )
    laps: float | None = param(None, "-", "Laps of a closed path, instead of a duration.", gt=0)
    corridor: float = param(1.5, "m", "Half width of the corridor; leaving it ends the run.", gt=0)
    start: float = param(0.0, "m", "Arc length at which the run starts.", ge=0)
    seed: int = param(0, "-", "Seed of everything random.", ge=0)

    @model_validator(mode="after")
    def _length(self) -> RunConfig:
        if self.duration is not None and self.laps is not None:
            raise ConfigError("give laps or duration, not both", ("laps",))
        return self


@dataclass
class _Recorder:
    """Collects the rows of an episode."""

    rows: list[tuple[float, ...]]

    def add(
        self, state: VehicleState, place: Tracking, decision: Decision, pedals: Any, took: float
    ) -> None:
        s = state
        self.rows.append(
            (
                *(s.time, s.x, s.y, s.psi, s.v_x, s.v_y, s.yaw_rate, s.a_x, s.a_y),
                *place,
                *(decision.steer, s.steer, s.wheel_angle, *pedals),
                *(float(decision.status), took),
                *(float(decision.driver), float(decision.reason)),
            )
        )

    def episode(self, end: str, distance: float, plant: Plant, path: PathComponent) -> Episode:
        data = np.array(self.rows, dtype=np.float64).reshape(-1, len(COLUMNS))
        columns = {name: np.ascontiguousarray(data[:, i]) for i, name in enumerate(COLUMNS)}
        fine = plant.accelerations()
        return Episode(columns, end, distance, plant.dt, path.length, path.closed, fine=fine)


Outcome: TypeAlias = Literal[
    "finished", "left_road", "rolled_over", "timed_out", "controller_failed", "plant_failed"
]
_OUTCOMES: dict[str, Outcome] = {
    ending.OFF_TRACK: "left_road",
    ending.ROLL_OVER: "rolled_over",
    ending.TIMEOUT: "timed_out",
}


@dataclass(frozen=True)
class Attempt:
    """What came of a run.

    Attributes:
        outcome: how the run ended; ``"finished"`` is its planned end.
        episode: what was driven; until the failure, where something failed.
        error: what failed: a ``RunError`` or a ``PlantFailure``; None where nothing did.
    """

    outcome: Outcome
    episode: Episode
    error: RunError | PlantFailure | None = None

    def of_controller(self) -> Episode:
        """The episode as a result of the controller, whose failure is one; a plant's is not.

        Raises:
            PlantFailure: the plant failed while it was driven.
        """
        if isinstance(self.error, PlantFailure):
            raise self.error
        return self.episode


class Interrupted(KeyboardInterrupt):
    """Ctrl-C while a run was driven; ``episode`` holds what was driven until then."""

    def __init__(self, episode: Episode) -> None:
        """Keep the episode."""
        super().__init__(episode)
        self.episode = episode


class RunError(ControllerError):
    """A run that failed; ``episode`` holds what was driven until then."""

    def __init__(self, message: str, episode: Episode) -> None:
        """Keep the episode beside the message."""
        super().__init__(message)
        self.episode = episode


class PlantFailure(PlantError):
    """A plant that failed in mid-run; ``episode`` holds what was driven until then."""

    def __init__(self, message: str, episode: Episode) -> None:
        """Keep the episode beside the message."""
        super().__init__(message)
        self.episode = episode


def run(config: RunConfig, progress: Callable[[float], None] | None = None) -> Episode:
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


def attempt(config: RunConfig, progress: Callable[[float], None] | None = None) -> Attempt:
    """Drive one configuration and return what came of it, failures included.

    Args:
        config: what to drive.
        progress: called now and then with the share of the run that is done.

    Raises:
        PlantError: the plant cannot be reached.
        ConfigError: the configuration's parts do not fit together.
        Interrupted: Ctrl-C; it carries the episode so far and is a ``KeyboardInterrupt``.
    """
    plant = config.plant.make(config.vehicle)
    try:
        episode = rollout(
            plant,
            config.controller,
            config.path,
            config.speed,
            config.sensor,
            vehicle=config.nominal,
            duration=config.duration,
            laps=config.laps,
            corridor=config.corridor,
            start=config.start,
            seed=config.seed,
            progress=progress,
        )
    except (RunError, PlantFailure) as error:
        error.episode = _with_meta(error.episode, config, plant)
        failed: Outcome = "controller_failed" if isinstance(error, RunError) else "plant_failed"
        return Attempt(failed, error.episode, error)
    except Interrupted as error:
        raise Interrupted(_with_meta(error.episode, config, plant)) from None
    finally:
        plant.close()
    return Attempt(_OUTCOMES.get(episode.end, "finished"), _with_meta(episode, config, plant))


def _with_meta(episode: Episode, config: RunConfig, plant: Plant) -> Episode:
    made = {"seed": config.seed, "plant": plant.source}
    meta = {"config": config.model_dump(mode="json"), **made, **provenance()}
    return replace(episode, meta=meta)


def rollout(  # noqa: PLR0913 - the nouns of a closed loop
    plant: Plant,
    controller: ControllerComponent,
    path: PathComponent,
    speed: SpeedComponent,
    sensor: WaypointSensor,
    *,
    vehicle: Vehicle | None = None,
    duration: float | None = None,
    laps: float | None = None,
    corridor: float = 1.5,
    start: float = 0.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Episode:
    """Close the loop and record it.

    ``plant`` holds the vehicle that is driven; ``vehicle`` is what the controller is told of it,
    by default what the plant knows.
    The vehicle starts on the path at arc length ``start`` in the steady turn of the path's
    curvature there. The run ends after ``duration`` [s] or ``laps``, at the end of an open path,
    when the centre of mass is more than ``corridor`` [m] off the path, or when the inner wheels
    lift.

    Raises:
        RunError: the controller raised, or returned something that is not a finite number in
            [-1, 1].
        PlantFailure: the plant failed while it was driven.
        PlantError: the plant cannot be made ready.
        ConfigError: the path has no laps, or ends before the start.
        Interrupted: Ctrl-C.
    """
    rng = np.random.default_rng(seed)
    dt = plant.dt
    goal, limit = _goal(path, start, duration, laps)
    plant.enter(path)
    at = path.at(start)
    v0 = speed.start_speed(path, start)
    state = plant.reset(Pose(at.x, at.y, at.psi), v0, at.kappa)
    place = track(state, path, start)
    sensor_state = sensor.init(rng)
    speed_state = speed.init(path, dt, state)
    # Only now, since a server tells of its vehicle when it is there.
    told = plant.vehicle if vehicle is None else vehicle
    controller_state = controller.init(told, dt)
    recorder, distance, end = _Recorder([]), 0.0, ""
    step = 0
    try:
        while not (end := _end(plant, path, place, corridor, step * dt, distance, goal, limit)):
            observation = sensor.observe(sensor_state, state, place, path, rng)
            try:
                if step == 0:
                    _warm_up(controller, controller.init(told, dt), observation)
                decision, controller_state, took = _ask(controller, controller_state, observation)
            except ControllerError as error:
                so_far = recorder.episode(ending.ERROR, distance, plant, path)
                raise RunError(f"{error}, at t = {state.time:.2f} s", so_far) from error.__cause__
            throttle, brake, speed_state = speed.step(speed_state, state, place.s)
            recorder.add(state, place, decision, (throttle, brake), took)
            v = float(np.hypot(state.v_x, state.v_y))
            try:
                state = plant.step(Command(decision.steer, throttle, brake))
            except PlantError as error:
                so_far = recorder.episode(ending.ERROR, distance, plant, path)
                raise PlantFailure(f"{error}, at t = {state.time:.2f} s", so_far) from error
            before = place.s
            place = track(state, path, before + v * dt)
            distance += _advance(before, place.s, path)
            step += 1
            if progress is not None and step % 100 == 0:
                progress(min(max(distance / goal, step * dt / limit), 1.0))
    except KeyboardInterrupt:
        so_far = recorder.episode(ending.INTERRUPTED, distance, plant, path)
        raise Interrupted(so_far) from None
    return recorder.episode(end, distance, plant, path)


def _warm_up(
    controller: ControllerComponent, controller_state: Any, observation: Observation
) -> None:
    """Ask without effect, with a state that nobody uses, so that no time holds compilation.

    Several times, since what needs a step before is first computed in the next. Who fails will
    fail again, at a step that counts.
    """
    with suppress(ControllerError):
        for _ in range(_WARM_UPS):
            _, controller_state, _ = _ask(controller, controller_state, observation)


def _ask(
    controller: ControllerComponent, controller_state: Any, observation: Observation
) -> tuple[Decision, Any, float]:
    """The controller's decision, its new state, and how long it took [s].

    Raises:
        ControllerError: it raised, or returned what no actuator can take.
        ConfigError: it does not fit into this loop.
    """
    name = controller.kind or type(controller).__name__
    begun = time.perf_counter()
    try:
        decision, controller_state = controller.step(controller_state, observation)
    except ConfigError:
        raise
    except Exception as error:  # a user's controller may raise anything
        frame = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{FilePath(frame.filename).name}, line {frame.lineno}"
        fault = f"controller {name!r} raised {type(error).__name__}: {error} ({where})"
        raise ControllerError(one_line(fault)) from error
    took = time.perf_counter() - begun
    if not abs(decision.steer) <= 1.0:
        raise ControllerError(
            f"controller {name!r} returned steering {decision.steer}, where a finite number in "
            "[-1, 1] is expected"
        )
    return decision, controller_state, took


def _goal(
    path: PathComponent, start: float, duration: float | None, laps: float | None
) -> tuple[float, float]:
    """Distance to drive [m] and time limit [s] of a run."""
    if start >= path.length:
        end = "a lap has" if path.closed else "the path ends at"
        raise ConfigError(f"{start:g} is not allowed; {end} {path.length:g} [m]", ("start",))
    if laps is not None:
        if not path.closed:
            raise ConfigError(f"path {path.kind!r} is not closed; give a duration", ("laps",))
        return laps * path.length, LONGEST
    if not path.closed:
        return path.length - start, LONGEST if duration is None else duration
    return math.inf, 60.0 if duration is None else duration


def _advance(before: float, after: float, path: PathComponent) -> float:
    """Progress along the path in one step; closed paths wrap."""
    gain = after - before
    if path.closed:
        gain -= path.length * round(gain / path.length)
    return gain


def _end(
    plant: Plant,
    path: PathComponent,
    place: Tracking,
    corridor: float,
    now: float,
    distance: float,
    goal: float,
    limit: float,
) -> str:
    """Why the run ends here; empty if it goes on."""
    if not abs(place.lateral_error) <= corridor:
        return ending.OFF_TRACK
    if plant.rolled_over():
        return ending.ROLL_OVER
    if distance >= goal - 1e-9:
        return ending.LAPS if path.closed else ending.END_OF_PATH
    if now >= limit - 1e-9:
        return ending.DURATION if limit < LONGEST else ending.TIMEOUT
    return ""
