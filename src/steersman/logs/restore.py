"""An episode back from the MCAP file that it was written to."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.bounds import from_json
from steersman.episode import COLUMNS, Episode, check
from steersman.errors import DataError
from steersman.logs import schemas
from steersman.logs.bag import Message, opened


def read_episode(file: FilePath) -> Episode:
    """The episode that :func:`steersman.logs.write.write_episode` wrote.

    All columns are equal to the bit but ``time``, which is rounded to 1 ns. ``fine`` is empty, as
    are columns that the episode did not have yet when it was written.

    Raises:
        DataError: the file cannot be read, or holds a recording that is no episode.
        ModuleNotFoundError: the extra ``logs`` is not installed.
    """
    head = _head(file)
    with opened(file) as recording:
        motion = np.array(recording.some(schemas.ODOMETRY, _motion))
        rest = np.array(recording.some(schemas.DIAGNOSTICS, _diagnostics))
    names = ("time", "x", "y", "v_x", "v_y", "yaw_rate")
    columns = {name: motion[:, i].copy() for i, name in enumerate(names)}
    columns |= {name: rest[:, i].copy() for i, name in enumerate(schemas.DIAGNOSTIC_FIELDS)}
    try:
        fields = {name: head[name] for name in (*schemas.HEAD, "meta")}
        episode = Episode({name: columns[name] for name in COLUMNS}, **fields)
        check(episode)
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{file}: not an episode of Steersman ({error})") from None
    return episode


def holds_episode(file: FilePath) -> bool:
    """Whether a recording is an episode of ours.

    Raises:
        DataError: it cannot be read.
    """
    return file.suffix == ".mcap" and _record(file) is not None


def _motion(message: Message) -> tuple[float, ...]:
    p, v = message.content.pose.pose.position, message.content.twist.twist
    time = (message.logged - schemas.EPOCH * 1_000_000_000) * 1e-9
    return time, p.x, p.y, v.linear.x, v.linear.y, v.angular.z


def _diagnostics(message: Message) -> tuple[float, ...]:
    return tuple(getattr(message.content, name, np.nan) for name in schemas.DIAGNOSTIC_FIELDS)


def _record(file: FilePath) -> dict[str, str] | None:
    """The metadata record of an episode."""
    from mcap.reader import make_reader

    with opened(file), file.expanduser().open("rb") as stream:  # opened() raises with the cause
        records = make_reader(stream).iter_metadata()
        found = [record.metadata for record in records if record.name == schemas.METADATA]
    return found[0] if found else None


def _head(file: FilePath) -> dict[str, Any]:
    """The fields of the episode in the metadata record."""
    record = _record(file)
    try:
        head = from_json((record or {}).get("episode", "null"))
    except ValueError as error:
        raise DataError(f"{file}: not an episode of Steersman ({error})") from None
    if not isinstance(head, dict):
        raise DataError(f"{file}: holds no episode of Steersman, only topics")
    return head
