"""Parquet, replay and page of a small benchmark."""

from __future__ import annotations

import math
import re
from pathlib import Path as FilePath
from typing import Any
from xml.etree import ElementTree

import pytest

from steersman.bench import suites
from steersman.bench.drive import Row
from steersman.bench.entrants import Entrant, entrants
from steersman.bench.replay import worst_cases
from steersman.bench.results import results
from steersman.bench.runner import bench
from steersman.bench.table import write_table
from steersman.report.benchmark import write_benchmark
from steersman.report.charts import heat_map, interval_plot

SVG = "{http://www.w3.org/2000/svg}"
SCENARIOS = suites.quick().scenarios((1,))
WHO = entrants(["pid", "stanley", "mpc_pid"])


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    return bench(SCENARIOS, WHO, tmp_path_factory.mktemp("bench"), jobs=1)


def test_the_table_is_the_rows(rows: list[Row], tmp_path: FilePath) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    file = write_table(rows, tmp_path)
    assert file is not None
    table = parquet.read_table(file)
    assert table.to_pylist() == rows
    assert str(table.schema.field("disturbance_friction").type) == "double"  # all undefined
    assert str(table.schema.field("completed").type) == "bool"


def test_the_worst_case_is_the_worst_and_drives_again(rows: list[Row]) -> None:
    cases = {case["controller"]: case for case in worst_cases(rows, SCENARIOS, WHO)}
    assert list(cases) == [e.name for e in WHO]
    for name, case in cases.items():
        own = [row for row in rows if row["controller"] == name]
        assert case["rms_m"] == max(row["charged_rms_m"] for row in own)
        assert case["best_rms_m"] <= case["rms_m"]
        driven, path = case["lines"]["driven"], case["lines"]["path"]
        assert len(driven["x"]) == len(driven["offset"]) == len(driven["along"]) > 10
        # The driven line lies beside the path by the offset.
        x, y, offset = driven["x"][0], driven["y"][0], abs(driven["offset"][0])
        near = min(math.hypot(x - a, y - b) for a, b in zip(path["x"], path["y"], strict=True))
        assert offset - 0.02 <= near <= offset + 0.7


def test_the_page_stands_alone(rows: list[Row], tmp_path: FilePath) -> None:
    found = results("quick", [1], rows, WHO)
    page = write_benchmark(found, worst_cases(rows, SCENARIOS, WHO), tmp_path / "report.html")
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=.(?!data:)", text)
    for word in ("Ranking", "Performance profiles", "Disturbances", "Worst cases", "stanley"):
        assert word in text
    assert len(list((tmp_path / "plots").glob("worst_*.svg"))) == len(WHO)
    assert (tmp_path / "plots" / "sweep_delay.svg").exists()


def test_one_controller_has_a_page_too(rows: list[Row], tmp_path: FilePath) -> None:
    one: list[Entrant] = WHO[:1]
    own = [row for row in rows if row["controller"] == "pid"]
    page = write_benchmark(results("quick", [1], own, one), [], tmp_path / "report.html")
    assert "Performance profiles" not in page.read_text(encoding="utf-8")


def heat(**words: Any) -> str:
    base = {
        "title": "a < b", "rows": ["one", "two"], "columns": ["x", "y"], "low": 1.0, "high": 100.0,
        "cells": [[1.0, 10.0], [100.0, None]], "marks": [["1", "10"], ["100", "-"]],
    }  # fmt: skip
    return heat_map(base | words)


def test_colours_follow_the_logarithm() -> None:
    root = ElementTree.fromstring(heat())
    colors = [rect.get("fill") for rect in root.iter(f"{SVG}rect")]
    assert len(set(colors)) == 4
    beyond = ElementTree.fromstring(heat(cells=[[0.1, 10.0], [1e4, math.nan]]))
    assert [rect.get("fill") for rect in beyond.iter(f"{SVG}rect")] == colors


def test_intervals_lie_around_their_values() -> None:
    points = [
        {"name": "a&b", "value": 10.0, "low": 5.0, "high": 20.0, "group": 0},
        {"name": "c", "value": 100.0, "low": None, "high": None, "group": 1},
        {"name": "none", "value": None, "low": None, "high": None, "group": 0},
    ]
    root = ElementTree.fromstring(interval_plot({"title": "t", "x": "mm", "points": points}))
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
