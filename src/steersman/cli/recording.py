"""Runs as recordings of ROS 2, for ``drive --mcap`` and ``export --to mcap``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman import files
from steersman.cli.output import note
from steersman.errors import ConfigError, DataError

if TYPE_CHECKING:
    from steersman.episode import Episode
    from steersman.paths.base import PathComponent
    from steersman.rollout import RunConfig
    from steersman.vehicles import Vehicle

EPISODE = "episode.npz"


def recording_file(name: str | None) -> FilePath | None:
    """The file that a drive is to be recorded in, proved to be writable before anything runs.

    None: it is not to be recorded.

    Raises:
        DataError: it is a folder, or its folder cannot be written.
        ModuleNotFoundError: the extra ``logs`` is not installed.
    """
    from steersman.logs.write import require

    if name is None:
        return None
    require()
    if not name.endswith(".mcap"):
        raise ConfigError(f"{name!r} is not allowed; a name that ends in .mcap is", ("--mcap",))
    return files.out_file(name, "--mcap")


def record(file: FilePath | None, config: RunConfig, episode: Episode) -> None:
    """Write a run as a recording, if there is a file for it.

    Raises:
        DataError: the file cannot be written.
    """
    from steersman.logs.write import write_episode

    if file is not None:
        write_episode(file, episode, config.vehicle.table, config.path)


def export_mcap(source: str, folder: FilePath) -> Sequence[FilePath]:
    """An episode's file, or a folder of ``steersman drive --out``, as ``NAME.mcap``.

    Raises:
        DataError: there is no episode, or it does not say which vehicle was driven.
    """
    from steersman.episode import load_episode
    from steersman.logs.write import write_episode

    file = episode_file(source)
    episode = load_episode(file)
    vehicle, path = driven(file, episode)
    whole = file.resolve()
    out = folder / f"{whole.parent.name if whole.name == EPISODE else whole.stem}.mcap"
    write_episode(out, episode, vehicle.table, path)
    note(f"{len(episode)} steps, {episode.distance:.1f} m: {file}")
    return (out,)


def episode_file(source: str) -> FilePath:
    """The episode that a user names: its file, or the folder it is in.

    Raises:
        DataError: there is none.
    """
    place = FilePath(source)
    if place.is_dir():
        if not (place / EPISODE).is_file():
            raise DataError(
                f"{source}: no {EPISODE} in this folder; name a folder of steersman drive --out, "
                "or an episode's file"
            )
        return place / EPISODE
    return place


def driven(file: FilePath, episode: Episode) -> tuple[Vehicle, PathComponent | None]:
    """Vehicle and path of an episode, by the configuration in it.

    A path that cannot be made again (its file is gone) is None, with a note.

    Raises:
        DataError: the episode does not name a vehicle.
    """
    from steersman.config import resolve
    from steersman.paths.base import PathComponent
    from steersman.vehicles import Vehicle

    config: Any = episode.meta.get("config", {})
    try:
        vehicle = resolve("vehicle", config["vehicle"])
    except (ConfigError, DataError, KeyError, TypeError) as error:
        raise DataError(f"{file}: does not say which vehicle was driven ({error})") from None
    assert isinstance(vehicle, Vehicle)  # the registry holds nothing else under "vehicle"
    try:
        path = resolve("path", config["path"])
        assert isinstance(path, PathComponent)
        _ = path.table
    except (ConfigError, DataError, KeyError, TypeError) as error:
        note(f"{error}; the path is written as far as it was driven")
        return vehicle, None
    return vehicle, path
