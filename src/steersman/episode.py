"""The record of one run: a column for each signal, one row for each control step.

Row k holds the state at time k dt, what the controller decided there, and how long that took.
Errors are those of the true state, whatever the sensors said.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.errors import DataError
from steersman.files import replacing
from steersman.types import FloatArray

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
}
# Ways a run can end.
DURATION, LAPS, END_OF_PATH = "duration", "laps", "end_of_path"
OFF_TRACK, ROLL_OVER, ERROR, INTERRUPTED = "off_track", "roll_over", "error", "interrupted"
COMPLETED = frozenset({DURATION, LAPS, END_OF_PATH})


@dataclass(frozen=True)
class Episode:
    """A finished run.

    Attributes:
        columns: one float64 array for each name of ``COLUMNS``, all of the same length.
        end: why the run ended, e.g. ``"laps"`` or ``"off_track"``.
        distance: distance driven along the path [m].
        dt: control period [s].
        path_length: arc length of the path [m]; ``closed`` tells whether it is a loop.
        meta: plain data: resolved configuration, seed, versions, commit.
    """

    columns: Mapping[str, FloatArray]
    end: str
    distance: float
    dt: float
    path_length: float
    closed: bool
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["time"])

    @property
    def completed(self) -> bool:
        """Whether the run reached its planned end."""
        return self.end in COMPLETED

    def save(self, file: FilePath) -> None:
        """Write the episode as ``.npz`` (no pickles), replacing the file only when complete."""
        head = {
            "end": self.end,
            "distance": self.distance,
            "dt": self.dt,
            "path_length": self.path_length,
            "closed": self.closed,
            "meta": dict(self.meta),
        }
        text = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
        with replacing(file) as stream:
            np.savez_compressed(stream, head=text, **dict(self.columns))


def load_episode(file: FilePath) -> Episode:
    """Read what :meth:`Episode.save` wrote.

    Raises:
        DataError: the file is missing, not an episode, or lacks columns.
    """
    try:
        with np.load(file, allow_pickle=False) as data:
            head = json.loads(bytes(data["head"]).decode())
            columns = {name: np.asarray(data[name], dtype=np.float64) for name in COLUMNS}
        return Episode(columns=columns, **head)
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror or error})") from None
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f"{file}: not an episode of Steersman ({error})") from None
