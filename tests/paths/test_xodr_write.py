"""Paths written as OpenDRIVE: geometry fits together, and CARLA's own reader drives them."""

from __future__ import annotations

import itertools
import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from steersman.kernels.path import PathTable
from steersman.paths.analytic import Circle, Straight
from steersman.paths.base import PathComponent
from steersman.paths.segments import Segment, end_pose, from_segments
from steersman.paths.tracks import Monza
from steersman.paths.xodr.write import Shape, cut, opendrive, shapes
from steersman.types import Pose

from .. import carla_wheel

# Joined shapes and rounded cuts may be apart by so much [m].
SMALL = 3e-6


def end(shape: Shape, part: float = 1.0) -> Pose:
    """Where a shape is after a part of its length."""
    bend = shape.kappa_start + part * (shape.kappa_end - shape.kappa_start)
    return end_pose([Segment(part * shape.length, shape.kappa_start, bend)], shape.start)


class Bend(PathComponent):
    """A bend of one radius between short straights."""

    radius: float
    """[m]; negative: to the right."""
    bend: float
    """Arc length [m]."""

    def build_table(self) -> PathTable:
        straight = Segment(1.0, 0.0, 0.0)
        kappa = 1.0 / self.radius
        return from_segments([straight, Segment(self.bend, kappa, kappa), straight])


def angle(a: float, b: float) -> float:
    return abs(math.remainder(a - b, math.tau))


def test_shapes_lie_on_the_path(path: PathComponent) -> None:
    for shape in shapes(path.table):
        for part in (0.25, 0.5, 1.0 - 1e-12):
            there, here = path.at(shape.s + part * shape.length), end(shape, part)
            assert math.dist(here[:2], there[:2]) < SMALL
            assert angle(here.psi, there.psi) < 1e-5


def test_shapes_cover_the_path(path: PathComponent) -> None:
    row = shapes(path.table)
    assert row[0].s == 0.0
    for a, b in itertools.pairwise(row):
        assert a.s + a.length == pytest.approx(b.s, abs=1e-9)
    assert row[-1].s + row[-1].length == pytest.approx(path.length, abs=1e-9)


def test_shapes_are_those_of_the_track() -> None:
    monza = Monza()
    row = shapes(monza.table)
    # A straight that is too long for one shape becomes two.
    assert len(monza.segments()) <= len(row) <= len(monza.segments()) + 4
    assert all(abs(s.kappa_end - s.kappa_start) > 1e-4 for s in row if s.kappa_start != s.kappa_end)


def test_what_bends_by_less_than_a_micrometre_is_no_spiral() -> None:
    almost = [Segment(100.0, 1e-11, 2e-11), Segment(100.0, 0.02, 0.02 + 1e-11)]
    line, arc = shapes(from_segments(almost))
    assert line[3:] == (0.0, 0.0)
    assert arc.kappa_start == arc.kappa_end == pytest.approx(0.02)


def test_cutting_keeps_the_curve(path: PathComponent) -> None:
    low, high = 0.31 * path.length, 0.62 * path.length
    row = cut(shapes(path.table), low, high)
    assert row[0].s == pytest.approx(0.0, abs=1e-6)
    assert math.dist(row[0].start[:2], path.at(low)[:2]) < SMALL
    assert row[-1].s + row[-1].length == pytest.approx(high - low, abs=2e-6)
    assert math.dist(end(row[-1])[:2], path.at(high)[:2]) < SMALL


def geometries(road: ET.Element) -> list[Shape]:
    rows = []
    for geometry in road.iter("geometry"):
        s, x, y, hdg, length = (
            float(geometry.get(key, "nan")) for key in ("s", "x", "y", "hdg", "length")
        )
        shape = geometry[0]
        constant = shape.get("curvature", "0")
        bends = [float(shape.get(key, constant)) for key in ("curvStart", "curvEnd")]
        assert (shape.tag == "spiral") == (bends[0] != bends[1])
        assert (shape.tag == "line") == (bends == [0.0, 0.0])
        rows.append(Shape(s, Pose(x, y, hdg), length, bends[0], bends[1]))
    return rows


def test_geometries_join(path: PathComponent) -> None:
    roads = ET.fromstring(opendrive(path)).findall("road")
    rows = [row for road in roads for row in geometries(road)]
    pairs = list(itertools.pairwise([*rows, rows[0]] if path.closed else rows))
    for a, b in pairs:
        assert math.dist(end(a)[:2], b.start[:2]) < SMALL
        assert angle(end(a).psi, b.start.psi) < 1e-5
        # As continuous as the path itself: fitted curves jump by a little.
        assert a.kappa_end == pytest.approx(b.kappa_start, abs=1e-4)
    for road in roads:
        shape = geometries(road)[-1]
        assert shape.s + shape.length == pytest.approx(float(road.get("length", "nan")), abs=2e-6)
    assert sum(float(road.get("length", "nan")) for road in roads) == pytest.approx(path.length)


def test_roads_and_lanes_are_linked(path: PathComponent) -> None:
    roads = ET.fromstring(opendrive(path)).findall("road")
    # CARLA's next() ends at the joint of a closed road that is made of fewer.
    assert len(roads) >= (3 if path.closed else 1)
    names = [road.get("id") for road in roads]
    after = dict(zip(names, [*names[1:], names[0] if path.closed else None], strict=True))
    before = {b: a for a, b in after.items()}
    for road in roads:
        for side, other, contact in (
            ("predecessor", before.get(road.get("id")), "end"),
            ("successor", after[road.get("id")], "start"),
        ):
            link = road.find(f"link/{side}")
            found = None if link is None else (link.get("elementId"), link.get("contactPoint"))
            assert found == (None if other is None else (other, contact))
            for lane in road.iter("lane"):
                if lane.get("id") != "0":
                    there = lane.find(f"link/{side}")
                    assert there is not None
                    assert there.get("id") == lane.get("id")


def test_same_path_same_file() -> None:
    assert opendrive(Circle(), "ring") == opendrive(Circle(), "ring")
    assert 'name="a&amp;&lt;b&quot;"' in opendrive(Circle(), 'a&<b"')


def test_without_shoulders() -> None:
    root = ET.fromstring(opendrive(Straight(), lane_width=3.0, shoulder=0.0))
    assert [lane.get("id") for lane in root.iter("lane")] == ["0", "-1"]
    offset = root.find("road/lanes/laneOffset")
    assert offset is not None
    assert offset.get("a") == "1.5"


def test_carla_finds_the_path_in_the_middle_of_its_lane(path: PathComponent) -> None:
    text = opendrive(path)
    world = carla_wheel.load().Map("path", text)
    roads = text.count("<road ")
    starts = [path.length * i / roads for i in range(roads)]
    for s in np.linspace(0.0, path.length - 1e-3, 400):
        road = min(int(s / path.length * roads), roads - 1)
        found = world.get_waypoint_xodr(road + 1, -1, s - starts[road])
        place = found.transform.location
        there = path.at(s)
        # CARLA is left-handed; its figures have single precision.
        assert math.dist((place.x, -place.y), there[:2]) < 1e-3
        assert angle(-math.radians(found.transform.rotation.yaw), there.psi) < 1e-4
        assert found.lane_width == pytest.approx(4.0)


@pytest.mark.parametrize("radius", [900.0, -1100.0, 8e3, -31e3, 3e5, 1e7, -1e9])
@pytest.mark.parametrize("length", [0.05, 3.0, 60.0, 700.0])
def test_carla_finds_bends_of_any_radius(radius: float, length: float) -> None:
    # CARLA turns arcs about their centre in single precision: 2 mm at 31 km.
    path = Bend(radius=radius, bend=length)
    for shape in shapes(path.table):
        for part in (0.5, 1.0 - 1e-12):
            assert (
                math.dist(end(shape, part)[:2], path.at(shape.s + part * shape.length)[:2]) < 1e-6
            )
    assert distance_in_carla(path, 100) < 1e-4


def distance_in_carla(path: PathComponent, points: int) -> float:
    """How far CARLA's lane centre is from an open path of at most a road, at most [m]."""
    text = opendrive(path)
    assert text.count("<road ") == 1
    world = carla_wheel.load().Map("path", text)
    found = []
    for s in np.linspace(1e-3, path.length - 1e-3, points):
        place = world.get_waypoint_xodr(1, -1, s).transform.location
        found.append(math.dist((place.x, -place.y), path.at(s)[:2]))
    return max(found)


def test_carla_drives_all_the_way(path: PathComponent) -> None:
    world = carla_wheel.load().Map("path", opendrive(path))
    here = world.get_waypoint_xodr(1, -1, 0.0)
    step = path.length / math.ceil(path.length)
    steps = math.ceil(path.length)
    for i in range(1, steps + 1):
        ahead = here.next(step if i < steps or path.closed else step - 1e-3)
        assert len(ahead) == 1
        here = ahead[0]
        there = path.at(i * step)
        place = here.transform.location
        assert math.dist((place.x, -place.y), there[:2]) < 0.02


def test_carla_knows_the_geographic_reference(capfd: pytest.CaptureFixture[str]) -> None:
    carla_wheel.load().Map("path", opendrive(Circle()))
    told = capfd.readouterr()
    assert (told.out, told.err) == ("", "")
