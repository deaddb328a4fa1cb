"""The drives of a falsification, kept line by line so that an interruption loses none of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from steersman.engine.journal import Journal, LineFormat
from steersman.rollout import RunConfig, attempt
from steersman.stored import StoredResult
from steersman.studies.perturbation import Point, norm


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


def opened(file: FilePath, names: Sequence[str]) -> Journal[Tried]:
    """The journal of the drives with these quantities disturbed; keys are of :func:`key`.

    Raises:
        DataError: the file is no record of drives.
    """
    line = LineFormat(
        "a drive of a falsification",
        Tried.model_validate_json,
        Tried.plain,
        lambda row: key(row.point, names),
    )
    return Journal(file, line)


def key(point: Point, names: Sequence[str]) -> str:
    """The key of a drive: its coordinates."""
    return " ".join(repr(point[name]) for name in names)
