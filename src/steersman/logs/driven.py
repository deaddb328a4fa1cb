"""Which vehicle and path an episode was driven with, and the episode as a recording of ROS 2."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman.config import resolve
from steersman.episode import Episode
from steersman.errors import ConfigError, DataError
from steersman.logs.write import write_episode

if TYPE_CHECKING:
    from steersman.paths.base import PathComponent
    from steersman.vehicles import Vehicle


def write_recording(
    file: FilePath, episode: Episode, notify: Callable[[str], None] | None = None
) -> None:
    """Write an episode as a recording, with the vehicle and the path of its configuration.

    Args:
        file: the file to write, usually ``*.mcap``.
        episode: the run.
        notify: called with a sentence if the path cannot be made again (its file is gone); the
            recording then holds it as far as it was driven.

    Raises:
        DataError: the episode does not name a vehicle, or the file cannot be written.
        ModuleNotFoundError: the extra ``logs`` is not installed.
    """
    vehicle, path = driven(file, episode, notify or (lambda _: None))
    write_episode(file, episode, vehicle.table, path, (vehicle.body_length, vehicle.width))


def driven(
    file: FilePath, episode: Episode, tell: Callable[[str], None]
) -> tuple[Vehicle, PathComponent | None]:
    """Vehicle and path of an episode, by the configuration in it.

    A path that cannot be made again is None, and ``tell`` is called with the reason.

    Raises:
        DataError: the episode of ``file`` does not name a vehicle.
    """
    config: Any = episode.meta.get("config", {})
    failures = (ConfigError, DataError, KeyError, TypeError)
    try:
        vehicle: Any = resolve("vehicle", config["vehicle"])
    except failures as error:
        raise DataError(
            f"{file}: the episode does not say which vehicle was driven ({error})"
        ) from None
    try:
        path: Any = resolve("path", config["path"])
        _ = path.table
    except failures as error:
        tell(f"{error}; the path is written as far as it was driven")
        return vehicle, None
    return vehicle, path
