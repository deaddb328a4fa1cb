"""What is measured of a drive that is to stand at the end of its path; undefined for others."""

from __future__ import annotations

import math

from steersman.episode import END_OF_PATH, Episode
from steersman.metrics.base import Metric, metric, metrics

_NAME = "stop_error_m"


def stopping() -> dict[str, type[Metric]]:
    """The metrics of a drive that is to stand at the end of its path, by name."""
    return {_NAME: metrics(benchmark=True)[_NAME]}


@metric(_NAME, "m", "distance from the end, standing", "lower", benchmark=True)
def stop_error(episode: Episode) -> float:
    """Distance between the end of the path and where the car stands at last [m].

    Defined where the source of speed has ``end`` 0 and the car stood at the end of the path.
    """
    speed = episode.meta.get("config", {}).get("speed", {})
    if speed.get("end") != 0.0 or episode.end != END_OF_PATH or not len(episode):
        return math.nan
    return abs(episode.path_length - float(episode["s"][0]) - episode.distance)
