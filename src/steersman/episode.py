"""The record of one run: a column for each signal, one row for each control step.

Row k holds the state at time k dt, what the controller decided there, and how long that took.
Errors are those of the true state, whatever the sensors said.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from itertools import pairwise
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from steersman.bounds import MOST_ARRAYS, from_json, read_arrays
from steersman.errors import ConfigError, DataError, suggestion, three_digits
from steersman.files import replacing
from steersman.naming import recorded_name
from steersman.shown import Shown
from steersman.table_file import Columns
from steersman.types import Driver, FloatArray, Reason

if TYPE_CHECKING:
    from steersman.metrics.base import DriveMetrics

# Every column of an episode and its unit, in the order of the file.
COLUMNS: dict[str, str] = {
    "time": "s",
    "x": "m",
    "y": "m",
    "psi": "rad",
    "v_x": "m/s",
    "v_y": "m/s",
    "yaw_rate": "rad/s",
    "a_x": "m/s^2",
    "a_y": "m/s^2",
    "s": "m",
    "lateral_error": "m",
    "heading_error": "rad",
    "course_error": "rad",
    "curvature": "1/m",
    "path_x": "m",
    "path_y": "m",
    "steer_command": "-",
    "steer": "-",
    "wheel_angle": "rad",
    "throttle": "-",
    "brake": "-",
    "status": "-",
    "control_time": "s",
    "driver": "-",
    "reason": "-",
}
# Those of a drive behind another car, bumper to bumper, and their units.
LEAD_COLUMNS: dict[str, str] = {"gap": "m", "lead_speed": "m/s"}
# Columns that episodes did not always have; without them there was no intervention.
_LATER = ("driver", "reason")
_REASONS = {float(reason): reason.name.lower() for reason in Reason}
# Ways a run can end.
DURATION, LAPS, END_OF_PATH = "duration", "laps", "end_of_path"
OFF_TRACK, ROLL_OVER, TIMEOUT = "off_track", "roll_over", "timeout"
COLLISION, OVERRUN = "collision", "overrun"
ERROR, INTERRUPTED = "error", "interrupted"
COMPLETED = frozenset({DURATION, LAPS, END_OF_PATH})


class Intervention(NamedTuple):
    """A stretch of a run in which a supervisor's fallback steered, for one reason."""

    begin: float
    """Time of the first step of it [s]."""
    end: float
    """Time of the first step after it, or of the run's end [s]."""
    reason: str
    """Name of the ``Reason`` in small letters, e.g. ``"input_not_finite"``."""
    controller: str
    """What steered: the kind of the fallback, or ``"hold"``."""


@dataclass(frozen=True, repr=False)
class Episode(Shown):
    """A finished run.

    What shows and saves it is in :class:`steersman.shown.Shown`.

    Attributes:
        columns: one float64 array for each name of ``COLUMNS``, all of the same length; behind
            another car also for those of ``LEAD_COLUMNS``.
        end: why the run ended, e.g. ``"laps"`` or ``"off_track"``.
        distance: distance driven along the path [m].
        dt: control period [s].
        path_length: arc length of the path [m]; ``closed`` tells whether it is a loop.
        meta: plain data: resolved configuration, seed, versions, commit.
        fine: longitudinal and lateral acceleration at the plant's integration steps [m/s^2],
            shape (rows x substeps, 2); row k of the columns is followed by its substeps. Empty
            unless the plant records them (``plant.record``).
    """

    columns: Mapping[str, FloatArray]
    end: str
    distance: float
    dt: float
    path_length: float
    closed: bool
    meta: Mapping[str, Any] = field(default_factory=dict)
    fine: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self.columns:
            raise ConfigError(f"no column {name!r}{suggestion(str(name), self.columns)}")
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["time"])

    @property
    def completed(self) -> bool:
        """Whether the run reached its planned end."""
        return self.end in COMPLETED

    def interventions(self) -> list[Intervention]:
        """Every intervention of a supervisor, in order of time; empty without a supervisor."""
        driver, reason, time = self["driver"], self["reason"], self["time"]
        if not len(self):
            return []
        changed = (np.diff(driver) != 0.0) | (np.diff(reason) != 0.0)
        edges = [0, *(np.flatnonzero(changed) + 1).tolist(), len(self)]
        names = _drivers(self.meta.get("config", {}))
        return [
            Intervention(
                float(time[first]),
                float(time[last] if last < len(self) else time[-1] + self.dt),
                _REASONS.get(reason[first], "unknown"),
                names.get(driver[first], "unknown"),
            )
            for first, last in pairwise(edges)
            if driver[first] != Driver.INNER
        ]

    @property
    def notes(self) -> tuple[str, ...]:
        """What ``steersman.drive`` found worth a word: a bend taken too fast, fallbacks."""
        return tuple(map(str, self.meta.get("notes", ())))

    @property
    def metrics(self) -> DriveMetrics:
        """The figures of the drive: ``episode.metrics.rms_lateral_error_m``."""
        found: DriveMetrics = import_module("steersman.metrics.base").DriveMetrics(self)
        return found

    shown_by = "steersman.report.shown_runs:shown_episode"

    def line(self) -> str:
        """What drove where, how far, how it ended, and its lateral error."""
        who, where = (recorded_name(self.meta, name) for name in ("controller", "path"))
        what = f"{who} on {where}, " if who and where else ""
        error = 1e3 * np.abs(self["lateral_error"])
        rms = float(np.sqrt(np.mean(error**2))) if len(self) else math.nan
        return (
            f"Episode: {what}{len(self) * self.dt:.4g} s, {self.distance:.4g} m, ended by "
            f"{self.end}; lateral error RMS {three_digits(rms)} mm, largest"
            f" {three_digits(error.max(initial=0.0))} mm"
        )

    def table(self) -> Columns:
        """The columns; :meth:`units` has their units."""
        return self.columns

    def units(self) -> Mapping[str, str]:
        """The unit of each column."""
        known = COLUMNS | LEAD_COLUMNS
        return {name: known[name] for name in self.columns if name in known}

    def savers(self) -> Mapping[str, Callable[[FilePath], None]]:
        """``.npz`` for :func:`load_episode`, recordings ``.mcap``, videos ``.mp4`` and ``.gif``.

        Recordings need the extra ``logs``, videos the extra ``video``.
        """
        videos = {".mp4": self._save_video, ".gif": self._save_video}
        return {".npz": self._save_npz, ".mcap": self._save_mcap, **videos}

    def _save_video(self, file: FilePath) -> None:
        import_module("steersman.report.video").write_video(self, file)

    def _save_mcap(self, file: FilePath) -> None:
        import_module("steersman.logs.driven").write_recording(file, self)

    def _save_npz(self, file: FilePath) -> None:
        """Without pickles."""
        head = {
            "end": self.end,
            "distance": self.distance,
            "dt": self.dt,
            "path_length": self.path_length,
            "closed": self.closed,
            "meta": dict(self.meta),
        }
        text = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
        arrays: dict[str, Any] = {"head": text, **self.columns}
        if self.fine.size:
            arrays["fine"] = self.fine
        with replacing(file) as stream:
            np.savez_compressed(stream, **arrays)


def _drivers(config: Any) -> dict[float, str]:
    """What steers, by the column's value: the kinds that a configuration names, as far as it does.

    Without one, their roles.
    """
    fields, names = _supervisor(config) or {}, {}
    for driver in Driver:
        role = driver.name.lower()
        given = fields.get(role)
        names[float(driver)] = str(given["kind"]) if isinstance(given, Mapping) else role
    return names


def _supervisor(data: Any) -> Mapping[str, Any] | None:
    """The fields of the first supervisor in a dumped configuration, however deep."""
    if not isinstance(data, Mapping):
        return None
    if data.get("kind") == "supervisor":
        return data
    return next((found for v in data.values() if (found := _supervisor(v)) is not None), None)


def is_episode(file: FilePath) -> bool:
    """Whether an ``.npz`` file claims to be an episode; archives of others do not.

    Raises:
        DataError: the file is missing or not an archive at all.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            return "head.npy" in archive.namelist()
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror or error})") from None
    except (EOFError, ValueError, NotImplementedError, zipfile.BadZipFile) as error:
        raise DataError(f"{file}: not an .npz archive ({error})") from None


def load_episode(file: FilePath) -> Episode:
    """Read what :meth:`Episode.save` wrote.

    Raises:
        DataError: the file is missing, not an episode, or lacks columns.
    """
    try:
        with file.open("rb") as stream:
            data = read_arrays(stream, MOST_ARRAYS)
        head = from_json(bytes(data["head"]))
        columns = {
            name: np.asarray(data[name], dtype=np.float64)
            for name in (*COLUMNS, *LEAD_COLUMNS)
            if name in data or name not in (*_LATER, *LEAD_COLUMNS)
        }
        for name in _LATER:
            columns.setdefault(name, np.zeros_like(columns["time"]))
        fine = np.asarray(data["fine"] if "fine" in data else np.zeros((0, 2)), np.float64)
        episode = Episode(columns=columns, fine=fine, **head)
        check(episode)
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror or error})") from None
    except (KeyError, ValueError, TypeError) as error:
        raise DataError(f"{file}: not an episode of Steersman ({error})") from None
    return episode


def check(episode: Episode) -> None:
    """Refuse what a flipped byte or another program's file would smuggle in.

    Raises:
        ValueError: columns or ``dt`` are none that a run makes; TypeError: so is another field.
    """
    shapes = {np.shape(column) for column in episode.columns.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1:
        raise ValueError("its columns differ in length")
    if episode.fine.shape[1:] != (2,):
        raise ValueError(f"its accelerations have the shape {episode.fine.shape}")
    allowed: dict[str, type | tuple[type, ...]] = {
        "end": str,
        "distance": (int, float),
        "dt": (int, float),
        "path_length": (int, float),
        "closed": bool,
        "meta": dict,
    }
    for name, kind in allowed.items():
        if not isinstance(getattr(episode, name), kind):
            raise TypeError(f"{name} is {getattr(episode, name)!r}")
    if not episode.dt > 0.0:
        raise ValueError(f"dt is {episode.dt!r}")
