"""``steersman path``: what it writes, and what it refuses."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path as FilePath
from xml.etree import ElementTree as ET

import pytest
from typer.testing import Result

from steersman.paths.analytic import Circle
from steersman.paths.xodr.write import opendrive

from ..paths import xodr_maps

Steersman = Callable[..., Result]


def test_export_writes_the_road(steersman: Steersman, tmp_path: FilePath) -> None:
    words = ("path", "export", "circle", "radius=30", "--to", "new/ring.xodr")
    result = steersman(*words, "--lane-width", "3.5", "--shoulder", "0")
    assert result.exit_code == 0
    assert result.stdout == ""
    assert result.stderr == "written: new/ring.xodr (circle, 188.5 m, closed)\n"
    text = (tmp_path / "new" / "ring.xodr").read_text(encoding="utf-8")
    assert text == opendrive(Circle(radius=30.0), "circle", lane_width=3.5, shoulder=0.0)
    assert ET.fromstring(text).tag == "OpenDRIVE"


def test_export_as_a_table(steersman: Steersman, tmp_path: FilePath) -> None:
    assert steersman("path", "export", "circle", "radius=30", "--to", "ring.csv").exit_code == 0
    titles, *rows = (tmp_path / "ring.csv").read_text(encoding="utf-8").splitlines()
    assert titles == "s_m,x_m,y_m,heading_rad,curvature_1_m,height_m,bank_rad"
    assert len(rows) == 189
    assert steersman("path", "export", "ring.csv", "--to", "ring.xodr").exit_code == 0


def test_export_of_a_yaml_file(steersman: Steersman, tmp_path: FilePath) -> None:
    (tmp_path / "road.yaml").write_text("kind: circle\nradius: 20\n", encoding="utf-8")
    assert steersman("path", "export", "road.yaml", "radius=30", "--to", "a.xodr").exit_code == 0
    assert steersman("path", "export", "circle", "radius=30", "--to", "b.xodr").exit_code == 0
    assert (tmp_path / "a.xodr").read_bytes() == (tmp_path / "b.xodr").read_bytes()


def test_help_has_examples(steersman: Steersman) -> None:
    for command in ("export monza", "roads Town07.xodr"):
        result = steersman("path", command.split()[0], "--help")
        assert f"\n    steersman path {command}" in result.stdout


def test_roads_of_a_map(steersman: Steersman, tmp_path: FilePath) -> None:
    xodr_maps.write(tmp_path / "town.xodr", xodr_maps.town())
    listed = json.loads(steersman("path", "roads", "town.xodr", "--json").stdout)
    assert listed["a"] == {
        "length_m": 60.0,
        "lanes": [1, -1],
        "radius_m": None,
        "leads_to": ["a-left", "a-on", "a-right"],
    }
    assert listed["a-right"]["radius_m"] == pytest.approx(12.0 - 1.75, abs=0.01)
    assert listed["back"]["lanes"] == [1]
    result = steersman("path", "roads", "town.xodr")
    assert re.search(r"\na +1, -1 +60\.0 +a-left, a-on, a-right\n", result.stdout)


def test_what_is_wrong_with_a_map_is_listed(steersman: Steersman, tmp_path: FilePath) -> None:
    text = xodr_maps.town()
    file = xodr_maps.write(tmp_path / "town.xodr", text)
    result = steersman("path", "check", str(file))
    assert (result.exit_code, result.stdout) == (0, "")
    xodr_maps.write(file, text.replace('<laneLink from="-1"', '<laneLink from="x"', 1))
    result = steersman("path", "check", str(file), "--json")
    assert result.exit_code == 1
    [fault] = json.loads(result.stdout)
    assert (fault["road"], fault["s"]) == ("", None)
    assert (
        "<laneLink>: from is 'x', not a whole number; this connection is left out" in fault["text"]
    )
    assert "1 found; all else" in steersman("path", "check", str(file)).stdout
    listed = steersman("path", "roads", str(file))
    assert listed.exit_code == 0
    assert listed.stderr.count("\n") == 1


def test_roads_without_lanes_are_left_out(steersman: Steersman, tmp_path: FilePath) -> None:
    text = xodr_maps.town().replace('type="driving"', 'type="sidewalk"')
    xodr_maps.write(tmp_path / "town.xodr", text)
    assert json.loads(steersman("path", "roads", "town.xodr", "--json").stdout) == {}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("path", "missing command; see 'steersman path --help'"),
        ("path exprt", "no such command 'exprt'; did you mean 'export'?"),
        (
            "path export circle",
            "missing option '--to'; write --to export.xodr; see 'steersman path export --help'",
        ),
        ("path export mona --to a.xodr", "unknown path 'mona'; did you mean 'monza'?"),
        (
            "path export radius=5 --to a.xodr",
            "'radius=5' is a setting; first comes the kind of path, e.g. circle",
        ),
        (
            "path export circle radius=5m --to a.xodr",
            "radius: '5m' is not a number; the unit is m, write e.g. 5",
        ),
        (
            "path export circle --lane-width 0 --to a.xodr",
            "invalid value for '--lane-width': Input should be greater than or equal to 0.5;"
            " see 'steersman path export --help'",
        ),
        ("path export none.yaml --to a.xodr", "none.yaml: no such file"),
        (
            "path roads none.xodr",
            "none.xodr: cannot be read (No such file or directory);"
            " give an OpenDRIVE file (*.xodr)",
        ),
        ("path export circle --to .", "--to: expected the name of a file, given '.'"),
    ],
)
def test_wrong_input(steersman: Steersman, tmp_path: FilePath, words: str, message: str) -> None:
    result = steersman(*words.split())
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr == f"error: {message}\n"
    assert list(tmp_path.iterdir()) == []
