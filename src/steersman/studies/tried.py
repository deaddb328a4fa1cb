"""The drives of a falsification, kept line by line so that an interruption loses none of them."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TypeAlias

import numpy as np

from steersman.errors import DataError
from steersman.rollout import RunConfig, attempt
from steersman.stored import StoredResult
from steersman.studies.perturbation import Point, norm

Key: TypeAlias = tuple[float, ...]


class Tried(StoredResult):
    """A disturbance that was driven."""

    stage: str
    """The part of the search that it belongs to."""
    point: Point
    """Coordinates of :mod:`steersman.studies.perturbation`."""
    norm: float
    """Their Euclidean norm."""
    failed: bool
    """Whether the run ended before its planned end."""
    end: str
    """How the run ended."""
    max_error_m: float
    """Largest |lateral error| [m]; at most the corridor's half width."""
    seconds: float
    """Simulated time [s]."""


def drive(stage: str, point: Point, config: RunConfig) -> Tried:
    """Drive one disturbed run; a controller that fails is a result.

    Raises:
        ConfigError: the parts do not fit together.
        PlantError: the plant failed.
    """
    tried = attempt(config)
    episode = tried.of_controller()
    largest = float(np.max(np.abs(episode["lateral_error"]), initial=0.0))
    return Tried(
        stage=stage,
        point=point,
        norm=norm(point),
        failed=not episode.completed,
        end=episode.end,
        max_error_m=config.corridor if tried.outcome == "left_road" else largest,
        seconds=len(episode) * episode.dt,
    )


class Kept:
    """Drives of earlier sessions by their coordinates, and the file to which new ones are added.

    A line that was torn by an interruption is cut off.
    """

    def __init__(self, file: FilePath, names: Sequence[str]) -> None:
        """Read the file, if it is there.

        Raises:
            DataError: it is no record of drives.
        """
        self.file, self.names = file, tuple(names)
        self.found: dict[Key, Tried] = {}
        text = file.read_bytes() if file.exists() else b""
        whole = text[: text.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                row = Tried.model_validate_json(line)
                self.found[self.key(row.point)] = row
            except (ValueError, TypeError, KeyError):
                raise DataError(f"{file}, line {number}: not a drive of a falsification") from None
        if whole != text:
            os.truncate(file, len(whole))

    def key(self, point: Point) -> Key:
        """What a drive is found by."""
        return tuple(point[name] for name in self.names)

    def add(self, row: Tried) -> None:
        """Append a drive.

        Raises:
            DataError: the file cannot be written.
        """
        self.found[self.key(row.point)] = row
        try:
            with self.file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row.plain(), allow_nan=False) + "\n")
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise DataError(f"{self.file}: cannot be written ({error.strerror})") from None
