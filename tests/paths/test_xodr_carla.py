"""Lanes' centres beside those of CARLA's own reader.

Maps of others are no part of this project: beside the tests' own maps, those of the folder in
STEERSMAN_MAPS are taken, or of ``shared/data/opendrive`` beside the project.
"""

from __future__ import annotations

import itertools
import math
import os
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.xodr.joined import gap
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.paths.xodr.write import opendrive

from .. import carla_wheel
from . import xodr_maps as maps

BESIDE = FilePath(__file__).resolve().parents[3] / "shared" / "data" / "opendrive"
FOLDER = FilePath(os.environ.get("STEERSMAN_MAPS") or BESIDE)
FILES = sorted(FOLDER.glob("*.xodr"))
TOWNS = [file for file in FILES if file.stem.startswith("Town")]
OWN = {"wavy": maps.wavy, "town": maps.town}
# The place of a lane's end in CARLA is that of the next section's lane: stay within [m].
INSIDE = 1e-4


def compared(file: FilePath) -> list[float]:
    """Distances [m] of CARLA's lane centres from the paths along all lanes of all roads.

    Where the map itself leaves a step, half of it is allowed for.
    """
    world = carla_wheel.load().Map(file.stem, file.read_text(encoding="utf-8"))
    ways = Ways(read_network(file))
    out = []
    for road in ways.network.roads:
        for lane in sorted({place.lane for place in ways.graph.of_road(road)}):
            path = OpenDrivePath(file=file, road=road, lane=lane)
            way, _ = ways.along(road, lane)
            curves = ways.lines(way)
            if sum(len(curve.x) > 1 and np.ptp(curve.s) > 0.02 for curve in curves) == 0:
                continue
            step = max((abs(gap(a, b).aside) for a, b in itertools.pairwise(curves)), default=0.0)
            for place in way:
                section = ways.graph.section(place)
                low, high = section.start + INSIDE, section.end - INSIDE
                for s in np.linspace(low, high, max(int(high - low), 2)) if high > low else ():
                    found = world.get_waypoint_xodr(int(road), place.lane, float(s))
                    at = found.transform.location
                    out.append(abs(path.project(at.x, -at.y)[1]) - 0.5 * step)
    return out


def name(given: str | FilePath) -> str:
    return FilePath(given).stem


@pytest.fixture(params=[*OWN, *FILES], ids=name)
def file(request: pytest.FixtureRequest, tmp_path: FilePath) -> FilePath:
    """Each map in turn, the tests' own with numbers for roads, by which CARLA knows them."""
    if isinstance(request.param, FilePath):
        return request.param
    names = ("a-left", "a-on", "a-right", "left", "right", "back", "on", "a", "j")
    text = OWN[request.param]()
    for i, word in enumerate(names):
        text = text.replace(f'"{word}"', f'"{i + 10}"')
    return maps.write(tmp_path / "map.xodr", text)


def test_lanes_are_where_carla_has_them(file: FilePath) -> None:
    distances = compared(file)
    assert len(distances) > 100
    assert max(distances) < (0.01 if file in FILES else 1e-3)


def test_random_ways(file: FilePath) -> None:
    for seed in range(5):
        path = OpenDrivePath(file=file, random=seed, distance=150.0)
        assert path.length == pytest.approx(150.0)
        for s in np.linspace(0.0, 150.0, 50):
            point = path.at(s)
            assert path.project(point.x, point.y, near=s)[1] == pytest.approx(0.0, abs=1e-6)
            assert math.isfinite(point.curvature)


@pytest.mark.parametrize("seed", [4, 7, 8])
@pytest.mark.parametrize("file", [*OWN, *TOWNS], ids=name, indirect=True)
def test_smooth_ways_are_read_back(file: FilePath, seed: int) -> None:
    # Smoothing leaves bends of many kilometres here and there.
    far = 800.0 if file in FILES else 150.0
    path = OpenDrivePath(file=file, random=seed, distance=far, min_radius=8.0, smooth=0.05)
    world = carla_wheel.load().Map(file.stem, opendrive(path))
    for s in np.linspace(1e-3, path.length - 1e-3, 800):
        at = world.get_waypoint_xodr(1, -1, s).transform.location
        assert abs(path.project(at.x, -at.y, near=s)[1]) < 1e-4
