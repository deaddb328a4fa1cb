"""Places on the lanes of a map where cars can be put."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from steersman.paths.xodr.lane_line import Curve
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.types import Pose


def lane_starts(opendrive: str, ahead: float, every: float = math.inf) -> list[Pose]:
    """Poses on the centres of driving lanes, ``ahead`` [m] of each lane's beginning and further on.

    Lanes within junctions have none; in a lane shorter than twice that, it is in the middle.

    Args:
        opendrive: text of the map.
        ahead: distance of the first pose from the beginning of its lane, and of the last from its
            end, at least [m].
        every: distance between poses of a lane [m].

    Raises:
        DataError: the text is no OpenDRIVE that can be read.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = FilePath(folder) / "map.xodr"
        file.write_text(opendrive, encoding="utf-8")
        ways = Ways(read_network(file))
    begins = [
        place
        for place in ways.graph.all()
        if ways.graph.first(place)
        and not ways.network.roads[place.road].junction
        and ways.fault(place) is None
    ]
    return [pose for place in begins for pose in _along(ways.line(place), ahead, every)]


def _along(lane: Sequence[Curve], ahead: float, every: float) -> list[Pose]:
    x = np.concatenate([curve.x for curve in lane])
    y = np.concatenate([curve.y for curve in lane])
    psi = np.unwrap(np.concatenate([curve.psi for curve in lane]))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    first = min(ahead, 0.5 * float(along[-1]))
    more = max(float(along[-1]) - 2.0 * first, 0.0) / every
    at = first + every * np.arange(1, int(more) + 1) if more >= 1.0 else np.zeros(0)
    places = [first, *at.tolist()]
    return [Pose(*(float(np.interp(s, along, v)) for v in (x, y, psi))) for s in places]
