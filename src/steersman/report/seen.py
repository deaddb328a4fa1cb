"""What a drive's record does not hold, rebuilt from its configuration: road, car, waypoints.

An episode keeps the configuration and the seed of its run, and the state at every control step.
From these the sensor measures again, number by number, what the controller saw then. Where
the configuration is not there, or names files that are gone, the page shows less.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from steersman.config import build, resolve
from steersman.episode import Episode
from steersman.errors import SteersmanError
from steersman.faults import Fault
from steersman.kernels import vehicle as car
from steersman.paths.base import PathComponent
from steersman.plants.simulator import SimulatorConfig
from steersman.profiles import stack_profiles
from steersman.sensing import STATE_COLUMNS, WaypointSensor
from steersman.speed import ConstantSpeed
from steersman.types import FloatArray, Pose, VehicleState
from steersman.vehicles import LONGEST_STEP, CarlaModel3, Vehicle
from steersman.world import Simulation

# A road is the one that was driven if its points are those of the record within this [m].
_SAME = 0.01
_TRACKING = (
    "s", "lateral_error", "heading_error", "course_error", "curvature", "path_x", "path_y",
)  # fmt: skip


def recorded(episode: Episode) -> Mapping[str, Any]:
    """The configuration of a run as its record holds it; empty if it holds none."""
    inner = episode.meta.get("config")
    return inner if isinstance(inner, Mapping) else episode.meta


def _part(episode: Episode, family: str) -> Any:
    """A part of the recorded configuration, built; None where that cannot be."""
    value = recorded(episode).get(family)
    if not isinstance(value, (str, Mapping)):
        return None
    try:
        return resolve(family, value)
    except SteersmanError:
        return None


@lru_cache(maxsize=8)
def _built(config: str) -> PathComponent | None:
    """The path of a configuration; kept, as roads may take longer to build than to drive."""
    value = json.loads(config)
    found = resolve("path", value) if isinstance(value, (str, Mapping)) else None
    return found if isinstance(found, PathComponent) else None


def path_of(episode: Episode) -> PathComponent | None:
    """The path that was driven; None where it cannot be built or is not the one of the record."""
    try:
        path = _built(json.dumps(recorded(episode).get("path"), sort_keys=True, default=str))
    except SteersmanError:
        return None
    if path is None:
        return None
    try:
        last = len(episode) - 1
        for row in np.linspace(0, last, min(50, last + 1)).round().astype(int):
            at = path.at(float(episode["s"][row]))
            gap = np.hypot(at.x - episode["path_x"][row], at.y - episode["path_y"][row])
            if not gap <= _SAME:
                return None
    except SteersmanError:
        return None
    return path


def vehicle_of(episode: Episode) -> tuple[Vehicle, bool]:
    """The car that was driven, and whether it is known: else it is drawn as the default one."""
    vehicle = _part(episode, "vehicle")
    return (vehicle, True) if isinstance(vehicle, Vehicle) else (CarlaModel3(), False)


def waypoints(episode: Episode, path: PathComponent | None) -> FloatArray | None:
    """What the controller saw of the road, shape (rows, waypoints, 2), in the vehicle's frame [m].

    None where the record does not determine it. Sensors and disturbances draw their errors from
    the run's seed in the order of the control steps, so all of it is measured again, at the states
    of the record.
    """
    sensor, seed = _part(episode, "sensor"), recorded(episode).get("seed", 0)
    if path is None or not isinstance(sensor, WaypointSensor) or not isinstance(seed, int):
        return None
    if not len(episode):
        return np.empty((0, sensor.count, 2))
    try:
        simulation = _sensing(episode, path, sensor, seed)
    except SteersmanError:
        return None
    places = np.stack([episode[name] for name in _TRACKING], axis=1)
    out = np.empty((len(episode), sensor.count, 2))
    for row, (state, place) in enumerate(zip(_states(episode), places, strict=True)):
        simulation.measure(0, row, state, place)
        out[row] = simulation.preview(0)
    return out


def _sensing(
    episode: Episode, path: PathComponent, sensor: WaypointSensor, seed: int
) -> Simulation:
    """The world of the record at its start, with what disturbs its sensor.

    Raises:
        SteersmanError: a disturbance or fault of the record is none that there is.
    """
    config = recorded(episode)
    old = config.get("controller")  # where earlier versions had the fault
    holder = old if isinstance(old, Mapping) and old.get("kind") == "faulty" else config
    made: list[Any] = [resolve("disturbance", one) for one in config.get("disturbances", ())]
    disturbers = [one.make(1, seed) for one in made]
    if isinstance(holder.get("fault"), Mapping):
        disturbers.append(build(Fault, holder["fault"]).make(1, int(holder.get("seed", 0))))
    plant = SimulatorConfig(
        dt=episode.dt, integration_step=episode.dt / math.ceil(episode.dt / LONGEST_STEP)
    )
    speed = ConstantSpeed(speed=float(np.hypot(episode["v_x"][0], episode["v_y"][0])))
    simulation = Simulation(
        plant,
        vehicle_of(episode)[0],
        sensor,
        (path,),
        stack_profiles([speed.profile()], [path]),
        corridor=math.inf,
        disturbances=disturbers,
        seed=seed,
    )
    place = Pose(*(float(episode[name][0]) for name in ("x", "y", "psi")))
    simulation.begin(0, 0, float(episode["s"][0]), place, speed.speed, speed.profile())
    return simulation


def _states(episode: Episode) -> FloatArray:
    """The rows of the states as kernels read them (rows, N_STATE), without the loads."""
    names = VehicleState._fields[1:]  # all but the time
    states = np.zeros((len(episode), car.N_STATE))
    states[:, STATE_COLUMNS] = np.stack([episode[name] for name in names], axis=1)
    return states
