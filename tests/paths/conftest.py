"""Every kind of path, in several shapes."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path as FilePath

import pytest

from steersman.config import resolve
from steersman.paths.analytic import FigureEight
from steersman.paths.base import PathComponent
from steersman.paths.xodr.write import opendrive

from ..logs import bags
from . import xodr_maps

SHAPES: dict[str, dict[str, object]] = {
    "straight": {"kind": "straight"},
    "circle": {"kind": "circle"},
    "circle-right": {"kind": "circle", "radius": 6.0, "direction": "right"},
    "training_circuit": {"kind": "training_circuit"},
    "training_circuit-reverse-mirror": {
        "kind": "training_circuit",
        "reverse": True,
        "mirror": True,
    },
    "monza": {"kind": "monza"},
    "monza-reverse": {"kind": "monza", "reverse": True},
    "lemniscate": {"kind": "lemniscate"},
    "lemniscate-small": {"kind": "lemniscate", "size": 8.0},
    "figure_eight": {"kind": "figure_eight"},
    "double_lane_change": {"kind": "double_lane_change"},
    "double_lane_change-right": {"kind": "double_lane_change", "direction": "right"},
    "random_road": {"kind": "random_road"},
    "random_road-7": {"kind": "random_road", "seed": 7, "straights": 0.0},
    "clothoid_road": {"kind": "clothoid_road"},
    "harmonic_road": {"kind": "harmonic_road", "seed": 3},
    "spline_road": {"kind": "spline_road", "seed": 1},
    "surveyed_road": {"kind": "surveyed_road"},
    "csv-closed": {"kind": "csv", "file": "ellipse.csv"},
    "csv-open": {"kind": "csv", "file": "wave.csv"},
    "csv-smooth": {"kind": "csv", "file": "ellipse.csv", "smoothing": 0.05},
    "gpx": {"kind": "gpx", "file": "wave.gpx"},
    "geojson": {"kind": "geojson", "file": "wave.geojson"},
    "mcap-lap": {"kind": "mcap", "file": "lap.mcap"},
    "mcap-planned": {"kind": "mcap", "file": "plan.mcap"},
    "opendrive-road": {"kind": "opendrive", "file": "wavy.xodr", "road": "1"},
    "opendrive-lap": {"kind": "opendrive", "file": "ring.xodr", "route": ["1", "2", "1"]},
    "opendrive-smooth": {
        "kind": "opendrive",
        "file": "town.xodr",
        "route": ["right", "left"],
        "smooth": 0.05,
    },
    "opendrive-random": {
        "kind": "opendrive",
        "file": "wavy.xodr",
        "random": 3,
        "distance": 100.0,
    },
}
CROSSING = ("lemniscate", "figure_eight", "opendrive-lap")


def write_csv(file: FilePath, points: list[tuple[float, float]], header: str = "x,y") -> FilePath:
    """A CSV file with these points."""
    rows = [f"{x!r},{y!r}" for x, y in points]
    file.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return file


def ellipse(count: int = 60) -> list[tuple[float, float]]:
    """Points of an ellipse of 80 m by 50 m, driven to the left; the first is not repeated."""
    angles = [math.tau * i / count for i in range(count)]
    return [(80.0 * math.cos(a), 50.0 * math.sin(a)) for a in angles]


def degrees(x: float, y: float) -> tuple[float, float]:
    """Latitude and longitude of a point near 48 degrees north, 11 degrees east (on a sphere)."""
    scale = math.degrees(1.0 / 6371e3)
    return 48.0 + scale * y, 11.0 + scale * x / math.cos(math.radians(48.0))


def gpx(*tracks: list[tuple[float, float]], kind: str = "trk") -> str:
    """A GPX file with these tracks, or routes; points in metres."""
    point = {"trk": "trkpt", "rte": "rtept"}[kind]
    text = '<?xml version="1.0"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">'
    for track in tracks:
        places = [degrees(x, y) for x, y in track]
        rows = [f'<{point} lat="{a:.9f}" lon="{b:.9f}"><ele>5</ele></{point}>' for a, b in places]
        half = len(rows) // 2
        parts = [rows[:half], rows[half:]] if kind == "trk" else [rows]
        wrap = ("<trkseg>", "</trkseg>") if kind == "trk" else ("", "")
        inner = "\n".join(wrap[0] + "\n".join(part) + wrap[1] for part in parts)
        text += f"\n<{kind}><name>a</name>\n{inner}\n</{kind}>"
    return f"{text}\n</gpx>\n"


@pytest.fixture(scope="session")
def paths(tmp_path_factory: pytest.TempPathFactory) -> dict[str, PathComponent]:
    """All shapes, built once."""
    folder = tmp_path_factory.mktemp("paths")
    write_csv(folder / "ellipse.csv", ellipse())
    xodr_maps.write(folder / "wavy.xodr", xodr_maps.wavy())
    xodr_maps.write(folder / "town.xodr", xodr_maps.town())
    xodr_maps.write(folder / "ring.xodr", opendrive(FigureEight()))
    shutil.move(bags.write(folder, bags.drive(700)), folder / "lap.mcap")
    plan = ("/plan", "nav_msgs/msg/Path", 0, bags.path(0, ellipse()))
    shutil.rmtree(folder / "mcap")
    shutil.move(bags.write(folder, [plan]), folder / "plan.mcap")
    wave = [(5.0 * i, 10.0 * math.sin(0.25 * i)) for i in range(50)]
    write_csv(folder / "wave.csv", wave)
    (folder / "wave.gpx").write_text(gpx(wave), encoding="utf-8")
    line = {"type": "LineString", "coordinates": [degrees(x, y)[::-1] for x, y in wave]}
    (folder / "wave.geojson").write_text(json.dumps(line), encoding="utf-8")
    out = {}
    for name, fields in SHAPES.items():
        data = dict(fields)
        if "file" in data:
            data["file"] = str(folder / str(data["file"]))
        path = resolve("path", data)
        assert isinstance(path, PathComponent)
        out[name] = path
    return out


@pytest.fixture(params=SHAPES)
def path(request: pytest.FixtureRequest, paths: dict[str, PathComponent]) -> PathComponent:
    """Each shape in turn."""
    return paths[request.param]


@pytest.fixture(params=[name for name in SHAPES if not name.startswith(CROSSING)])
def plain_path(request: pytest.FixtureRequest, paths: dict[str, PathComponent]) -> PathComponent:
    """Each shape that does not cross itself."""
    return paths[request.param]
