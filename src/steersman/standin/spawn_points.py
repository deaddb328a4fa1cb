"""Where cars may be spawned on a map: at the beginning of every lane of every road."""

from __future__ import annotations

import tempfile
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from steersman.errors import DataError
from steersman.standin.axes import Transform, origin_of
from steersman.standin.log import warn_once

if TYPE_CHECKING:
    from steersman.paths.xodr.lane_line import Curve

# How far into a lane [m], unless it is shorter than twice that.
_INTO_THE_LANE = 5.0


def spawn_points(opendrive: str) -> tuple[Transform, ...]:
    """Poses on the centres of driving lanes, a car's length after their beginning.

    A map that our reader does not take has none; the log says why.
    """
    from steersman.paths.xodr.read import read_network
    from steersman.paths.xodr.ways import Ways

    try:
        with tempfile.TemporaryDirectory() as folder:
            file = FilePath(folder) / "map.xodr"
            file.write_text(opendrive, encoding="utf-8")
            ways = Ways(read_network(file))
        graph = ways.graph
        begins = [
            place
            for place in graph.all()
            if graph.first(place) and not ways.network.roads[place.road].junction
        ]
        return tuple(_into(ways.line(place)) for place in begins)
    except DataError as error:
        warn_once(f"stand-in: no spawn points: {error}")
        return ()


def _into(lane: list[Curve]) -> Transform:
    """A pose on the lane, driven from its first curve on."""
    x = np.concatenate([curve.x for curve in lane])
    y = np.concatenate([curve.y for curve in lane])
    psi = np.unwrap(np.concatenate([curve.psi for curve in lane]))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    at = min(_INTO_THE_LANE, 0.5 * float(along[-1]))
    here = [float(np.interp(at, along, values)) for values in (x, y, psi)]
    return origin_of(here[0], here[1], here[2], 0.0)
