"""Ways through a small town: along roads, between them, and at random."""

from __future__ import annotations

import itertools
import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.config import build
from steersman.errors import ConfigError, DataError
from steersman.paths.base import PathComponent
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.paths.xodr.write import opendrive

from . import xodr_maps as maps
from .xodr_maps import RADIUS, WIDTH

QUARTER = math.pi / 2.0
# Length of the way to the right, in the middle of its lane.
RIGHT = 6.0 + QUARTER * (RADIUS - WIDTH / 2.0)


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    return maps.write(tmp_path_factory.mktemp("town") / "town.xodr", maps.town())


def followed(file: FilePath, **words: Any) -> OpenDrivePath:
    return build(OpenDrivePath, {"file": str(file), **words})


def refused(file: FilePath, **words: Any) -> str:
    with pytest.raises(DataError) as caught:
        _ = followed(file, **words).table
    text = str(caught.value)
    assert text.startswith(f"{file}: ")
    assert "\n" not in text
    return text.removeprefix(f"{file}: ")


def test_between_roads_through_the_junction(town: FilePath) -> None:
    path = followed(town, route=["a", "right"])
    assert not path.closed
    assert path.length == pytest.approx(60.0 + RIGHT + 40.0, abs=1e-6)
    assert path.at(0.0) == pytest.approx((0.0, -WIDTH / 2.0, 0.0, 0.0), abs=1e-9)
    end = path.at(path.length)
    assert end[:3] == pytest.approx((75.0 - WIDTH / 2.0, -55.0, -QUARTER), abs=1e-6)
    assert path.at(75.0).curvature == pytest.approx(-1.0 / (RADIUS - WIDTH / 2.0), abs=1e-6)


@pytest.mark.parametrize(("name", "turned"), [("left", 1.0), ("on", 0.0), ("right", -1.0)])
def test_every_turn(town: FilePath, name: str, turned: float) -> None:
    path = followed(town, route=["a", name])
    assert path.at(path.length).psi == pytest.approx(turned * QUARTER, abs=1e-9)


def test_against_the_way_it_is_laid(town: FilePath) -> None:
    path = followed(town, route=["right", "a"])
    lengths = 40.0 + 43.0 + 63.0 + 60.0 + 3 * QUARTER * (RADIUS - WIDTH / 2.0)
    assert path.length == pytest.approx(lengths, abs=1e-6)
    assert math.remainder(path.at(path.length).psi, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_a_lap(town: FilePath) -> None:
    path = followed(town, route=["a", "a"])
    assert path.closed
    turns = 4 * QUARTER * (RADIUS - WIDTH / 2.0)
    assert path.length == pytest.approx(60.0 + 6.0 + 40.0 + 43.0 + 63.0 + turns, abs=1e-6)
    via = followed(town, route=["a", "back", "a"])
    assert via.length == pytest.approx(path.length)
    shifted = followed(town, route=["right", "right"])
    assert shifted.length == pytest.approx(path.length)
    assert shifted.project(*path.at(0.0)[:2])[1] == pytest.approx(0.0, abs=1e-6)


def test_along_a_road(town: FilePath) -> None:
    assert followed(town, road="a").length == pytest.approx(60.0)
    back = followed(town, road="a", lane=1)
    assert back.at(0.0)[:3] == pytest.approx((60.0, WIDTH / 2.0, math.pi), abs=1e-9)


def test_random_ways_obey_the_links(town: FilePath) -> None:
    ends = set()
    for seed in range(12):
        path = followed(town, random=seed, distance=90.0)
        assert path.length == 90.0
        assert not path.closed
        end = path.at(90.0)
        ends.add((round(end.x, 3), round(end.y, 3)))
        again = followed(town, random=seed, distance=90.0)
        assert np.array_equal(again.table.pieces, path.table.pieces)
    assert len(ends) > 3


def test_no_place_is_taken_twice(town: FilePath) -> None:
    ways = Ways(read_network(town))
    for seed in range(12):
        way = ways.random(seed, 150.0)
        assert len(set(way)) == len(way)
        for a, b in itertools.pairwise(way):
            assert b in ways.graph.after(a)
    # Once around and on to the left or straight on: longer there is none.
    with pytest.raises(DataError, match="no way of 5000 m was found that takes no lane twice; the"):
        ways.random(0, 5000.0)


def test_sharp_bends_are_left_out(town: FilePath) -> None:
    wide = RADIUS + WIDTH / 2.0
    assert followed(town, route=["a", "left"], min_radius=wide - 0.1).length > 0.0
    message = refused(town, route=["a", "left"], min_radius=wide + 0.1)
    assert message == (
        "no lanes lead from road 'a' to 'left' without bends below 13.85 m;"
        " from 'a' these can be reached: a-on, on"
    )
    for seed in range(8):
        path = followed(town, random=seed, distance=70.0, min_radius=11.0)
        assert np.max(np.abs(path.table.pieces[:, 4])) < 1.0 / 11.0 + 1e-6


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"road": "rigth"}, "unknown road 'rigth'; did you mean 'right'?"),
        ({"route": ["a", "zzz"]}, "unknown road 'zzz'; there are: a, a-left, left, a-on, on"),
        ({"road": "a", "lane": -3}, "road 'a' has no lane -3 to drive on; there are: -1, 1"),
        (
            {"route": ["on", "a"]},
            "no lanes lead from road 'on' to 'a'; from 'on' these can be reached: no other road",
        ),
        ({"random": 1, "distance": 1e5}, "no way of 100000 m was found that takes no lane twice;"),
    ],
)
def test_what_is_not_there(town: FilePath, words: dict[str, Any], message: str) -> None:
    assert refused(town, **words).startswith(message)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({}, "give one of road, route, random; given: none"),
        ({"road": "a", "random": 1}, "give one of road, route, random; given: road and random"),
        ({"random": 1, "lane": -1}, "lane goes with road or route, a random way draws its own"),
        ({"route": ["a"]}, "route: ['a'] is not allowed; must have at least 2 values"),
        ({"random": -1}, "random: -1 is not allowed; must be at least 0"),
        ({"road": "a", "sha256": "x"}, "sha256: 'x' is not allowed; must match"),
        ({"roads": "a"}, "roads: unknown field of opendrive; did you mean 'road'?"),
    ],
)
def test_contradictions(town: FilePath, words: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        followed(town, **words)
    assert str(caught.value).startswith(message)


def test_ids_may_be_written_as_numbers(tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "wavy.xodr", maps.wavy())
    assert followed(file, road=1) == followed(file, road="1")
    assert followed(file, road=1).road == "1"


def test_another_file_is_told_by_its_digest(tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "wavy.xodr", maps.wavy())
    assert followed(file, road=1, sha256="0" * 64).sha256 == "0" * 64
    assert "its SHA-256 is" in refused(file, road=1, sha256="0" * 64)


def test_a_changed_file_is_read_again(tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "map.xodr", maps.wavy())
    before = followed(file, road=1).length
    maps.write(file, maps.wavy().replace('id="1"', 'id="2"'))
    assert followed(file, road=2).length == before


def test_what_was_written_is_read_back(path: PathComponent, tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "path.xodr", opendrive(path))
    roads = [str(i + 1) for i in range(opendrive(path).count("<road "))]
    if path.closed:
        again = followed(file, route=[*roads, roads[0]])
    elif len(roads) > 1:
        again = followed(file, route=roads)
    else:
        again = followed(file, road="1")
    assert again.closed == path.closed
    assert again.length == pytest.approx(path.length, abs=1e-4)
    for s in np.linspace(0.0, path.length, 200, endpoint=False):
        there, here = path.at(s), again.at(s * again.length / path.length)
        assert math.dist(here[:2], there[:2]) < 1e-4
        assert math.remainder(here.psi - there.psi, math.tau) == pytest.approx(0.0, abs=1e-4)
        # Within a metre of a corner of its curve, the curvature is that of a fit.
        assert here.curvature == pytest.approx(
            there.curvature, abs=0.01 + 0.05 * abs(there.curvature)
        )
