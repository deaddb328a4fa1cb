"""Checks of a supervisor: observations that cannot be used, and steering that oscillates."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.controllers.plausible import is_possible
from steersman.types import FloatArray, Observation, Reason

# Fewest waypoints that determine a road.
_FEWEST = 4
# Kinds of arrays that hold real numbers.
_REAL = "fiu"
# A slower car may see the same for any time [m/s].
_STANDING = 0.5


def input_fault(observation: object) -> Reason:
    """Why no controller can use this observation; ``NONE`` if one can."""
    if not isinstance(observation, Observation):
        return Reason.MISSING
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            if observation.preview.dtype.kind not in _REAL:
                return Reason.MISSING
            numbers = (*observation[:8], observation.spacing, observation.preview.sum())
            if not all(map(math.isfinite, numbers)):
                return Reason.INPUT_NOT_FINITE
            possible = is_possible(observation) and len(observation.preview) >= _FEWEST
            return Reason.NONE if possible else Reason.INPUT_RANGE
    except (AttributeError, TypeError, ValueError):  # its fields are something else than numbers
        return Reason.MISSING


class LastSeen(NamedTuple):
    """The last usable observation that was new, and the car's motion since."""

    observation: Observation
    age: float = 0.0
    """Time since it arrived [s]."""
    motion: FloatArray | None = None
    """Since then, as ``dead_reckoning.moved_on`` has it; None at once."""
    road: FloatArray | None = None
    """Its waypoints as ``dead_reckoning.quiet`` has them; None at once [m]."""


# Before the first observation; a named tuple like every later one, so that checkpoints can keep it.
NOTHING_SEEN = LastSeen(Observation(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros((0, 2)), 1.0))


def first_sight(observation: Observation) -> LastSeen:
    """The record of a new observation; a copy, since its array may be reused."""
    return LastSeen(observation._replace(preview=np.array(observation.preview, dtype=np.float64)))


def no_news(seen: LastSeen, observation: Observation) -> Reason:
    """``MISSING`` if it is the last sample again, ``STALE`` if its time alone is new."""
    if not _repeats(seen.observation, observation):
        return Reason.NONE
    again = observation.time == seen.observation.time
    return Reason.MISSING if again else Reason.STALE


def _repeats(before: Observation, now: Observation) -> bool:
    """Whether an observation holds the last one's numbers although the car moved.

    If its time is new, a standing car may see the same, and so may one that drives along a
    straight without any error: then every number but the speed is exactly zero.
    """
    if before.preview.shape != now.preview.shape:
        return False
    if before[1:8] != now[1:8] or not (before.preview == now.preview).all():
        return False
    if now.time == before.time:
        return True
    straight = not any((now.lateral_error, now.heading_error, now.v_y, now.yaw_rate, now.curvature))
    return math.hypot(now.v_x, now.v_y) > _STANDING and not straight


class Swings(NamedTuple):
    """Recent reversals of a signal."""

    turned: float | None = None
    """Extreme value since the last reversal [m/s^2]."""
    direction: int = 0
    """Whether the signal has risen (1) or fallen (-1) since."""
    ages: tuple[float, ...] = ()
    """Time since each of the last reversals, newest first; infinite for those not seen yet [s]."""

    def after(self, value: float, gap: float, dt: float) -> Swings:
        """One step later.

        Args:
            value: of the signal [m/s^2].
            gap: a smaller reversal is not counted [m/s^2].
            dt: control period [s].
        """
        ages = tuple(age + dt for age in self.ages)
        if self.turned is None:
            return Swings(value, 0, ages)
        moved = value - self.turned
        way = 1 if moved > 0.0 else -1
        if moved != 0.0 and self.direction in (0, way):
            return Swings(value, way, ages)
        if abs(moved) < gap:
            return self._replace(ages=ages)
        return Swings(value, way, (0.0, *ages[:-1]))


def still(count: int) -> Swings:
    """No reversal yet; the last ``count`` will be kept."""
    return Swings(ages=(math.inf,) * count)
