"""Parquet, replay and page of a small benchmark."""

from __future__ import annotations

import math
import re
from pathlib import Path as FilePath
from typing import Any
from xml.etree import ElementTree

import pytest

from steersman.bench import suites
from steersman.bench.entrants import Entrant, entrants
from steersman.bench.parquet import write_table
from steersman.bench.replay import class_cases, median_cases, worst_cases
from steersman.bench.results import BenchResult, BenchRow
from steersman.bench.runner import bench
from steersman.bench.summary import results
from steersman.config import resolve
from steersman.report.benchmark import sections, write_benchmark
from steersman.report.cases import replays
from steersman.report.charts import HeatMap, IntervalPlot, ShownEstimate
from steersman.report.signals import PALETTE

SVG = "{http://www.w3.org/2000/svg}"
SCENARIOS = suites.quick().scenarios((1,))
WHO = entrants(["pid", "stanley", "mpc_pid"])


def result(rows: list[BenchRow], who: list[Entrant]) -> BenchResult:
    return results("quick", suites.quick(), [1], rows, who)


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[BenchRow]:
    return bench(SCENARIOS, WHO, tmp_path_factory.mktemp("bench"), jobs=1)


def test_the_table_is_the_rows(rows: list[BenchRow], tmp_path: FilePath) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    file = write_table(rows, tmp_path)
    assert file is not None
    table = parquet.read_table(file)
    assert table.to_pylist() == [row.plain() for row in rows]
    assert str(table.schema.field("disturbance_friction").type) == "double"  # all undefined
    assert str(table.schema.field("completed").type) == "bool"


def test_the_worst_case_is_the_worst_and_drives_again(rows: list[BenchRow]) -> None:
    cases = {case.controller: case for case in worst_cases(rows, SCENARIOS, WHO)}
    assert list(cases) == [e.name for e in WHO]
    for name, case in cases.items():
        own = [row for row in rows if row.controller == name]
        assert case.rms_m == max(row.charged_rms_m for row in own)
        assert case.best_rms_m <= case.rms_m
        driven, path = (case.lines()[name] for name in ("driven", "path"))
        assert len(driven.x) == len(driven.offset) == len(driven.along) > 10
        # The driven line lies beside the path by the offset.
        x, y, offset = driven.x[0], driven.y[0], abs(driven.offset[0])
        near = min(math.hypot(x - a, y - b) for a, b in zip(path.x, path.y, strict=True))
        assert offset - 0.02 <= near <= offset + 0.7


def test_the_median_case_is_in_the_middle(rows: list[BenchRow]) -> None:
    for case in median_cases(rows, SCENARIOS, WHO):
        own = sorted(r.charged_rms_m for r in rows if r.controller == case.controller)
        assert own.index(case.rms_m) == (len(own) - 1) // 2
        # What is replayed is the drive that was measured.
        (row,) = (
            r for r in rows
            if (r.scenario, r.controller) == (case.scenario, case.controller)
        )  # fmt: skip
        episode = case.episodes[case.controller]
        errors = episode["lateral_error"]
        assert abs(errors).max() == row.metrics["max_abs_lateral_error_m"]
        assert list(case.episodes) in ([case.controller], [case.controller, case.best])


def test_no_server_is_asked_for_median_cases(rows: list[BenchRow]) -> None:
    elsewhere = [
        s._replace(run=s.run.model_copy(update={"plant": resolve("plant", "carla")}))
        for s in SCENARIOS
    ]
    assert median_cases(rows, elsewhere, WHO) == []


def colours(figure: str, mark: str) -> list[str]:
    root = ElementTree.fromstring(figure)
    return [str(e.get(mark)) for e in root.iter() if e.get(mark) in PALETTE]


def test_a_controller_has_one_colour_in_all_figures(
    rows: list[BenchRow], tmp_path: FilePath
) -> None:
    who = [WHO[0], WHO[1]._replace(learned=True), WHO[2]]
    found = result(rows, who)
    cases = worst_cases(rows, SCENARIOS, who)
    order = list(found.summary.controllers)
    write_benchmark(found, cases, tmp_path / "report.html")
    read = {f.stem: f.read_text(encoding="utf-8") for f in (tmp_path / "plots").iterdir()}
    expected = list(PALETTE[: len(order)])
    assert colours(read["ratio"], "fill") == expected
    assert colours(read["profiles"], "stroke")[::2] == expected  # line and legend
    assert read["rms_all"].count("<circle") == 2  # what was learned is a diamond
    for k, case in enumerate(cases):
        assert colours(read[f"worst_{k}"], "stroke")[0] == expected[order.index(case.controller)]
    groups = replays(found.summary, cases)
    assert [group.looks[0] for group in groups if group.looks] == [0, 1, 2]
    assert groups[0].title.startswith(f"{order[0]}: ")
    assert {group.kind for group in groups} == {"worst of each controller"}


def test_each_class_has_a_scenario_that_all_controllers_drive(
    rows: list[BenchRow], monkeypatch: pytest.MonkeyPatch
) -> None:
    found, cases = result(rows, WHO), class_cases(rows, SCENARIOS, WHO)
    classes = list(dict.fromkeys(s.disturbance for s in SCENARIOS))
    assert [group.kind for group in replays(found.summary, cases)] == classes
    for case in cases:
        assert sorted(case.episodes) == sorted(one.name for one in WHO)
        own = {r.controller: r for r in rows if r.scenario == case.scenario}
        assert case.rms_m == min(row.charged_rms_m for row in own.values())
        for name, episode in case.episodes.items():
            most = abs(episode["lateral_error"]).max()
            assert most == own[name].metrics["max_abs_lateral_error_m"]
    # Where there is no room for all, the best two stay.
    monkeypatch.setattr("steersman.bench.replay._MOST", 1)
    monkeypatch.setattr("steersman.bench.replay.drive", lambda *_: None)
    (names,) = {frozenset(case.episodes) for case in class_cases(rows, SCENARIOS, WHO)}
    assert names == set(sorted((one.name for one in WHO), key=lambda n: _rms(rows, n))[:2])


def _rms(rows: list[BenchRow], controller: str) -> float:
    return sum(row.charged_rms_m**2 for row in rows if row.controller == controller)


def test_intervals_over_few_paths_come_with_a_warning(rows: list[BenchRow]) -> None:
    found = result(rows, WHO)
    (warning,) = sections(found.summary, [])[0].warnings
    assert warning.startswith("all scenarios, clean, disturbed: the intervals rest on only 2 paths")
    spread = [row.model_copy(update={"path": f"{row.path}{k % 4}"}) for k, row in enumerate(rows)]
    many = sections(result(spread, WHO).summary, [])[0].warnings
    assert all("all scenarios" not in words for words in many)
    one = [row.model_copy(update={"path": "one"}) for row in rows]
    (warning,) = sections(result(one, WHO).summary, [])[0].warnings
    assert "no intervals" in warning


def test_the_page_stands_alone(rows: list[BenchRow], tmp_path: FilePath) -> None:
    found = result(rows, WHO)
    page = write_benchmark(found, worst_cases(rows, SCENARIOS, WHO), tmp_path / "report.html")
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=.(?!data:)", re.sub(r"<script.*?</script>", "", text))
    assert text.count('id="replay"') == 1
    for word in ("Ranking", "Performance profiles", "Disturbances", "Worst cases", "stanley"):
        assert word in text
    assert len(list((tmp_path / "plots").glob("worst_*.svg"))) == len(WHO)
    assert (tmp_path / "plots" / "sweep_delay.svg").exists()


def test_one_controller_has_a_page_too(rows: list[BenchRow], tmp_path: FilePath) -> None:
    one: list[Entrant] = WHO[:1]
    own = [row for row in rows if row.controller == "pid"]
    page = write_benchmark(result(own, one), [], tmp_path / "report.html")
    assert "Performance profiles" not in page.read_text(encoding="utf-8")


def heat(**words: Any) -> str:
    base = {
        "file": "f", "title": "a < b", "rows": ["one", "two"], "columns": ["x", "y"],
        "low": 1.0, "high": 100.0,
        "cells": [[1.0, 10.0], [100.0, None]], "marks": [["1", "10"], ["100", "-"]],
    }  # fmt: skip
    return HeatMap(**base | words).svg()


def test_colours_follow_the_logarithm() -> None:
    root = ElementTree.fromstring(heat())
    colors = [rect.get("fill") for rect in root.iter(f"{SVG}rect")]
    assert len(set(colors)) == 4
    beyond = ElementTree.fromstring(heat(cells=[[0.1, 10.0], [1e4, math.nan]]))
    assert [rect.get("fill") for rect in beyond.iter(f"{SVG}rect")] == colors


@pytest.mark.parametrize("count", [1, 2, 8, 30])
def test_letters_of_a_heat_map_are_never_blown_up(count: int) -> None:
    cells, marks = [[1.0] * count] * 2, [["1"] * count] * 2
    root = ElementTree.fromstring(heat(columns=["x"] * count, cells=cells, marks=marks))
    basis = re.search(r"--basis: ([0-9.]+)px", root.get("style") or "")
    assert basis is not None
    width = float(root.get("width") or 0.0)
    assert 0.9 * width < float(basis[1]) <= width


def test_intervals_lie_around_their_values() -> None:
    points = [
        ShownEstimate("a&b", 10.0, 5.0, 20.0),
        ShownEstimate("c", 100.0, look=1),
        ShownEstimate("none", None),
    ]
    root = ElementTree.fromstring(IntervalPlot("f", "t", "mm", points).svg())
    circles = [float(c.get("cx", "nan")) for c in root.iter(f"{SVG}circle")]
    assert len(circles) == 2
    assert circles[0] < circles[1]
    ends = [
        [float(v) for v in re.findall(r"[MH]([\d.]+)", path.get("d") or "")]
        for path in root.iter(f"{SVG}path")
        if path.get("stroke-width")
    ]
    assert ends[0][0] < circles[0] < ends[0][1]
    # Half and double are as far on a logarithmic scale.
    assert circles[0] - ends[0][0] == pytest.approx(ends[0][1] - circles[0], abs=0.2)
    assert ends[1][0] == ends[1][1] == pytest.approx(circles[1], abs=0.1)
