"""``steersman export --to minari``: demonstrations, trainings and recorded drives as datasets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from steersman.cli.output import note, share_bar
from steersman.cli.recording import EPISODE
from steersman.errors import DataError

if TYPE_CHECKING:
    from steersman.episode import Episode
    from steersman.learning.datasets.store import Stored

STEPS = 20_000
"""Steps of a demonstration."""


def home() -> str | None:
    """Minari's folder for datasets, if its environment variable is set."""
    return os.environ.get("MINARI_DATASETS_PATH") or None


def export_minari(source: str, folder: FilePath) -> Sequence[FilePath]:
    """A Minari dataset ``NAME-v0`` in ``folder``.

    Raises:
        DataError: there is nothing of that name, it cannot be read, or the dataset is there.
        ConfigError: there is no demonstrator, or the configuration is wrong.
        ModuleNotFoundError: the extra ``minari`` is not installed.
    """
    from steersman.learning.datasets import store
    from steersman.learning.datasets.trajectory import steps

    place = FilePath(source)
    store.require()  # refused before any work, as the rest is
    store.check_free(folder, _name(place))
    stored = _stored(source, place)
    made = store.write(folder, _name(place), stored)
    note(
        f"{steps(stored.trajectories)} steps of {len(stored.trajectories)} drives; "
        f"MINARI_DATASETS_PATH={folder.resolve()}: minari.load_dataset({made.name!r})"
    )
    return (made,)


def _name(place: FilePath) -> str:
    whole = place.resolve()
    return whole.parent.name if whole.name in {EPISODE, "config.yaml"} else whole.stem


def _stored(source: str, place: FilePath) -> Stored:
    from steersman.learning.datasets.source import is_recording

    if is_recording(place):
        return _of_recording(place)
    if place.suffix == ".npz" or (place / EPISODE).is_file():
        from steersman.episode import load_episode

        file = place / EPISODE if place.is_dir() else place
        return _of_episode(file, load_episode(file))
    return _of_training(source, place)


def _of_training(source: str, place: FilePath) -> Stored:
    """What a training kept of its steps, or else its demonstrator on its roads."""
    from steersman.config import dump, read_yaml
    from steersman.learning.datasets import store
    from steersman.learning.imitation.driving import SIGMA, demonstrate

    if (place / "data").is_dir():
        return store.read(str(place / "data"))
    if place.is_dir() and not (place / "config.yaml").is_file():
        raise DataError(f"{source}: neither a drive ({EPISODE}) nor a training (config.yaml)")
    import steersman as sm

    name = str(place / "config.yaml") if place.is_dir() else source
    imitated = place.is_dir() and "fit" in read_yaml(name)
    problem = sm.configure("imitate" if imitated else "train", name, notify=note).problem
    kind = (dump(problem.demonstration.controller) or {})["kind"]
    with share_bar("demonstrating") as progress:
        drives = demonstrate(problem, STEPS, 0, tick=progress)
    return store.Stored(problem, drives, f"{kind} with noise of {SIGMA:g} on what is executed")


def _of_episode(file: FilePath, episode: Episode) -> Stored:
    """A run of ours, along the path that it names."""
    from steersman.config import build
    from steersman.learning.datasets import replay, store
    from steersman.learning.problem import Problem
    from steersman.logs.driven import driven

    vehicle, path = driven(file, episode, note)
    if path is None:
        raise DataError(f"{file}: the path that was followed is gone, so that nothing can be seen")
    config = episode.meta["config"]
    problem = build(
        Problem,
        {
            "vehicle": vehicle,
            "roads": [path],
            "plant": {"dt": episode.dt},
            "sensor": {name: config["sensor"][name] for name in ("count", "spacing")},
        },
    )
    kind = str(config["controller"]["kind"])
    return store.Stored(problem, [replay.of_episode(problem, episode, path)], kind)


def _of_recording(place: FilePath) -> Stored:
    """A recording: one of ours says what was driven and where, another needs a Path topic."""
    from steersman.learning.datasets import source, store
    from steersman.learning.problem import Problem
    from steersman.logs.restore import holds_episode, read_episode

    if holds_episode(place):
        return _of_episode(place, read_episode(place))
    problem = Problem(roads=(source.recorded_path(place),))
    note(
        f"steering is normalised as that of {problem.vehicle.kind}; "
        "steersman imitate data=... problem.vehicle=... takes the recording itself"
    )
    return store.Stored(problem, source.of_recording(problem, place), "recorded driver")
