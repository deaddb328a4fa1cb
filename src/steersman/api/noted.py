"""What is worth a word about a drive: what does not fit the car, before it and after it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from steersman.api.cars import Made, about_cars
from steersman.commands import Word
from steersman.types import Status

if TYPE_CHECKING:
    from steersman.episode import Episode
    from steersman.rollout import RunConfig

# What a drive's last seconds asked for is looked at [s]; the share of what the car holds from which
# on that is why it ended, and the share that leaves something for errors.
_BEFORE_END, _NEARLY, _SAFE = 2.0, 0.7, 0.4
# A share of the steps in which a controller falls back that is no exception any more.
_OFTEN = 0.1


def before(config: RunConfig, words: Sequence[Word]) -> list[str]:
    """Sentences about car, gains and path before a drive: figures that no car has, repairs.

    ``words`` are those of the command, which name the file of the gains.

    Raises:
        DataError: a file cannot be read any more.
    """
    from steersman.paths.bends import too_sharp

    computed = config.plant.computed
    made = [Made(config.controller, words)] if computed else []
    out = [*about_cars([config.vehicle], made), *(f"path: {note}" for note in config.path.notes())]
    bend = too_sharp(config.path, config.vehicle.turning_radius)
    return [*out, f"path: {bend}"] if bend is not None and computed else out


def after(config: RunConfig, episode: Episode) -> list[str]:
    """Sentences about why a drive went as it did: too fast for a bend, steps without an answer."""
    fast = too_fast(config, episode) if config.plant.computed else None
    held = int(np.count_nonzero(episode["status"] == Status.FALLBACK))
    out = [] if fast is None else [f"speed: {fast}"]
    if held > max(1.0, _OFTEN * len(episode)):
        out.append(
            f"controller: {held} of {len(episode)} steps were fallbacks: it gave no finite number,"
            " or its own method failed"
        )
    return out


def noted(config: RunConfig, words: Sequence[Word], episode: Episode) -> Episode:
    """The episode with all these sentences as its ``notes``."""
    notes = [*before(config, words), *after(config, episode)]
    return replace(episode, meta={**episode.meta, "notes": notes}) if notes else episode


def too_fast(config: RunConfig, episode: Episode) -> str | None:
    """A sentence about the bend that a drive ended in, where it asked for more than the car holds.

    None where the drive did not leave the road or roll over, or not for that reason.
    """
    from steersman.episode import OFF_TRACK, ROLL_OVER
    from steersman.kernels.vehicle import GRAVITY

    if episode.end not in {OFF_TRACK, ROLL_OVER} or not len(episode):
        return None
    rows = slice(-math.ceil(_BEFORE_END / episode.dt), None)
    speed, curvature = episode["v_x"][rows], episode["curvature"][rows]
    asked = speed**2 * np.abs(curvature)
    row, car = int(np.argmax(asked)), config.vehicle
    held = min(car.friction * GRAVITY, car.roll_over_acceleration)
    if asked[row] < _NEARLY * held:
        return None
    capped = "a_lat_max" in type(config.speed).model_fields
    cure = f"{'' if capped else 'speed=constant_speed '}speed.a_lat_max={_SAFE * held:.2g}"
    return (
        f"{speed[row]:.1f} m/s in a bend of {1.0 / abs(curvature[row]):.2g} m ask for"
        f" {asked[row]:.2g} m/s^2 at s = {episode['s'][rows][row]:.0f} m, the car holds {held:.2g};"
        f" {cure} slows down for bends"
    )
