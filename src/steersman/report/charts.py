"""Charts of a benchmark as SVG text: a heat map, and estimates with their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from steersman.report.signals import look
from steersman.report.svg import axis_ticks, opened
from steersman.report.tables import text

_LABEL, _CELL, _ROW, _TOP = 150, 46, 22, 110
_WIDTH, _PLOT_LEFT, _PLOT_RIGHT = 640, 170, 90
# From good to bad, light enough for dark figures on them; blue and orange, which nearly all eyes
# tell apart.
_GOOD, _MIDDLE, _BAD = (0x7F, 0xB8, 0xE0), (0xF6, 0xF1, 0xE4), (0xEE, 0x8E, 0x4F)
_INK, _SOFT = "#1c2126", "#808080"
_HALF = 0.5


def heat_map(figure: Mapping[str, Any]) -> str:
    """A table of coloured cells as SVG.

    ``figure`` has ``title``, ``rows`` and ``columns`` (names), ``cells``: a list for each row,
    of numbers or None; ``low`` and ``high`` (the numbers with the first and the last colour, on a
    logarithmic scale), and ``marks``, a list for each row of what is written into the cells.
    """
    rows, columns = figure["rows"], figure["columns"]
    width, height = _LABEL + _CELL * len(columns) + 40, _TOP + _ROW * len(rows) + 8
    parts = [
        opened(figure["title"], width, height),
        *(_slanted(name, _LABEL + _CELL * (k + _HALF)) for k, name in enumerate(columns)),
    ]
    for i, name in enumerate(rows):
        top = _TOP + _ROW * i
        parts.append(_text(_LABEL - 6, top + _ROW / 2, name, "end"))
        for k, value in enumerate(figure["cells"][i]):
            color = _color(value, figure["low"], figure["high"])
            parts.append(
                f'<rect x="{_LABEL + _CELL * k}" y="{top}" width="{_CELL - 1}" '
                f'height="{_ROW - 1}" fill="{color}"/>'
                + _text(
                    _LABEL + _CELL * (k + _HALF), top + _ROW / 2, figure["marks"][i][k],
                    "middle", _INK,
                )
            )  # fmt: skip
    return "\n".join([*parts, "</svg>"]) + "\n"


def interval_plot(figure: Mapping[str, Any]) -> str:
    """Estimates with intervals, one below the other, on a logarithmic scale, as SVG.

    ``figure`` has ``title``, ``x`` (title of the axis) and ``points``: each with ``name``,
    ``value``, ``low``, ``high`` (all above zero, or None) and ``group``, the number of its colour;
    where ``diamond`` is true, it is marked by one instead of a disc.
    """
    points = [p for p in figure["points"] if p["value"]]
    values = [p[k] for p in points for k in ("value", "low", "high") if p[k]]
    top, low = 34, 34 + _ROW * len(points)
    parts = [opened(figure["title"], _WIDTH, low + 46)]
    scale = _Log(values or [1.0])
    for tick in axis_ticks(scale.a, scale.b):
        at = scale.at(tick)
        parts.append(
            f'<path d="M{at:.1f} {top}V{low}" stroke="{_SOFT}" stroke-opacity=".25"/>'
            + _text(at, low + 12, f"{tick:.4g}", "middle")
        )
    for i, point in enumerate(points):
        middle, color = top + _ROW * (i + _HALF), look(point["group"])["color"]
        ends = [scale.at(point[k] or point["value"]) for k in ("low", "high")]
        value = text(point["value"], 3)
        parts.append(
            _text(_PLOT_LEFT - 8, middle, point["name"], "end")
            + f'<path d="M{ends[0]:.1f} {middle}H{ends[1]:.1f}" stroke="{color}" '
            f'stroke-width="2.5"/>'
            + _marker(scale.at(point["value"]), middle, color, bool(point.get("diamond")))
            + _text(_WIDTH - _PLOT_RIGHT + 12, middle, value, "start")
        )
    parts.append(_text((_PLOT_LEFT + _WIDTH - _PLOT_RIGHT) / 2, low + 32, figure["x"], "middle"))
    return "\n".join([*parts, "</svg>"]) + "\n"


def _marker(x: float, y: float, color: str, diamond: bool) -> str:
    if diamond:
        return f'<path d="M{x:.1f} {y - 6:.1f}l6 6l-6 6l-6 -6z" fill="{color}"/>'
    return f'<circle cx="{x:.1f}" cy="{y}" r="4.5" fill="{color}"/>'


class _Log:
    """From values to places, decades equally long."""

    def __init__(self, values: Sequence[float]) -> None:
        self.a, self.b = math.log10(min(values)) - 0.05, math.log10(max(values)) + 0.05

    def at(self, value: float) -> float:
        share = (math.log10(value) - self.a) / (self.b - self.a)
        return _PLOT_LEFT + share * (_WIDTH - _PLOT_RIGHT - _PLOT_LEFT)


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


def _color(value: float | None, low: float, high: float) -> str:
    """Colour of a value between ``low`` and ``high``; grey for none."""
    if value is None or not math.isfinite(value):
        return "#b8bec4"
    share = math.log(max(value, low) / low) / math.log(high / low)
    share = min(max(share, 0.0), 1.0)
    a, b, w = (_GOOD, _MIDDLE, 2 * share) if share < _HALF else (_MIDDLE, _BAD, 2 * share - 1)
    return "#" + "".join(f"{round(p + w * (q - p)):02x}" for p, q in zip(a, b, strict=True))
