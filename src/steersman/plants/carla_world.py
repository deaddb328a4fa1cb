"""The OpenDRIVE world that a path becomes, and whether a path is on a map that is there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from steersman.errors import PlantError
from steersman.kernels import path as kernel
from steersman.kernels.path import PathTable
from steersman.paths.xodr.write import opendrive
from steersman.plants.carla_frame import CarlaFrame
from steersman.protocols import Path
from steersman.types import PathPoint, Pose

# A car that stands on the start has its rear wheels before it, and held there it rolls a little;
# past the end it needs room to be stopped [m].
_BEFORE, _BEHIND = 30.0, 60.0
# A path is compared with a server's map every so far, and may be so far beside a lane [m].
_LOOK, _BESIDE = 5.0, 0.5


@dataclass(frozen=True)
class _Longer:
    """An open path with a line before and a line behind it."""

    table: PathTable
    length: float
    closed: bool = False

    def at(self, s: float) -> PathPoint:
        """Point at arc length ``s`` of the longer one [m]."""
        return PathPoint(*kernel.at(self.table, 0, s))

    def speeds(self) -> None:
        """It has none of its own."""

    def surface(self) -> None:
        """Generated worlds are flat."""

    def project(self, x: float, y: float, near: float | None = None) -> tuple[float, float]:
        """Arc length and lateral offset of the closest point [m]."""
        s, d = kernel.project(self.table, 0, x, y)
        return float(s), float(d)


def world_of(path: Path, lane_width: float) -> str:
    """The text of an OpenDRIVE world whose one lane has the path as its centre.

    An open path goes on straight at both ends: the world has no ground elsewhere.
    """
    return opendrive(path if path.closed else _longer(path), "steersman", lane_width=lane_width)


def _longer(path: Path) -> _Longer:
    rows = path.table.pieces
    start, end = path.at(0.0), path.at(path.length)
    c, s = math.cos(start.psi), math.sin(start.psi)
    first = [0.0, start.x - _BEFORE * c, start.y - _BEFORE * s, start.psi, 0.0, 0.0, c, s]
    inner = rows.copy()
    inner[:, kernel.S0] += _BEFORE
    whole = _BEFORE + path.length
    c, s = math.cos(end.psi), math.sin(end.psi)
    last = [whole, end.x, end.y, end.psi, 0.0, 0.0, c, s]
    pieces = np.vstack([first, inner, last])
    length, count = whole + _BEHIND, len(pieces)
    index = np.searchsorted(pieces[:, 0], length / count * np.arange(count), side="right") - 1
    meta = np.array([[0.0, count, 0.0, count, length / count, length, 0.0]])
    return _Longer(PathTable(pieces, index.astype(np.int64), meta), length)


def check_road(path: Path, roads: Any, lib: Any, where: str) -> None:
    """Whether a path is on the roads of a server's map, rather than of another one.

    Args:
        path: what is to be driven.
        roads: ``carla.Map``.
        lib: the module ``carla``.
        where: server and map, for the message.

    Raises:
        PlantError: it leaves them.
    """
    for s in np.linspace(0.0, path.length, max(round(path.length / _LOOK), 2)).tolist():
        at = path.at(s)
        here = CarlaFrame().placement(Pose(at.x, at.y, at.psi))
        place = lib.Location(here.x, here.y, 0.0)
        lane = roads.get_waypoint(place, lane_type=lib.LaneType.Any)
        gap = math.inf
        if lane is not None:
            centre = lane.transform.location
            gap = math.hypot(centre.x - here.x, centre.y - here.y)
        if lane is None or gap > 0.5 * lane.lane_width + _BESIDE:
            raise PlantError(
                f"{where}: at s = {s:.0f} m the path is on no road of that map, the nearest lane "
                f"is {gap:.1f} m away; take path=opendrive with the map's file ('steersman carla "
                "map'), or no plant.map"
            )
