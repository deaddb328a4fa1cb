"""Paths along the lanelets of small maps, drawn here."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import pytest

from steersman.errors import ConfigError, DataError
from steersman.paths.lanelet2_path import Lanelet2Path, read_lanelets
from steersman.words import fields_of

from .conftest import degrees

pytest.importorskip("lanelet2", reason="the extra lanelet2 has wheels for Linux on x86-64 alone")
RADIUS, WIDTH, STEP = 60.0, 3.0, 0.1
Place = tuple[float, float]


def arc(radius: float, begin: float, end: float) -> list[Place]:
    """Points of a left bend about (0, RADIUS), between two angles."""
    count = round((end - begin) / STEP)
    angles = [begin + STEP * k for k in range(count + 1)]
    return [(radius * math.sin(a), RADIUS - radius * math.cos(a)) for a in angles]


def osm(pieces: dict[int, tuple[list[Place], list[Place]]], *, local: bool = False) -> str:
    """A map of lanelets by id, each with its left and its right edge; near points are one node."""
    nodes: dict[tuple[int, int], int] = {}
    ways, relations = "", ""
    for name, edges in pieces.items():
        members = ""
        for role, edge in zip(("left", "right"), edges, strict=True):
            refs = [
                nodes.setdefault((round(100 * x), round(100 * y)), 10**11 + len(nodes))
                for x, y in edge
            ]
            way = 10 * name + (role == "left")
            inner = "".join(f'<nd ref="{ref}"/>' for ref in refs)
            ways += f'<way id="{way}">{inner}<tag k="type" v="line_thin"/></way>\n'
            members += f'<member type="way" ref="{way}" role="{role}"/>'
        tags = {"type": "lanelet", "subtype": "road", "location": "urban", "one_way": "yes"}
        more = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        relations += f'<relation id="{name}">{members}{more}</relation>\n'
    points = ""
    for (x, y), name in nodes.items():
        lat, lon = (0.0, 0.0) if local else degrees(x / 100, y / 100)
        tags = f'<tag k="local_x" v="{x / 100}"/><tag k="local_y" v="{y / 100}"/>' if local else ""
        points += f'<node id="{name}" lat="{lat:.10f}" lon="{lon:.10f}">{tags}</node>\n'
    return f'<?xml version="1.0"?>\n<osm version="0.6">\n{points}{ways}{relations}</osm>\n'


def bend() -> dict[int, tuple[list[Place], list[Place]]]:
    """Two lanelets of a bend, one beside the second, and one that leads away from the first."""
    inner, middle, outer = RADIUS - WIDTH, RADIUS, RADIUS + WIDTH
    return {
        11: (arc(inner, 0.0, 0.5), arc(middle, 0.0, 0.5)),
        12: (arc(inner, 0.5, 1.2), arc(middle, 0.5, 1.2)),
        13: (arc(middle, 0.5, 1.2), arc(outer, 0.5, 1.2)),
    }


def written(folder: FilePath, text: str) -> FilePath:
    file = folder / "map.osm"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("local", [False, True])
def test_a_route_follows_the_centres(tmp_path: FilePath, local: bool) -> None:
    file = written(tmp_path, osm(bend(), local=local))
    path = Lanelet2Path(file=file, route=(11, 12))
    centre = RADIUS - WIDTH / 2.0
    assert path.length == pytest.approx(1.2 * centre, rel=0.01)
    assert path.at(0.5 * path.length).curvature == pytest.approx(1.0 / centre, rel=0.05)
    one = Lanelet2Path(file=file, route=(12,))
    assert one.length == pytest.approx(0.7 * centre, rel=0.01)
    if local:
        assert path.notes()[0] == "x and y are local_x and local_y of the map"
        at = path.at(0.3 * path.length)
        assert math.hypot(at.x, at.y - RADIUS) == pytest.approx(centre, abs=0.1)


def test_lanelets_are_listed_with_what_they_lead_to(tmp_path: FilePath) -> None:
    rows = read_lanelets(written(tmp_path, osm(bend()))).lanelets
    assert set(rows) == {"11", "12", "13"}
    assert rows["11"].leads_to == ["12"]
    assert rows["12"].leads_to == rows["13"].leads_to == []
    assert rows["13"].length == pytest.approx(0.7 * (RADIUS + WIDTH / 2.0), rel=0.01)
    assert rows["11"].subtype == "road"


@pytest.mark.parametrize(
    ("route", "old", "new", "message"),
    [
        ((99,), "", "", "unknown lanelet 99; allowed: 11, 12, 13"),
        ((12, 11), "", "", "no lanelets lead from 12 to 11 without a change of lane"),
        ((11, 13), "", "", "no lanelets lead from 11 to 13 without a change of lane"),
        ((11,), '"lanelet"', '"multipolygon"', "holds no lanelet (a relation of type lanelet)"),
        (
            (11,),
            '<way id="110"',
            '<way id="7"',
            "Lanelet2's library cannot read it: it ends abruptly",
        ),
        ((11,), "osm", "gpx", "this is no Lanelet2 map, whose first element is <osm>"),
        ((11,), '<?xml version="1.0"?>', "<!DOCTYPE a [<!ENTITY b 'c'>]>", "document type"),
        ((11,), 'lat="', 'lat="x', "lat is 'x"),
        ((11,), "</osm>", "", "not valid XML"),
    ],
)
def test_what_is_no_lanelet(
    tmp_path: FilePath, route: tuple[int, ...], old: str, new: str, message: str
) -> None:
    file = written(tmp_path, osm(bend()).replace(old, new) if old else osm(bend()))
    with pytest.raises(DataError) as caught:
        _ = Lanelet2Path(file=file, route=route).table
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_missing_is_named(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    file = written(tmp_path, osm(bend()))
    with pytest.raises(ValueError, match=r"'steersman path roads .*map\.osm' lists them"):
        Lanelet2Path(file=file)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match="the extra 'lanelet2'"):
        _ = Lanelet2Path(file=file, route=(11,)).table


def test_other_maps_are_told_what_to_become(tmp_path: FilePath) -> None:
    file = tmp_path / "scenario.xml"
    file.write_text("<commonRoad/>", encoding="utf-8")
    with pytest.raises(DataError, match=r"expected a file that ends in .*become OpenDRIVE first"):
        fields_of("path", str(file))
