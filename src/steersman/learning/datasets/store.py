"""Trajectories as a Minari dataset (Farama Foundation) in a folder, and back.

Only the folder is ever touched: nothing is looked up, downloaded or uploaded. docs/datasets.md
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from importlib.metadata import version
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from steersman.config import build, dump
from steersman.errors import ConfigError, DataError, one_line
from steersman.files import make_folder
from steersman.kernels.encode import FEATURE_LIMIT
from steersman.learning.datasets.trajectory import Trajectory, Who, features, steps
from steersman.learning.problem import Problem

if TYPE_CHECKING:
    from minari import MinariDataset

_ENVIRONMENT = "steersman/PathFollowing-v0"
_ENTRY_POINT = "steersman.learning.env:PathFollowingEnv"
_KEY, _FORMAT = "steersman", 1
_PLACES = ("lateral_error", "heading_error", "s", "speed")
# Infos of each step, beside the places and rows of each observation; the last row of each is none.
_STEPS = ("own", "demonstrated", "steer", "demonstrated_steer", "driver")
_NAMES = {"own": "own_action", "demonstrated": "demonstrated_action"}
_LONGEST_TEXT = 120


class Stored(NamedTuple):
    """What a Minari dataset of Steersman holds."""

    problem: Problem
    """Whose observations, actions and rewards they are."""
    trajectories: list[Trajectory]
    source: str
    """Where they came from, in a few words."""


def root(environment: Any = os.environ) -> FilePath:
    """Where Minari keeps its datasets: ``MINARI_DATASETS_PATH``, or ``~/.minari/datasets``."""
    named = environment.get("MINARI_DATASETS_PATH")
    return FilePath(named) if named else FilePath.home() / ".minari" / "datasets"


def write(folder: FilePath, name: str, stored: Stored) -> FilePath:
    """Write a dataset ``NAME-v0`` into ``folder``; returns the dataset's own folder.

    With ``MINARI_DATASETS_PATH`` set to ``folder``, ``minari.load_dataset("NAME-v0")`` finds it.
    Observations are the environment's, actions the executed ones. It is there as a whole or not at
    all.

    Raises:
        DataError: there is such a dataset already, or it cannot be written.
        ModuleNotFoundError: the extra ``minari`` is not installed.
    """
    require()
    place = check_free(make_folder(folder), name)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".minari_") as temporary:
        # Resolved, because Minari joins relative names to themselves.
        _fill(FilePath(temporary).resolve() / "data", place.name, stored)
        made = FilePath(temporary)
        place.mkdir()
        shutil.move(made / "data", place / "data")
    return place


def require() -> None:
    """Check before any work that a dataset can be written.

    Raises:
        ModuleNotFoundError: the extra ``minari`` is not installed.
    """
    import minari  # noqa: F401


def check_free(folder: FilePath, name: str) -> FilePath:
    """Where a dataset of that name goes, which must be free.

    Raises:
        DataError: it is not.
    """
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip(".-_")
    place = folder / f"{plain or 'drives'}-v0"
    if place.exists():
        raise DataError(f"{place}: is there already; remove it or name another folder")
    return place


def _fill(data: FilePath, dataset_id: str, stored: Stored) -> None:
    from gymnasium import spaces
    from gymnasium.envs.registration import EnvSpec
    from minari.dataset.minari_storage import MinariStorage

    problem = stored.problem
    names = problem.layout.names
    storage = MinariStorage.new(
        data,
        observation_space=spaces.Box(-FEATURE_LIMIT, FEATURE_LIMIT, (len(names),), np.float32),
        action_space=spaces.Box(-1.0, 1.0, problem.turned.shape, np.float32),
        env_spec=EnvSpec(_ENVIRONMENT, _ENTRY_POINT, kwargs={"problem": dump(problem)}),
        data_format="arrow",
    )
    storage.update_episodes(_buffer(problem, one) for one in stored.trajectories)
    storage.update_metadata(
        {
            "dataset_id": dataset_id,
            "minari_version": version("minari"),
            "algorithm_name": stored.source,
            "description": _description(),
            "requirements": ["steersman"],
            _KEY: {
                "format": _FORMAT,
                "version": version("steersman"),
                "source": stored.source,
                "problem": dump(problem),
                "observation": names,
                "drivers": {str(who.value): who.name.lower() for who in Who},
                "steps": steps(stored.trajectories),
                "sha256": _digests(data),
            },
        }
    )


def _digests(data: FilePath) -> dict[str, str]:
    """SHA-256 of each file of numbers: Arrow has no checksum, and aborts on what is damaged."""
    return {
        file.relative_to(data).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(data.glob("*/*.arrow"))
    }


def _description() -> str:
    return (
        "Observations, actions and rewards of steersman/PathFollowing-v0; actions are those that "
        "were executed. infos: own_action, demonstrated_action, driver (0 own policy, 1 "
        "demonstrator, 2 recorded driver), steer, demonstrated_steer (normalised, left positive): "
        "of the step that follows each observation, NaN or -1 where there is none; lateral_error "
        "[m], heading_error [rad], s [m], speed [m/s]; row, the observation before encoding."
    )


def _buffer(problem: Problem, one: Trajectory) -> Any:
    from minari.data_collector.episode_buffer import EpisodeBuffer

    count = one.steps
    infos: dict[str, Any] = {"row": one.rows}
    infos |= {name: one.places[:, j : j + 1] for j, name in enumerate(_PLACES)}
    for field in _STEPS:
        values = getattr(one, field).reshape(count, -1)
        none = np.full_like(values[:1], -1 if field == "driver" else np.nan)
        infos[_NAMES.get(field, field)] = np.concatenate((values, none))
    ends = np.zeros(count, dtype=bool)
    ends[-1:] = True
    return EpisodeBuffer(
        observations=features(problem, one.rows, one.steer),
        actions=one.actions.astype(np.float32),
        rewards=one.rewards.tolist(),
        terminations=(ends & one.terminated).tolist(),
        truncations=(ends & (not one.terminated)).tolist(),
        infos=infos,
    )


def read(name: str) -> Stored:
    """The dataset in a folder, or the one of that id where Minari keeps its datasets.

    Actions come back in single precision, everything else to the bit.

    Raises:
        DataError: there is none, it is damaged, or it is not one of Steersman.
        ModuleNotFoundError: the extra ``minari`` is not installed.
    """
    from minari import MinariDataset

    place = locate(name).resolve()
    try:
        dataset = MinariDataset(str(place / "data"))
        head = dataset.storage.metadata.get(_KEY)
        if not isinstance(head, dict) or head.get("format") != _FORMAT:
            raise DataError(f"{name}: is no dataset of Steersman: its observations are not known")
        found, wanted = _digests(place / "data"), head["sha256"]
        changed = [file for file in wanted if found.get(file) != wanted[file]]
        if changed:
            raise DataError(f"{name}: data/{changed[0]} is missing, damaged or was changed")
        problem = build(Problem, head["problem"])
        return Stored(problem, _trajectories(dataset), str(head["source"]))
    except ConfigError as error:
        raise DataError(f"{name}: its problem: {error}") from None
    except DataError:
        raise
    except Exception as error:  # a damaged dataset makes its readers raise anything
        what = one_line(str(error))[:_LONGEST_TEXT] or type(error).__name__
        raise DataError(f"{name}: cannot be read as a Minari dataset ({what})") from error


def locate(name: str) -> FilePath:
    """The folder of a dataset: itself, the only one in it, or an id of Minari's.

    Raises:
        DataError: there is none.
    """
    for place in (FilePath(name).expanduser(), root() / name):
        if (place / "data" / "metadata.json").is_file():
            return place
        inside = sorted(place.glob("*/data/metadata.json"))
        if len(inside) == 1:
            return inside[0].parent.parent
        if inside:
            found = ", ".join(file.parent.parent.name for file in inside)
            raise DataError(f"{name}: holds several datasets, name one: {found}")
    raise DataError(f"{name}: no Minari dataset, neither a folder nor an id in {root()}")


def _trajectories(dataset: MinariDataset) -> list[Trajectory]:
    return [_trajectory(episode) for episode in dataset.iterate_episodes()]


def _trajectory(episode: Any) -> Trajectory:
    infos = episode.infos
    count = len(episode.rewards)
    columns = {field: infos[_NAMES.get(field, field)][:count] for field in _STEPS}
    columns |= {field: columns[field][:, 0] for field in _STEPS if field not in _NAMES}
    rows = np.asarray(infos["row"], dtype=np.float64)
    if rows.shape[0] != count + 1 or count == 0:
        raise DataError(f"episode {episode.id} holds {rows.shape[0]} observations of {count} steps")
    return Trajectory(
        rows=rows,
        places=np.concatenate([infos[name] for name in _PLACES], axis=1),
        actions=np.asarray(episode.actions, dtype=np.float64),
        rewards=np.asarray(episode.rewards, dtype=np.float64),
        terminated=bool(episode.terminations[-1]),
        **columns,
    )
