"""A metric: the share of a drive in which the car was farther from the path than 20 cm."""

from __future__ import annotations

import numpy as np

from steersman.episode import Episode
from steersman.metrics.base import metric

LIMIT = 0.2  # [m]


@metric("share_beyond_20cm", "-", "share of steps with |lateral error| over 0.2 m", "lower")
def share_beyond(episode: Episode) -> float | None:
    """Share of the control steps with a lateral error beyond 0.2 m to either side."""
    beyond = np.abs(episode["lateral_error"]) > LIMIT
    return float(np.mean(beyond)) if beyond.size else None
