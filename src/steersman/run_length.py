"""How long a run lasts: a distance along its path, and a time."""

from __future__ import annotations

import math

from steersman.errors import ConfigError
from steersman.paths.base import PathComponent

# A run that is to end after laps or at the end of the road may take at most this long [s].
LONGEST = 7200.0


def goal(
    path: PathComponent, start: float, duration: float | None, laps: float | None
) -> tuple[float, float]:
    """Distance to drive [m] and time limit [s] of a run."""
    if start >= path.length:
        end = "a lap has" if path.closed else "the path ends at"
        raise ConfigError(f"{start:g} is not allowed; {end} {path.length:g} [m]", ("start",))
    if laps is not None:
        if not path.closed:
            raise ConfigError(f"path {path.kind!r} is not closed; give a duration", ("laps",))
        return laps * path.length, LONGEST
    if not path.closed:
        return path.length - start, LONGEST if duration is None else duration
    return math.inf, 60.0 if duration is None else duration
