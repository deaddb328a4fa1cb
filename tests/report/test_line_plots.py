"""Line plots: every path that is drawn is one by SVG's grammar, whatever values are missing."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.report.svg import LinePlot, PlotLine

_NUMBER = r"-?\d+(\.\d+)?(e-?\d+)?"
_PATH = re.compile(rf"M{_NUMBER} {_NUMBER}(([LVHh]{_NUMBER}( {_NUMBER})?)+Z?)")
_VALUES = st.none() | st.just(math.nan) | st.floats(-1e6, 1e6)


def drawn(*lines: PlotLine, log: bool = False) -> ElementTree.Element:
    return ElementTree.fromstring(LinePlot("f", "Title", "x", "y", lines, log=log).svg())


def tags(svg: ElementTree.Element, name: str) -> list[ElementTree.Element]:
    return list(svg.iter(f"{{http://www.w3.org/2000/svg}}{name}"))


@given(st.lists(st.tuples(_VALUES, _VALUES, _VALUES), min_size=1, max_size=5), st.booleans())
def test_paths_are_valid(rows: list[tuple[float | None, ...]], log: bool) -> None:
    y, low, high = zip(*rows, strict=True)
    for line in (PlotLine("a", range(len(y)), y, low, high), PlotLine("b", range(len(y)), y)):
        for path in tags(drawn(line, log=log), "path"):
            assert _PATH.fullmatch(path.get("d", "")), path.get("d")


@pytest.mark.parametrize("band", [(), (None, None, None), (None, 1.0, None)])
def test_without_an_interval_there_is_no_band(band: tuple[float | None, ...]) -> None:
    svg = drawn(PlotLine("a", [0, 1, 2], [1.0, 2.0, 3.0], band, band))
    assert not [path for path in tags(svg, "path") if path.get("fill-opacity")]
    assert not tags(svg, "circle")


def test_the_only_value_is_a_dot() -> None:
    svg = drawn(PlotLine("a", [0, 1, 2], [None, 2.0, None]))
    assert len(tags(svg, "circle")) == 1
