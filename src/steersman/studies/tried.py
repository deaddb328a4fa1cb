"""The drives of a falsification, kept line by line so that an interruption loses none of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from steersman.bench.grip import demanded_grip
from steersman.engine.journal import Journal, LineFormat
from steersman.rollout import RunConfig, attempt
from steersman.stored import StoredResult, optional
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
    """Whether the run ended before its planned end, though there was the grip for it."""
    end: str
    """How the run ended."""
    max_error_m: float
    """Largest |lateral error| [m]; at most the corridor's half width."""
    seconds: float
    """Simulated time [s]."""
    grip_share: float | None = optional()
    """Of a run that ended early: the largest share of grip that path and speeds ask for."""


def drive(stage: str, point: Point, config: RunConfig, most: float) -> Tried:
    """Drive one disturbed run; a controller that fails is a result.

    One that ends early where more than ``most`` of the grip is needed has not failed: the road
    cannot be asked to be driven at those speeds.

    Raises:
        ConfigError: the parts do not fit together.
        PlantError: the plant failed.
    """
    tried = attempt(config)
    episode = tried.of_controller()
    share = None if episode.completed else demanded_grip(config)
    largest = float(np.max(np.abs(episode["lateral_error"]), initial=0.0))
    return Tried(
        stage=stage,
        point=point,
        norm=norm(point),
        failed=share is not None and share <= most,
        end=episode.end,
        max_error_m=config.corridor if tried.outcome == "left_road" else largest,
        seconds=len(episode) * episode.dt,
        grip_share=share,
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
