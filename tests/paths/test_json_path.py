"""Paths from JSON files, in the shapes in which programs write tracks."""

from __future__ import annotations

import json
import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.errors import DataError
from steersman.paths.json_path import JsonPath

ANGLES = np.linspace(0.0, math.tau, 60, endpoint=False)
X, Y = (30.0 * np.cos(ANGLES)).tolist(), (20.0 * np.sin(ANGLES)).tolist()
V = (5.0 + np.cos(ANGLES)).tolist()
LINE = [
    {"x_m": x, "y_m": y, "vx_mps": v, "id": k}
    for k, (x, y, v) in enumerate(zip(X, Y, V, strict=True))
]
SHAPES: dict[str, Any] = {
    "lists": {"X": X, "Y": Y, "speed": V, "name": "oval", "X_i": X, "bounds": [1, 2]},
    "objects": LINE,
    "pairs": [[x, y, 0.0] for x, y in zip(X, Y, strict=True)],
    "nested": {"info": {"data": "x"}, "map": {"wpnts": LINE, "markers": LINE[:9]}},
    "poses": [
        {"pose": {"position": {"x": x, "y": y}}, "id": "a"} for x, y in zip(X, Y, strict=True)
    ],
    "kilometres": {"track": {"east_km": [x / 1e3 for x in X], "north_km": [y / 1e3 for y in Y]}},
    "earth": {"lat": [49.0 + y / 111.2e3 for y in Y], "lon": [9.0 + x / 73.1e3 for x in X]},
    "reference": {"pos_x": X, "pos_y": Y, "ref_v": V, "ref_yaw": V},
}


def written(folder: FilePath, data: Any) -> FilePath:
    file = folder / "track.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    return file


@pytest.mark.parametrize("shape", SHAPES)
def test_points_are_found_in_every_shape(tmp_path: FilePath, shape: str) -> None:
    path = JsonPath(file=written(tmp_path, SHAPES[shape]))
    assert path.closed
    assert path.length == pytest.approx(158.6, abs=1.0)
    first = path.at(0.0)
    assert path.project(first.x, first.y + 1.0)[0] == pytest.approx(1.0, abs=0.1)
    has = {"lists", "objects", "nested", "reference"}
    assert (path.speeds() is not None) == (shape in has)
    if shape == "nested":
        assert path.notes() == ("table 1 of 2, map.wpnts (path.number)",)
        with pytest.raises(DataError, match="number 3 is not among its 2 tables"):
            _ = JsonPath(file=path.file, number=3).table


def test_other_names_are_given(tmp_path: FilePath) -> None:
    file = written(tmp_path, {"a": X, "b": Y})
    assert JsonPath(file=file, columns="x=a,y=-b").at(0.0).psi == pytest.approx(
        -math.pi / 2, abs=0.1
    )
    with pytest.raises(DataError, match="no column 'c' for y"):
        _ = JsonPath(file=file, columns="x=a,y=c").table


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({}, "holds no lists x and y, no list of objects with x and y and none of pairs"),
        (7, "holds no lists"),
        ({"x": [1, 2], "y": [1, 2, 3]}, "holds no lists"),
        ({"x": [0, "far", 2], "y": [1, 2, 3]}, "holds no lists"),
        ({"x": [0, 1, 2], "y": [0, None, 3]}, "track.json, point 2: y is missing"),
        ({"x": [0, 1e300, 2], "y": [0, 0, 0]}, "point 2: (1e+300, 0) is too far"),
        ({"type": "FeatureCollection", "features": []}, "is GeoJSON; write path=geojson"),
        ([{"x": 1, "y": 2}], "holds no lists"),
        ({"x": [0.0], "y": [0.0]}, "holds no lists"),
    ],
)
def test_what_is_no_track(tmp_path: FilePath, data: Any, message: str) -> None:
    with pytest.raises(DataError) as caught:
        _ = JsonPath(file=written(tmp_path, data)).table
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("smoothing", [0.0, "auto"])
@pytest.mark.parametrize("count", [2, 3, 4])
def test_few_points_are_a_path(tmp_path: FilePath, count: int, smoothing: Any) -> None:
    points = [(40.0 * k, 3.0 * k * (k - 1)) for k in range(count)]
    file = written(tmp_path, points)
    path = JsonPath(file=file, smoothing=smoothing)
    assert not path.closed
    for x, y in points:
        assert path.project(x, y)[1] == pytest.approx(0.0, abs=1e-3)
    told = f"{count} points show no noise: not smoothed"
    assert path.notes() == ((told,) if smoothing else ())
    if count < 3:
        assert path.length == pytest.approx(40.0)
        with pytest.raises(DataError, match="a closed path needs at least 3 different points"):
            _ = JsonPath(file=file, loop=True).table
