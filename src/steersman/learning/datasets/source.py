"""What a user names as data to learn from: Minari datasets, recordings, episodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from steersman.config import dump
from steersman.episode import load_episode
from steersman.errors import ConfigError, DataError
from steersman.kernels import observe
from steersman.learning.datasets import replay, store
from steersman.learning.datasets.trajectory import Trajectory
from steersman.learning.problem import Problem
from steersman.logs import read, schemas
from steersman.paths.base import PathComponent
from steersman.paths.mcap_path import McapPath

EPISODE = "episode.npz"
_RECORDINGS = (".mcap", ".db3")
# What makes a normalised steering another wheel angle.
_STEERING = ("max_wheel_angle", "ackermann", "steer_curve_speed", "steer_curve_factor")


def load(problem: Problem, names: Sequence[str], ahead: float = 0.0) -> list[Trajectory]:
    """All drives in the named data, as the problem's policy would have seen them.

    A name is a Minari dataset (its folder, or an id in ``MINARI_DATASETS_PATH``), an ``.mcap`` or
    ``.db3`` recording or the folder of a ROS 2 bag (Odometry, Lateral or Control, and the Path that
    was followed), an episode's ``.npz`` file or the folder it is in. In recordings the centre of
    mass is ``ahead`` [m] of what the Odometry describes.

    Raises:
        DataError: it cannot be read, or holds no drive.
        ConfigError: the problem's car, control period or sensor is another one.
        ModuleNotFoundError: an extra is not installed.
    """
    return [trajectory for name in names for trajectory in _load(problem, name, ahead)]


def _load(problem: Problem, name: str, ahead: float) -> list[Trajectory]:
    place = FilePath(name).expanduser()
    if is_recording(place):
        return of_recording(problem, place, ahead)
    if place.suffix == ".npz" or (place / EPISODE).is_file():
        return [of_episode_file(problem, place / EPISODE if place.is_dir() else place)]
    return _of_minari(problem, name)


def is_recording(place: FilePath) -> bool:
    """Whether a name is that of a recording of ROS 2."""
    return place.suffix in _RECORDINGS or (place / "metadata.yaml").is_file()


def of_recording(problem: Problem, file: FilePath, ahead: float = 0.0) -> list[Trajectory]:
    """The drives of a recording along its Path topic; ``ahead`` as for :func:`load`.

    Raises:
        DataError: it cannot be read, or lacks the path that was to be followed, or steering.
    """
    path = recorded_path(file)
    log = read(file, ahead=ahead)
    try:
        return replay.of_log(problem, log, path)
    except DataError as error:
        raise DataError(f"{file}: {error}") from None


def recorded_path(file: FilePath) -> McapPath:
    """The path that a recording says was followed.

    Raises:
        DataError: it says nothing of a path, or the path cannot be used.
    """
    from steersman.logs.bag import opened

    with opened(file) as recording:
        topic = recording.find((schemas.PATH_TYPE,))
    path = McapPath(file=file, topic=topic)
    _ = path.table  # so that a fault in it is raised here
    return path


def of_episode_file(problem: Problem, file: FilePath) -> Trajectory:
    """An episode along the path that it names.

    Raises:
        DataError: it cannot be read, is too short, or its path is gone.
        ConfigError: it was driven with another car.
    """
    from steersman.config import resolve
    from steersman.vehicles import Vehicle

    episode = load_episode(file)
    config = episode.meta.get("config", {})
    try:
        path, vehicle = resolve("path", config["path"]), resolve("vehicle", config["vehicle"])
        assert isinstance(path, PathComponent)  # the registry holds nothing else under these
        assert isinstance(vehicle, Vehicle)
        check_steering(problem, problem.model_copy(update={"vehicle": vehicle}))
        return replay.of_episode(problem, episode, path)
    except (DataError, KeyError, TypeError) as error:
        raise DataError(f"{file}: {error}") from None


def _of_minari(problem: Problem, name: str) -> list[Trajectory]:
    stored = store.read(name)
    try:
        check(problem, stored.problem)
    except ConfigError as error:
        raise ConfigError(f"{error.what} (data: {name})", error.where) from None
    needed = problem.sensor.count
    for trajectory in stored.trajectories:
        held = (trajectory.rows.shape[1] - observe.O_PREVIEW) // 2
        if held < needed:
            raise DataError(f"{name}: holds {held} waypoints, problem.sensor.count is {needed}")
    return stored.trajectories


def check(problem: Problem, other: Problem) -> None:
    """Refuse data that mean something else in the problem.

    Raises:
        ConfigError: control period, waypoints' spacing or the car's steering differ.
    """
    pairs = {
        ("problem", "plant", "dt"): (problem.plant.dt, other.plant.dt),
        ("problem", "sensor", "spacing"): (problem.sensor.spacing, other.sensor.spacing),
    }
    for where, (own, theirs) in pairs.items():
        if not math.isclose(own, theirs):
            raise ConfigError(f"{own:g}, but the data were recorded with {theirs:g}", where)
    check_steering(problem, other)


def check_steering(problem: Problem, other: Problem) -> None:
    """Refuse data of a car in which the same command means another wheel angle.

    Raises:
        ConfigError: it does.
    """
    own, theirs = dump(problem.vehicle) or {}, dump(other.vehicle) or {}
    for name in _STEERING:
        if not np.array_equal(own[name], theirs[name]):
            raise ConfigError(
                f"{own[name]}, but the data are of a car with {theirs[name]}",
                ("problem", "vehicle", name),
            )
