"""Paths from GPX and GeoJSON: the right line, in metres; what is no line is refused."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.errors import DataError
from steersman.paths.base import PathComponent
from steersman.paths.csv_path import CsvPath
from steersman.paths.geo_path import GeoJsonPath, GpxPath

from .conftest import degrees, ellipse, gpx, write_csv

SHORT = [(float(3 * i), 0.5 * i) for i in range(8)]


def written(file: FilePath, text: str) -> FilePath:
    file.write_text(text, encoding="utf-8")
    return file


def collection(*geometries: dict[str, Any], **more: Any) -> str:
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    return json.dumps({"type": "FeatureCollection", "features": features, **more})


def line(points: list[tuple[float, float]], kind: str = "LineString") -> dict[str, Any]:
    places = [[*degrees(x, y)[::-1], 5.0] for x, y in points]
    return {"type": kind, "coordinates": places if kind == "LineString" else [places]}


@pytest.mark.parametrize("kind", ["trk", "rte"])
def test_the_longest_line_of_a_gpx_file(tmp_path: FilePath, kind: str) -> None:
    file = written(tmp_path / "a.gpx", gpx(SHORT, ellipse(), kind=kind))
    path = GpxPath(file=file)
    same_shape(path, CsvPath(file=write_csv(tmp_path / "a.csv", ellipse())))
    assert "line 2 of 2 in the file (path.number)" in path.notes()
    assert GpxPath(file=file, number=1).length == pytest.approx(21.3, rel=0.01)
    with pytest.raises(DataError, match="number 3 is not among its 2 lines"):
        _ = GpxPath(file=file, number=3).table


def same_shape(path: PathComponent, other: PathComponent) -> None:
    assert path.closed == other.closed
    # A sphere for the degrees here, WGS 84 there.
    assert path.length == pytest.approx(other.length, rel=0.004)
    for share in (0.1, 0.35, 0.8):
        at, there = path.at(share * path.length), other.at(share * other.length)
        assert at.curvature == pytest.approx(there.curvature, rel=0.03)


@pytest.mark.parametrize("kind", ["LineString", "MultiLineString", "Polygon"])
def test_lines_of_geojson(tmp_path: FilePath, kind: str) -> None:
    point = {"type": "Point", "coordinates": [11.0, 48.0]}
    file = written(tmp_path / "a.geojson", collection(line(SHORT), point, line(ellipse(), kind)))
    path = GeoJsonPath(file=file)
    assert path.closed
    same_shape(path, CsvPath(file=write_csv(tmp_path / "a.csv", ellipse())))


def test_a_file_in_metres(tmp_path: FilePath) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    places = [[691000.0 + x, 5334000.0 + y] for x, y in ellipse()]
    text = collection({"type": "LineString", "coordinates": places}, crs=crs)
    path = GeoJsonPath(file=written(tmp_path / "a.geojson", text))
    plain = CsvPath(file=write_csv(tmp_path / "a.csv", ellipse()))
    assert path.length == pytest.approx(plain.length, abs=1e-5)
    assert path.at(0.0)[:2] == pytest.approx((691080.0, 5334000.0))


BOMB = '<?xml version="1.0"?><!DOCTYPE gpx [<!ENTITY a SYSTEM "file:///etc/passwd">]><gpx>&a;</gpx>'


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.gpx", "", "is empty; give a GPX file"),
        ("a.gpx", "<gpx><trk>", "line 1: not valid XML"),
        ("a.gpx", BOMB, "has a document type"),
        ("a.gpx", "<gpx><wpt lat='1' lon='2'/></gpx>", "holds no line of at least 2 points"),
        ("a.gpx", gpx(SHORT).replace('lat="', 'lat="x', 1), "lat is 'x48.000000000', not a number"),
        ("a.gpx", gpx(SHORT).replace('lat="48', 'lat="148', 1), "is no latitude and longitude"),
        ("a.geojson", "{", "not valid JSON"),
        ("a.geojson", "[" * 9000, "not valid JSON"),
        ("a.geojson", "[1, 2]", "holds no line"),
        ("a.geojson", collection(), "holds no line"),
        (
            "a.geojson",
            '{"type": "LineString", "coordinates": [[1, 2], "x"]}',
            "position 2 of a line",
        ),
        ("a.geojson", '{"type": "LineString", "coordinates": [[1, NaN], [1, 2]]}', "position 1"),
        ("a.geojson", '{"type": "LineString", "coordinates": 5}', "holds no line"),
        ("a.geojson", '{"type": [], "coordinates": [[1, 2], [3, 4]]}', "holds no line"),
    ],
)
def test_what_is_no_line_is_refused(tmp_path: FilePath, name: str, text: str, words: str) -> None:
    file = written(tmp_path / name, text)
    path = GpxPath(file=file) if file.suffix == ".gpx" else GeoJsonPath(file=file)
    with pytest.raises(DataError) as caught:
        _ = path.table
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("latitude", [8.0100000000005, -18.1002, 89.0, 48.1001])
@pytest.mark.parametrize("longitude", [11.50001, -170.0])
def test_stray_points_are_a_message(tmp_path: FilePath, latitude: float, longitude: float) -> None:
    """Thousands of kilometres beside metres: the equations of the smoothing are singular there."""
    line = [[11.5 + 1e-5 * k * k, 48.1 + 1e-4 * k] for k in range(6)] + [[11.50361, 48.1019]]
    line[1] = [longitude, latitude]
    line[2][1], line[5][1] = -18.1002, 4.101800000000004
    file = tmp_path / "line.geojson"
    geometry = {"type": "LineString", "coordinates": line}
    file.write_text(json.dumps({"type": "Feature", "geometry": geometry}))
    with pytest.raises(DataError, match=r"line\.geojson"):
        GeoJsonPath(file=file).table  # noqa: B018 - reading it is the test
