"""Charts of a benchmark as SVG text: a heat map, and estimates with their intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from steersman.report.signals import look
from steersman.report.svg import SOFT, PlotAxis, closed, opened
from steersman.report.tables import text

_LABEL, _CELL, _ROW, _TOP = 150, 46, 22, 110
_WIDTH, _PLOT_LEFT, _PLOT_RIGHT = 640, 170, 90
# From good to bad, light enough for dark figures on them; blue and orange, which nearly all eyes
# tell apart.
_GOOD, _MIDDLE, _BAD = (0x7F, 0xB8, 0xE0), (0xF6, 0xF1, 0xE4), (0xEE, 0x8E, 0x4F)
_INK = "#1c2126"
_HALF = 0.5


class HeatMap(NamedTuple):
    """A table of coloured cells."""

    file: str
    """Name of its file, without the ending."""
    title: str
    rows: Sequence[str]
    """Names of the rows."""
    columns: Sequence[str]
    cells: Sequence[Sequence[float | None]]
    """A list of numbers for each row."""
    marks: Sequence[Sequence[str]]
    """What is written into the cells, a list for each row."""
    low: float
    """The number with the first colour; the scale is logarithmic."""
    high: float
    """The number with the last colour."""

    def svg(self) -> str:
        """The figure as SVG."""
        width = _LABEL + _CELL * len(self.columns) + 40
        parts = [
            opened(self.title, width, _TOP + _ROW * len(self.rows) + 8),
            *(_slanted(name, _LABEL + _CELL * (k + _HALF)) for k, name in enumerate(self.columns)),
        ]
        for i, name in enumerate(self.rows):
            top = _TOP + _ROW * i
            parts.append(_text(_LABEL - 6, top + _ROW / 2, name, "end"))
            for k, value in enumerate(self.cells[i]):
                middle = _LABEL + _CELL * (k + _HALF)
                parts.append(
                    f'<rect x="{_LABEL + _CELL * k}" y="{top}" width="{_CELL - 1}" '
                    f'height="{_ROW - 1}" fill="{self._color(value)}"/>'
                    + _text(middle, top + _ROW / 2, self.marks[i][k], "middle", _INK)
                )
        return closed(parts)

    def _color(self, value: float | None) -> str:
        """Colour of a value between ``low`` and ``high``; grey for none."""
        if value is None or not math.isfinite(value):
            return "#b8bec4"
        share = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        share = min(max(share, 0.0), 1.0)
        a, b, w = (_GOOD, _MIDDLE, 2 * share) if share < _HALF else (_MIDDLE, _BAD, 2 * share - 1)
        return "#" + "".join(f"{round(p + w * (q - p)):02x}" for p, q in zip(a, b, strict=True))


class ShownEstimate(NamedTuple):
    """An estimate and the ends of its interval, all above zero or None."""

    name: str
    value: float | None
    low: float | None = None
    high: float | None = None
    look: int = 0
    """The number of its colour."""
    diamond: bool = False
    """Marked by a diamond instead of a disc."""


class IntervalPlot(NamedTuple):
    """Estimates with intervals, one below the other, on a logarithmic scale."""

    file: str
    """Name of its file, without the ending."""
    title: str
    x: str
    """Title of the axis."""
    points: Sequence[ShownEstimate]

    def svg(self) -> str:
        """The figure as SVG; estimates without a value are left out."""
        points = [point for point in self.points if point.value]
        values = [v for p in points for v in (p.value, p.low, p.high) if v]
        top, low = 34, 34 + _ROW * len(points)
        parts = [opened(self.title, _WIDTH, low + 46)]
        scale = PlotAxis(values or [1.0], _PLOT_LEFT, _WIDTH - _PLOT_RIGHT, log=True, margin=0.05)
        for tick in scale.ticks():
            at = scale.at(tick)
            parts.append(
                f'<path d="M{at:.1f} {top}V{low}" stroke="{SOFT}" stroke-opacity=".25"/>'
                + _text(at, low + 12, f"{tick:.4g}", "middle")
            )
        for i, point in enumerate(points):
            parts.append(_row(point, point.value or 0.0, top + _ROW * (i + _HALF), scale))
        middle = (_PLOT_LEFT + _WIDTH - _PLOT_RIGHT) / 2
        return closed([*parts, _text(middle, low + 32, self.x, "middle")])


def _row(point: ShownEstimate, value: float, middle: float, scale: PlotAxis) -> str:
    color, at = look(point.look)["color"], scale.at(value)
    ends = [scale.at(value if end is None else end) for end in (point.low, point.high)]
    marker = f'<circle cx="{at:.1f}" cy="{middle}" r="4.5" fill="{color}"/>'
    if point.diamond:
        marker = f'<path d="M{at:.1f} {middle - 6:.1f}l6 6l-6 6l-6 -6z" fill="{color}"/>'
    return (
        _text(_PLOT_LEFT - 8, middle, point.name, "end")
        + f'<path d="M{ends[0]:.1f} {middle}H{ends[1]:.1f}" stroke="{color}" stroke-width="2.5"/>'
        + marker
        + _text(_WIDTH - _PLOT_RIGHT + 12, middle, text(value, 3), "start")
    )


def _text(x: float, y: float, words: str, anchor: str, color: str = "") -> str:
    fill = f' fill="{color}"' if color else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" dy=".35em" text-anchor="{anchor}"{fill}>'
        f"{escape(words)}</text>"
    )


def _slanted(words: str, x: float) -> str:
    return (
        f'<text transform="translate({x:.1f} {_TOP - 8}) rotate(-40)" text-anchor="start">'
        f"{escape(words)}</text>"
    )
