"""Seeded ways over OpenDRIVE maps as further courses of a suite.

The maps are the user's: a result names them with their SHA-256 and holds nothing of them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.bench.courses import Speeds, changing, constant
from steersman.bench.map_record import MapRecord
from steersman.bench.standard import core
from steersman.bench.suite import Course, Suite
from steersman.errors import ConfigError, DataError
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.types import PathPoint

ALONE = "maps"
"""Name of the suite that holds nothing but the ways over the maps, with core's disturbances."""
ROUTES = 3
"""Ways on each map."""
# Junctions hold bends that no car follows in its lane: half a usual turning circle [m].
MIN_RADIUS = 6.0
# Lengths of a way [m], the next where a map is too small for the one before.
_DISTANCES = (500.0, 300.0, 150.0)
# Seeds that are tried for ways that differ from those found.
_SEEDS = range(30)
# Ways whose beginnings, middles and ends are all closer than this are the same [m].
_APART = 50.0
_SPEED, _HIGH = 15.0, 22.0


class Map(NamedTuple):
    """What was made of one file."""

    name: str
    """Of the file, without its folder."""
    sha256: str
    courses: dict[str, Course]
    lanes_km: float
    """Length of all lanes that can be driven."""
    sharp_km: float
    """Length of those that are left out because they bend too sharply."""
    why_not: str
    """Why there are fewer ways than wanted, if so; why it cannot be read, if that is so."""

    def described(self) -> str:
        """One line for the terminal."""
        lengths = ", ".join(f"{course.path.length:.0f} m" for course in self.courses.values())
        text = f"{self.name}: " + (f"courses of {lengths}" if lengths else "left out, no course")
        if self.sharp_km > 0.0:
            text += (
                f"; {self.sharp_km:.2f} of {self.lanes_km:.2f} km of lanes are left out: they bend"
                f" below {MIN_RADIUS:g} m"
            )
        return f"{text}; {self.why_not}" if self.why_not else text

    def record(self) -> MapRecord:
        """For ``results.json``."""
        return MapRecord(
            sha256=self.sha256 or None,
            courses=list(self.courses),
            distance_m=sorted({round(course.path.length, 3) for course in self.courses.values()}),
            min_radius_m=MIN_RADIUS,
            lanes_km=round(self.lanes_km, 3),
            lanes_too_sharp_km=round(self.sharp_km, 3),
            why_not_more=self.why_not,
        )


def read_maps(folder: FilePath, count: int = ROUTES) -> list[Map]:
    """The maps of a folder (``*.xodr``) and ``count`` ways on each; none on one that is broken.

    Raises:
        DataError: the folder holds no map.
    """
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; --maps takes a folder of OpenDRIVE files")
    files = sorted(file for file in folder.iterdir() if file.suffix == ".xodr")
    if not files:
        raise DataError(f"{folder}: holds no OpenDRIVE file (*.xodr)")
    return [_readable(file, count) for file in files]


def with_maps(suite: Suite | None, maps: list[Map]) -> Suite:
    """The suite with the maps' courses; alone, they meet the disturbances of ``core``.

    Raises:
        ConfigError: a course of the suite has the name of one of the maps', or no map has one.
    """
    base = core() if suite is None else suite
    courses = {} if suite is None else dict(suite.courses)
    for found in maps:
        for name, course in found.courses.items():
            if name in courses:
                raise ConfigError(f"a course of the suite is named {name!r}; rename {found.name}")
            courses[name] = course
    if not any(found.courses for found in maps):
        raise ConfigError(f"no way on any of the maps: {maps[0].name}: {maps[0].why_not}")
    return base.model_copy(update={"courses": courses})


def _readable(file: FilePath, count: int) -> Map:
    """The map, or why there is nothing to drive on it: one broken file does not stop the others."""
    try:
        return _map(file, count)
    except DataError as error:
        return Map(file.name, "", {}, 0.0, 0.0, str(error).removeprefix(f"{file}: "))


def _map(file: FilePath, count: int) -> Map:
    network = read_network(file)
    ways = Ways(network, MIN_RADIUS)
    places = [place for place in ways.graph.all() if ways.fault(place) is None]
    sizes = np.array([ways.length(place) for place in places])
    sharp = np.array([not ways.fits(place) for place in places], dtype=bool)
    paths, why = _paths(file, network.sha256, count)
    speeds: Speeds = {"constant": constant(_SPEED), "changing": changing(_HIGH)}
    courses = {f"{file.stem}_{path.random}": Course(path=path, speeds=speeds) for path in paths}
    total, left_out = (float(np.sum(row)) / 1e3 for row in (sizes, sizes[sharp]))
    return Map(file.name, network.sha256, courses, total, left_out, why)


def _paths(file: FilePath, sha256: str, count: int) -> tuple[list[OpenDrivePath], str]:
    """Ways that differ, of the largest length that gives as many as wanted; or the most."""
    best: list[OpenDrivePath] = []
    why = ""
    for distance in _DISTANCES:
        try:
            found = list(itertools.islice(_different(file, sha256, distance), count))
        except DataError as error:
            why = why or str(error).removeprefix(f"{file}: ")
            continue
        if len(found) > len(best):
            best = found
        if len(best) == count:
            return best, ""
    return best, why or f"no more than {len(best)} ways that differ"


def _different(file: FilePath, sha256: str, distance: float) -> Iterator[OpenDrivePath]:
    """Ways of increasing seeds, without those that run along with another."""
    seen: list[tuple[PathPoint, ...]] = []
    for seed in _SEEDS:
        path = OpenDrivePath(
            file=file, random=seed, distance=distance, min_radius=MIN_RADIUS, sha256=sha256
        )
        points = tuple(path.at(share * path.length) for share in (0.0, 0.5, 1.0))
        far = (max(math.dist(a[:2], b[:2]) for a, b in zip(points, o, strict=True)) for o in seen)
        if all(way > _APART for way in far):
            seen.append(points)
            yield path
