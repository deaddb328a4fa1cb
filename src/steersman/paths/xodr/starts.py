"""Places on the lanes of a map where cars can be put."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from steersman.paths.xodr.lane_line import Curve
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.types import Pose


def lane_starts(opendrive: str, ahead: float) -> list[Pose]:
    """Poses on the centres of driving lanes, ``ahead`` [m] of each lane's beginning.

    Lanes within junctions have none; in a lane shorter than twice that, it is in the middle.

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
    return [_into(ways.line(place), ahead) for place in begins]


def _into(lane: Sequence[Curve], ahead: float) -> Pose:
    x = np.concatenate([curve.x for curve in lane])
    y = np.concatenate([curve.y for curve in lane])
    psi = np.unwrap(np.concatenate([curve.psi for curve in lane]))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    at = min(ahead, 0.5 * float(along[-1]))
    return Pose(*(float(np.interp(at, along, values)) for values in (x, y, psi)))
