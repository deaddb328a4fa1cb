"""Plots as SVG, and the page of sections."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any
from xml.etree import ElementTree

import pytest

from steersman.report.article import PageFinding, Section, write_article
from steersman.report.runs import Table
from steersman.report.signals import PALETTE
from steersman.report.svg import HEIGHT, WIDTH, LinePlot, PlotLine, axis_ticks

SVG = "{http://www.w3.org/2000/svg}"


def figure(*lines: PlotLine, **words: Any) -> LinePlot:
    return LinePlot("one", "a < b", "x [m]", "y & z", lines, **words)


def line(y: list[Any], **words: Any) -> PlotLine:
    return PlotLine(**{"name": "n<1>", "x": list(range(len(y))), "y": y} | words)


def curves(text: str) -> list[list[tuple[float, float]]]:
    """Points of all thick lines."""
    root = ElementTree.fromstring(text)
    out = []
    for path in root.iter(f"{SVG}path"):
        if path.get("stroke-width") == "1.8":
            pairs = re.findall(r"(-?[\d.]+) (-?[\d.]+)", path.get("d") or "")
            out.append([(float(a), float(b)) for a, b in pairs])
    return out


def test_a_line_goes_from_corner_to_corner() -> None:
    ((first, last),) = curves(figure(line([0.0, 5.0])).svg())
    assert first[0] < last[0] <= WIDTH
    assert 0.0 <= last[1] < first[1] <= HEIGHT


def test_a_logarithm_makes_decades_equal() -> None:
    ((a, b, c),) = curves(figure(line([1.0, 10.0, 100.0]), log=True).svg())
    assert b[1] - a[1] == pytest.approx(c[1] - b[1], abs=0.2)


@pytest.mark.parametrize("start", [-3.4, 0.0, 0.71])
@pytest.mark.parametrize("span", [0.02, 0.3, 0.9, 1.05, 1.4, 1.9, 2.1, 3.0, 4.5, 12.0])
def test_a_logarithmic_axis_always_has_labels(start: float, span: float) -> None:
    ticks = axis_ticks(start, start + span)
    assert 3 <= len(ticks) <= 9
    assert all(a < b for a, b in pairwise(ticks))
    assert all(start - 1e-6 <= math.log10(t) <= start + span + 1e-6 for t in ticks)


def test_lines_can_be_told_their_colour() -> None:
    text = figure(line([1.0, None, 2.0], look=2), line([2.0, 1.0, 1.0], look=0)).svg()
    strokes = re.findall(r'stroke="(#\w+)"', text.replace("#808080", ""))
    assert strokes[::2] == strokes[1::2] == [PALETTE[2], PALETTE[0]]


def test_equal_axes_keep_a_square_a_square() -> None:
    square = line([0.0, 0.0, 7.0], x=[0.0, 7.0, 7.0])
    ((a, b, c),) = curves(figure(square, equal=True).svg())
    assert b[0] - a[0] == pytest.approx(b[1] - c[1], abs=0.2)


def test_what_is_not_finite_is_left_out() -> None:
    ((*points,),) = curves(figure(line([1.0, None, math.inf, 2.0])).svg())
    assert len(points) == 2


@pytest.mark.parametrize("y", [[], [3.0], [2.0, 2.0], [0.0, 0.0], [-1.0, 0.0]])
@pytest.mark.parametrize("log", [False, True])
def test_poor_data_still_make_a_plot(y: list[float], log: bool) -> None:
    root = ElementTree.fromstring(figure(line(y), log=log).svg())
    assert root.tag.endswith("svg")
    assert "nan" not in ElementTree.tostring(root, encoding="unicode").lower()


def test_bands_and_legends() -> None:
    band = line([1.0, 2.0], low=[0.5, 1.0], high=[2.0, 3.0])
    text = figure(band, line([2.0, 1.0], name="other")).svg()
    assert text.count("fill-opacity") == 1
    assert "n&lt;1&gt;" in text
    assert "other" in text


def test_the_page_stands_alone_and_escapes(tmp_path: FilePath) -> None:
    section = Section(
        "<b>One",
        ["a < b"],
        findings=[PageFinding(True, "x"), PageFinding(None, "y")],
        tables=[Table("t", [{"a": 1.5}, {"a": None, "B": 2}], {"a": "A"}), Table("empty", [])],
        figures=[figure(line([1.0, 2.0]))],
    )
    out = write_article([section, Section("Two")], tmp_path / "r.html", "T", "S.")
    page = out.read_text(encoding="utf-8")
    assert "&lt;b&gt;One" in page
    assert page.count("<svg") == 1
    assert "http" not in page.replace("http://www.w3.org/2000/svg", "").replace("http-equiv", "")
    assert "<b>agrees</b>" in page
    assert page.count("<table>") == page.count('<th scope="col"') == 1
    assert "<b>note</b>" in page
    assert (tmp_path / "plots" / "one.svg").read_text().startswith("<svg")


def test_a_table_has_the_headings_of_all_its_rows() -> None:
    assert list(Table("t", [{"a": 1}, {"a": 2, "b": 3}]).headers) == ["a", "b"]
