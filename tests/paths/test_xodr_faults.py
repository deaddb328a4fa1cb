"""One odd element costs that element: the rest of the map is listed, and driven."""

from __future__ import annotations

import contextlib
import itertools
import math
import re
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.errors import DataError
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.segments import Segment, end_pose
from steersman.paths.xodr.check import faults
from steersman.paths.xodr.joined import TOLERANCE, gap
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.types import Pose

from . import xodr_maps as maps
from .xodr_maps import ONE_WAY, cubic, geometry, lane, road, section, whole

LINE = '<geometry s="0" x="0" y="-500" hdg="0" length="200"><line/></geometry>'
SOUND = road("sound", LINE, 200.0, ONE_WAY)
WORDS = ("", "x", "nan", "-1e8", "1e30", "9" * 400, "\u0661")
_TAG = re.compile(r"<(\w+)((?: \w+=\"[^\"]*\")+)(/?)>")


def _town() -> str:
    text = maps.town()
    end = text.rindex("</OpenDRIVE>")
    return text[:end] + SOUND + text[end:]


def _faulty(text: str, rng: np.random.Generator) -> str:
    """The town with one fault, outside of the sound road and the root."""
    until = text.index('<road id="sound"')
    found = [m for m in _TAG.finditer(text, 0, until) if m[1] not in {"OpenDRIVE", "header"}]
    kinds = sorted({match[1] for match in found})
    kind = kinds[int(rng.integers(len(kinds)))]
    of_kind = [match for match in found if match[1] == kind]
    match = of_kind[int(rng.integers(len(of_kind)))]
    pairs = re.findall(r'(\w+)="([^"]*)"', match[2])
    k = int(rng.integers(len(pairs)))
    how = int(rng.integers(4))
    if how == 0:  # one attribute is missing
        del pairs[k]
    elif how == 1:  # the element is another, as a leaf
        return f"{text[: match.start()]}<odd/>{text[match.start() :]}"
    else:  # a word in place of a figure
        pairs[k] = (pairs[k][0], WORDS[int(rng.integers(len(WORDS)))])
    words = "".join(f' {name}="{value}"' for name, value in pairs)
    return f"{text[: match.start(2)]}{words}{text[match.end(2) :]}"


@pytest.mark.parametrize("seed", range(50))
def test_one_fault_costs_its_element(tmp_path: FilePath, seed: int) -> None:
    rng = np.random.default_rng(seed)
    text = _faulty(_town(), rng)
    file = maps.write(tmp_path / "map.xodr", text)
    network = read_network(file)
    assert {"sound"} < set(network.roads)
    assert OpenDrivePath(file=file, road="sound").length == pytest.approx(200.0)
    for fault in faults(Ways(network)):
        assert "\n" not in str(fault)
    path = OpenDrivePath(file=file, random=seed, distance=50.0)
    assert path.length == pytest.approx(50.0)
    with contextlib.suppress(DataError):
        assert OpenDrivePath(file=file, route=("a", "a")).closed


def test_links_lanes_and_roads_are_left_out_one_by_one(tmp_path: FilePath) -> None:
    empty = road("1", LINE, 200.0, ONE_WAY, links="<predecessor/>")
    folded = road("2", *maps.plan([Segment(20.0, -1.0, -1.0)], Pose(0.0, 0.0, 0.0))[:2], ONE_WAY)
    wide = lane(-1, cubic("width", "sOffset", 0.0, 3.0, 0.0, 0.0, 1e9)) + lane(-2)
    short = section(0.0, "", lane(-1)) + section(199.999, "", wide)
    numberless = road("4", LINE, 200.0, section(0.0, "", lane(-1) + lane("x") + lane(-3)))  # type: ignore[arg-type]
    odd = road("5", LINE.replace("<line/>", "<arc/>"), 200.0, ONE_WAY)
    text = whole(empty, folded, road("3", LINE, 200.0, short), numberless, odd, SOUND)
    file = maps.write(tmp_path / "map.xodr", text)
    ways = Ways(read_network(file))
    assert set(ways.network.roads) == {"1", "2", "3", "4", "sound"}
    found = [str(fault) for fault in faults(ways)]
    for part in (
        "road '1': line 3: <predecessor>: elementId is missing; this link is left out",
        "road '2': s = 0.0 m: lane -1: line",
        "road '4': line 6: <lane>: id is 'x', not a whole number; this lane is left out",
        "road '4': line 6: <lane>: lane -3 has no neighbour towards the middle; it is left out",
        "road '5': line 7: <arc>: curvature is missing; this road is left out",
    ):
        assert any(line.startswith(part) for line in found), found
    for name in ("1", "3", "4", "sound"):
        assert OpenDrivePath(file=file, road=name).length == pytest.approx(200.0, abs=0.5)
    told = OpenDrivePath(file=file, road="1").notes()
    assert len(told) == 4
    assert "elementId is missing; this link is left out" in told[0]
    with pytest.raises(DataError, match=r"road '2': s = 0\.0 m: .*'steersman path check' lists"):
        _ = OpenDrivePath(file=file, road="2").table
    for seed in range(5):
        assert OpenDrivePath(file=file, random=seed, distance=100.0).length == pytest.approx(100.0)


@pytest.mark.parametrize(("length", "driven"), [(500.0, 200.0), (150.0, 150.0)])
def test_a_road_is_as_long_as_its_geometries_at_most(
    tmp_path: FilePath, length: float, driven: float
) -> None:
    lanes = section(0.0, "", lane(-1)) + section(120.0, "", lane(-1)) + section(300.0, "", lane(-1))
    lanes = lanes.replace("<link></link>", f"<link>{maps.goes_on(-1)}</link>")
    file = maps.write(tmp_path / "map.xodr", whole(road("1", LINE, length, lanes)))
    path = OpenDrivePath(file=file, road="1")
    assert path.length == pytest.approx(driven)
    assert f"what is beyond {driven:g} m is left out" in path.notes()[0]


def test_elements_are_taken_in_the_order_of_s(tmp_path: FilePath) -> None:
    bends = [Segment(40.0, 0.0, 0.0), Segment(30.0, 0.0, 0.02), Segment(40.0, 0.02, 0.02)]
    view, length, _ = maps.plan(bends, Pose(1.0, 2.0, 0.3))
    pieces = re.findall(r"<geometry.*?</geometry>", view)
    sections = [
        section(s, "", lane(-1, cubic("width", "sOffset", 0.0, 3.0 + 0.01 * s), maps.goes_on(-1)))
        for s in (0.0, 5.0, 60.0)
    ]
    tables, notes = [], []
    for order in itertools.permutations(range(3)):
        text = road(
            "1", "".join(pieces[i] for i in order), length, "".join(sections[i] for i in order)
        )
        path = OpenDrivePath(file=maps.write(tmp_path / f"{order}.xodr", whole(text)), road="1")
        tables.append(path.table.pieces)
        notes.append(len(path.notes()))
    assert all(np.array_equal(table, tables[0]) for table in tables)
    assert notes == [0, *[2] * 5]  # geometries, sections


def test_a_lane_with_several_links_goes_on_where_one_joins(tmp_path: FilePath) -> None:
    """The inner lane begins without a width; the outer one continues the single lane."""
    links = '<successor id="-1"/><successor id="-2"/>'
    grows = lane(-1, cubic("width", "sOffset", 0.0, 0.0, maps.WIDTH / 110.0)) + lane(-2)
    lanes = section(0.0, "", lane(-1, links=links)) + section(90.0, "", grows)
    ahead = geometry(0.0, Pose(200.0, -500.0, 0.0), 50.0, "<line/>")
    pairs = "".join(f'<laneLink from="-2" to="{to}"/>' for to in (-1, -2))
    attributes = 'id="1" incomingRoad="1" connectingRoad="2" contactPoint="start"'
    text = whole(
        road("1", LINE, 200.0, lanes, maps.to("successor", "junction", "j")),
        road("2", ahead, 50.0, section(0.0, "", lane(-1) + lane(-2))),
        f'<junction id="j"><connection {attributes}>{pairs}</connection></junction>',
    )
    file = maps.write(tmp_path / "map.xodr", text)
    assert OpenDrivePath(file=file, road="1").length == pytest.approx(200.0, abs=0.5)
    assert OpenDrivePath(file=file, route=("1", "2"), lane_change=0.0).length == pytest.approx(
        250.0, abs=0.5
    )


@pytest.mark.parametrize("seed", range(6))
def test_a_map_whose_every_metre_has_its_kink_is_driven(tmp_path: FilePath, seed: int) -> None:
    """Short pieces of an arc, each a little turned and a little moved."""
    rng = np.random.default_rng(seed)
    radius, step, rows = 9.0, 1.1, []
    for k in range(20):
        psi = k * step / radius
        aside, turned = rng.uniform(-0.02, 0.02), psi + rng.uniform(-0.05, 0.05)
        x, y = (radius - aside) * math.sin(psi), radius - (radius - aside) * math.cos(psi)
        shape = f'<arc curvature="{1 / radius}"/>'
        rows.append(geometry(k * step, Pose(x, y, turned), step, shape))
    file = maps.write(tmp_path / "map.xodr", whole(road("1", "".join(rows), 20 * step, ONE_WAY)))
    path = OpenDrivePath(file=file, road="1")
    outer = radius + 0.5 * maps.WIDTH
    assert path.length == pytest.approx(20 * step * outer / radius, rel=0.03)
    at = [path.at(s) for s in np.linspace(0.0, path.length, 50)]
    away = [math.hypot(point.x, point.y - radius) - outer for point in at]
    assert np.abs(away).max() < 0.15


def _kinked(kink: float, size: float, count: int) -> str:
    """Straight pieces that meet with a kink each."""
    sizes, psi, s, rows = [20.0, *[size] * (count - 1), 20.0], 0.0, 0.0, []
    start = Pose(0.0, 0.0, 0.0)
    for length in sizes:
        rows.append(geometry(s, start, length, "<line/>"))
        end = end_pose([Segment(length, 0.0, 0.0)], start)
        psi += kink
        s, start = s + length, Pose(end.x, end.y, psi)
    return whole(road("1", "".join(rows), s, ONE_WAY))


@pytest.mark.parametrize("kink", [0.05, 0.15, -0.199])
@pytest.mark.parametrize(("size", "count"), [(0.4, 1), (5.0, 2), (0.6, 2), (0.7, 4)])
def test_kinks_are_rounded(tmp_path: FilePath, kink: float, size: float, count: int) -> None:
    file = maps.write(tmp_path / "map.xodr", _kinked(kink, size, count))
    sharp = Ways(read_network(file))
    lines = sharp.lines(sharp.graph.all())
    path = OpenDrivePath(file=file, road="1")
    rows = np.array([path.at(s)[:2] for s in np.linspace(0.0, path.length, 2000)])
    ends = path.at(path.length)[2] - path.at(0.0)[2]
    assert ends == pytest.approx(kink * count, abs=1e-3)
    # Both pieces' tangents cross at the corner, which the path passes within the tolerance.
    for a, b in itertools.pairwise(lines):
        found = gap(a, b)
        u = found.ahead - found.aside / math.tan(found.kink)
        corner = a.x[-1] + u * math.cos(a.psi[-1]), a.y[-1] + u * math.sin(a.psi[-1])
        assert float(np.min(np.hypot(*(rows - corner).T))) < TOLERANCE + 0.01
    gentle = OpenDrivePath(file=file, road="1", smooth=0.5)
    assert gentle.length == pytest.approx(path.length, abs=0.3)
    told = [fault.text for fault in faults(sharp)]
    assert len(told) == count
    assert all("rounded within 0.1 m" in text for text in told)


def test_a_kink_without_room_is_told_by_its_place(tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "map.xodr", _kinked(-0.199, 0.4, 2))
    with pytest.raises(DataError, match=r"s = 19\.8 m: a kink of -0\.20 rad has no room"):
        _ = OpenDrivePath(file=file, road="1").table


def test_a_fold_within_a_road_is_told_by_its_place(tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "map.xodr", _kinked(0.5, 10.0, 1))
    ways = Ways(read_network(file))
    [fault] = faults(ways)
    assert (fault.road, fault.s) == ("1", pytest.approx(20.0))
    assert "turned by 0.50 rad; the map does not join here" in fault.text
    for words in ({"road": "1"}, {"random": 0, "distance": 30.0}):
        with pytest.raises(DataError):
            _ = OpenDrivePath(file=file, **words).table  # type: ignore[arg-type]
    assert math.isfinite(fault.s or 0.0)


def test_a_map_of_faults_is_told_in_a_thousand_lines(tmp_path: FilePath) -> None:
    file = tmp_path / "many.xodr"
    file.write_text(maps.whole(SOUND + "<road/>" * 1500))
    network = read_network(file)
    assert set(network.roads) == {"sound"}
    assert len(network.left_out) == 1001
    assert network.left_out[-1].text == "500 more elements left out"
