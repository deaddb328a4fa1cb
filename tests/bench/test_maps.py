"""Courses over OpenDRIVE maps: which ways are chosen, which are not, and what is kept of it."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from typer.testing import CliRunner

from steersman.bench import drive
from steersman.bench.maps import MIN_RADIUS, Map, read_maps, with_maps
from steersman.bench.suites import core, quick
from steersman.cli import app
from steersman.config import dump
from steersman.errors import ConfigError
from steersman.kernels import path as kernel
from steersman.paths.analytic import Circle
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.tracks import TrainingCircuit
from steersman.paths.xodr.write import opendrive
from steersman.rollout import run

from ..paths import xodr_maps


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Three maps: a town, a circuit, and a ring that is too sharp to drive."""
    place = tmp_path_factory.mktemp("maps")
    xodr_maps.write(place / "town.xodr", xodr_maps.town())
    xodr_maps.write(place / "circuit.xodr", opendrive(TrainingCircuit()))
    xodr_maps.write(place / "knot.xodr", opendrive(Circle(radius=MIN_RADIUS - 0.5)))
    (place / "readme.txt").write_text("no map", encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def maps(folder: FilePath) -> list[Map]:
    return read_maps(folder)


def test_ways_on_each_map(folder: FilePath, maps: list[Map]) -> None:
    found = {each.name: each for each in maps}
    assert list(found) == ["circuit.xodr", "knot.xodr", "town.xodr"]
    circuit, town, knot = (found[f"{name}.xodr"] for name in ("circuit", "town", "knot"))
    assert [course.path.length for course in circuit.courses.values()] == pytest.approx([500.0] * 3)
    assert circuit.sharp_km == 0.0
    assert circuit.lanes_km == pytest.approx(1.502, abs=1e-3)
    assert circuit.sha256 == hashlib.sha256((folder / circuit.name).read_bytes()).hexdigest()
    # The town is smaller: its ways are shorter.
    assert len(town.courses) == 2
    assert {round(course.path.length) for course in town.courses.values()} == {300}
    assert town.why_not.startswith("no way of 500 m was found that takes no lane twice and bends")
    assert knot.courses == {}
    assert knot.sharp_km == knot.lanes_km > 0.0
    assert knot.why_not.startswith("no way of 500 m was found that takes no lane twice and bends")
    json.dumps([each.record().plain() for each in found.values()], allow_nan=False)
    assert knot.described().startswith(
        "knot.xodr: left out, no course; 0.03 of 0.03 km of lanes are left out: they bend below 6 m"
    )


def test_no_way_runs_along_with_another_or_bends_too_much(maps: list[Map]) -> None:
    for each in maps:
        paths = [course.path for course in each.courses.values()]
        for a, b in itertools.combinations(paths, 2):
            ends = [(p.at(0.0), p.at(p.length / 2), p.at(p.length)) for p in (a, b)]
            assert max(math.dist(p[:2], q[:2]) for p, q in zip(*ends, strict=True)) > 50.0
        for path in paths:
            assert np.max(np.abs(path.table.pieces[:, kernel.KAPPA0])) < 1.02 / MIN_RADIUS
            assert isinstance(path, OpenDrivePath)
            assert path.sha256 == each.sha256


def test_the_same_ways_every_time(folder: FilePath, maps: list[Map]) -> None:
    first, again = (
        [dump(course.path) for each in found for course in each.courses.values()]
        for found in (maps, read_maps(folder))
    )
    assert first == again


def test_they_join_a_suite(maps: list[Map]) -> None:
    plan = with_maps(quick(), maps)
    assert set(plan.courses) - set(quick().courses) == {
        *(name for each in maps for name in each.courses)
    }
    assert plan.disturbances == quick().disturbances
    alone = with_maps(None, maps)
    assert alone.disturbances == core().disturbances
    assert not set(alone.courses) & set(core().courses)
    names = {scenario.path for scenario in alone.scenarios()}
    assert names == set(alone.courses)
    with pytest.raises(ConfigError, match=r"rename circuit\.xodr"):
        with_maps(plan, maps)
    knot = [each for each in maps if each.name == "knot.xodr"]
    for suite in (None, quick()):
        with pytest.raises(ConfigError, match=r"no way on any of the maps: knot.xodr: no way of 5"):
            with_maps(suite, knot)


def test_a_usual_controller_stays_on_them(maps: list[Map]) -> None:
    names = {f"{name}/constant/clean/carla_model3/0" for name in ("town_0", "circuit_0")}
    found = [each for each in with_maps(None, maps).scenarios() if each.name in names]
    assert len(found) == 2
    for scenario in found:
        assert run(scenario.run).end == "end_of_path", scenario.name


def test_another_file_is_another_scenario(tmp_path: FilePath) -> None:
    def digests(text: str) -> list[str]:
        xodr_maps.write(tmp_path / "ring.xodr", text)
        return [drive.digest(each) for each in with_maps(None, read_maps(tmp_path)).scenarios()]

    text = opendrive(TrainingCircuit())
    first = digests(text)
    assert digests(text) == first
    assert not set(digests(text.replace('name="path"', 'name="road"'))) & set(first)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("maps",), "the suite 'maps' needs a folder of OpenDRIVE maps: --maps DIR"),
        (("--maps", "no"), "no: no such folder; --maps takes a folder of OpenDRIVE files"),
        (("--maps", "."), ".: holds no OpenDRIVE file (*.xodr)"),
    ],
)
def test_what_is_refused(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["bench", *words, "--out", "new"], prog_name="steersman")
    assert result.exit_code == 2
    assert result.stderr == f"error: {message}\n"
    assert list(tmp_path.iterdir()) == []


BROKEN = "<OpenDRIVE>\n<road/></OpenDRIVE>"
WHY = "line 2: <road>: length is missing"


def test_a_broken_map_is_left_out_with_its_reason(tmp_path: FilePath) -> None:
    xodr_maps.write(tmp_path / "broken.xodr", BROKEN)
    (tmp_path / "bytes.xodr").write_bytes(b"\xff\x00")
    (tmp_path / "folder.xodr").mkdir()
    xodr_maps.write(tmp_path / "wavy.xodr", xodr_maps.wavy())
    found = {each.name: each for each in read_maps(tmp_path)}
    assert found["broken.xodr"].described() == f"broken.xodr: left out, no course; {WHY}"
    assert [name for name, each in found.items() if each.courses] == ["wavy.xodr"]
    assert all("\n" not in each.described() and each.why_not for each in found.values())
    assert found["broken.xodr"].record().sha256 is None
    assert set(with_maps(None, list(found.values())).courses) == set(found["wavy.xodr"].courses)


def test_nothing_is_driven_where_no_map_is_left(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "maps").mkdir()
    xodr_maps.write(tmp_path / "maps" / "broken.xodr", BROKEN)
    words = ["bench", "quick", "--maps", "maps", "--out", "out"]
    result = CliRunner().invoke(app, words, prog_name="steersman")
    assert result.exit_code == 2
    assert result.stderr.splitlines()[-1] == (
        f"error: no way on any of the maps: broken.xodr: {WHY}"
    )
    assert not (tmp_path / "out").exists()


def test_the_command(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "maps").mkdir()
    file = xodr_maps.write(tmp_path / "maps" / "wavy.xodr", xodr_maps.wavy())
    xodr_maps.write(tmp_path / "maps" / "broken.xodr", BROKEN)
    knot = opendrive(Circle(radius=MIN_RADIUS - 0.5))
    xodr_maps.write(tmp_path / "maps" / "knot.xodr", knot)
    words = ["bench", "quick", "--maps", "maps", "--controllers", "pid", "--out", "out"]
    result = CliRunner().invoke(app, words, prog_name="steersman", catch_exceptions=False)
    assert result.exit_code == 0
    assert "wavy.xodr: courses of 150 m; no way of 500 m was found" in result.stderr
    outcome = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert f"broken.xodr: left out, no course; {WHY}\n" in result.stderr
    assert "knot.xodr: left out, no course; 0.03 of 0.03 km" in result.stderr
    assert outcome["maps_left_out"] == ["broken.xodr", "knot.xodr"]
    assert outcome["maps"]["broken.xodr"]["why_not_more"] == WHY
    kept = outcome["maps"]["wavy.xodr"]
    assert kept["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    assert kept["distance_m"] == [150.0]
    lines = (tmp_path / "out" / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    driven = {json.loads(line)["path"] for line in lines}
    assert driven == {*kept["courses"], *quick().courses}
