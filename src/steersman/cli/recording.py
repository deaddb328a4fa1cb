"""Runs as recordings of ROS 2 and as tables, for ``drive --mcap`` and ``export``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from steersman import files
from steersman.cli.output import note
from steersman.errors import DataError

if TYPE_CHECKING:
    from steersman.episode import Episode
    from steersman.rollout import RunConfig

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
    return files.out_file(name, "--mcap", (".mcap",))


def video_file(name: str | None) -> FilePath | None:
    """The file that a drive is to be filmed in, proved to be writable before anything runs.

    None: it is not to be filmed.

    Raises:
        DataError: its name ends in neither ``.mp4`` nor ``.gif``, it is a folder, or its folder
            cannot be written.
        SteersmanError: the extra ``video`` is not installed.
    """
    from steersman.rendering import require

    if name is None:
        return None
    require()
    return files.out_file(name, "--video", (".mp4", ".gif"))


def record(file: FilePath | None, config: RunConfig, episode: Episode) -> None:
    """Write a run as a recording, if there is a file for it.

    Raises:
        DataError: the file cannot be written.
    """
    from steersman.logs.write import write_episode

    if file is not None:
        car = config.vehicle
        write_episode(file, episode, car.table, config.path, (car.body_length, car.width))


def export_mcap(source: str, folder: FilePath) -> Sequence[FilePath]:
    """An episode's file, or a folder of ``steersman drive --out``, as ``NAME.mcap``.

    Raises:
        DataError: there is no episode, or it does not say which vehicle was driven.
    """
    from steersman.logs.driven import write_recording

    episode, out = _driven(source, folder, ".mcap")
    write_recording(out, episode, note)
    return (out,)


def export_table(source: str, folder: FilePath, suffix: str) -> Sequence[FilePath]:
    """The signals of such an episode as a table, ``NAME`` and a suffix of ``Shown.save``.

    Raises:
        DataError: there is no episode.
        SteersmanError: Parquet needs the extra ``bench``.
    """
    episode, out = _driven(source, folder, suffix)
    episode.save(out)
    return (out,)


def _driven(source: str, folder: FilePath, suffix: str) -> tuple[Episode, FilePath]:
    """The episode that a user names, and the file in a folder that it is to be exported to."""
    from steersman.episode import load_episode

    file = episode_file(source)
    episode, whole = load_episode(file), file.resolve()
    note(f"{len(episode)} steps, {episode.distance:.1f} m: {file}")
    name = whole.parent.name if whole.name == EPISODE else whole.stem
    return episode, folder / f"{name}{suffix}"


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
