"""Line plots as SVG text: small, self-contained, readable on light and dark pages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any, NamedTuple, TypeAlias

from steersman.report.signals import look
from steersman.types import FloatArray

Values: TypeAlias = Sequence[Any] | FloatArray

WIDTH, HEIGHT = 640, 320
_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 26, 30, 44
SOFT = "#808080"
"""Colour of axes and text, readable on light and on dark."""
_DASHES = {"solid": "", "dash": "7 4", "dot": "2 3", "dashdot": "7 3 2 3"}
_TICKS = 5
# Up to so many decades, what of each is marked; and how many decades are marked at most.
_FACTORS = ((2.0, (1.0, 2.0, 5.0)), (4.0, (1.0, 3.0)), (math.inf, (1.0,)))
_DECADES = 8
_ROW = 16
# Radius of a line's only point [pixels].
_ALONE = 3.0
# A range of values below this is none.
_FLAT = 1e-12


class PlotAxis:
    """From values to places on the drawing [pixels]."""

    def __init__(
        self, values: Sequence[float], low: float, high: float, *, log: bool, margin: float = 0.0
    ) -> None:
        """An axis that holds all values, from place ``low`` to place ``high``.

        Logarithmic only where a value is positive; ``margin`` is left at both ends, in decades if
        it is logarithmic.
        """
        self.log = log and any(v > 0.0 for v in values)
        kept = [v for v in values if v > 0.0] if self.log else list(values)
        a, b = (min(kept), max(kept)) if kept else (0.0, 1.0)
        if self.log:
            a, b = math.log10(a), math.log10(b)
        a, b = a - margin, b + margin
        if b - a < _FLAT:
            pad = abs(a) * 0.1 or 1.0
            a, b = a - pad, b + pad
        self.a, self.b, self.low, self.high = a, b, low, high

    def at(self, value: float) -> float:
        """Place of a value; values that have no logarithm are at the lower end."""
        if self.log:
            value = math.log10(value) if value > 0.0 else self.a
        return self.low + (value - self.a) / (self.b - self.a) * (self.high - self.low)

    def ticks(self) -> list[float]:
        """Round values within the axis."""
        return axis_ticks(self.a, self.b) if self.log else _even(self.a, self.b)


def axis_ticks(a: float, b: float) -> list[float]:
    """Round values of a logarithmic axis from 10^a to 10^b.

    Decades, with 2 and 5 (or 3) times them where there are few; even steps within one decade.

    >>> axis_ticks(0.8, 2.2)
    [10.0, 20.0, 50.0, 100.0]
    """
    span = b - a
    if span <= 1.0:
        return _even(10.0**a, 10.0**b)
    factors = next(f for most, f in _FACTORS if span <= most)
    every = max(round(span / _DECADES), 1)
    decades = range(math.floor(a), math.floor(b) + 1)
    marks = [(k + math.log10(f), f * 10.0**k) for k in decades if k % every == 0 for f in factors]
    return [value for at, value in marks if a - 1e-9 <= at <= b + 1e-9]


def _even(a: float, b: float) -> list[float]:
    raw = (b - a) / _TICKS
    size = 10.0 ** math.floor(math.log10(raw))
    step = next(size * m for m in (1.0, 2.0, 5.0, 10.0) if size * m >= raw)
    return [k * step for k in range(math.ceil(a / step), math.floor(b / step) + 1)]


def opened(title: str, width: float, height: float, left: float = 8) -> str:
    """The start of a drawing and its title, ``left`` from the edge; all lengths in pixels.

    What is narrower or wider than a chart is so on a page, too: its letters stay as large.
    """
    own = "" if width == WIDTH else f'style="--basis: {width:g}px" '
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        f'width="{width}" height="{height}" font-family="sans-serif" font-size="12" '
        f'{own}fill="{SOFT}"><title>{escape(title)}</title>'
        f'<text x="{left}" y="16" font-weight="bold">{escape(title)}</text>'
    )


def closed(parts: Iterable[str]) -> str:
    """A whole drawing from its start and its parts."""
    return "\n".join([*parts, "</svg>"]) + "\n"


class PlotLine(NamedTuple):
    """A line of a plot; values that are None or not finite are left out."""

    name: str
    x: Values
    y: Values
    low: Values = ()
    """Lower ends of a band around the line, if there is one."""
    high: Values = ()
    dots: float = 0.0
    """Radius of its points [pixels], drawn instead of the line; 0: a line."""
    look: int | None = None
    """Number of its colour and dash; None: its place among the lines."""


class LinePlot(NamedTuple):
    """Lines over one axis."""

    file: str
    """Name of its file, without the ending."""
    title: str
    x: str
    """Title of the axis."""
    y: str
    lines: Sequence[PlotLine]
    log: bool = False
    """Logarithmic y."""
    log_x: bool = False
    equal: bool = False
    """The same scale for x and y."""

    def svg(self) -> str:
        """The figure as SVG."""
        lines = [line for line in self.lines if _finite(line.y)]
        rows = math.ceil(len(lines) / 2) if len(lines) > 1 else 0
        xs = [v for line in lines for v in _finite(line.x)]
        ys = [v for one in lines for values in (one.y, one.low, one.high) for v in _finite(values)]
        x = PlotAxis(xs, _LEFT, WIDTH - _RIGHT, log=self.log_x)
        y = PlotAxis(ys, HEIGHT - _BOTTOM, _TOP, log=self.log)
        if self.equal:
            _equalise(x, y)
        parts = [opened(self.title, WIDTH, HEIGHT + _ROW * rows, _LEFT), *_frame(x, y, self)]
        for k, line in enumerate(lines):
            style = look(k if line.look is None else line.look)
            parts += _drawn(line, style, x, y)
            if rows:
                parts.append(_entry(line, style, k))
        return closed(parts)


def _finite(values: Values) -> list[float]:
    return [float(v) for v in values if v is not None and math.isfinite(v)]


def _equalise(x: PlotAxis, y: PlotAxis) -> None:
    """Widen the range of one axis so that a metre is as long on both."""
    scale = max((x.b - x.a) / abs(x.high - x.low), (y.b - y.a) / abs(y.high - y.low))
    for axis in (x, y):
        middle, half = 0.5 * (axis.a + axis.b), 0.5 * scale * abs(axis.high - axis.low)
        axis.a, axis.b = middle - half, middle + half


def _frame(x: PlotAxis, y: PlotAxis, figure: LinePlot) -> list[str]:
    low, out = HEIGHT - _BOTTOM, []
    for tick in x.ticks():
        at = f"{x.at(tick):.1f}"
        out.append(
            f'<path d="M{at} {_TOP}V{low}" stroke="{SOFT}" stroke-opacity=".25"/>'
            f'<text x="{at}" y="{low + 15}" text-anchor="middle">{tick:.6g}</text>'
        )
    for tick in y.ticks():
        at = f"{y.at(tick):.1f}"
        out.append(
            f'<path d="M{_LEFT} {at}H{WIDTH - _RIGHT}" stroke="{SOFT}" stroke-opacity=".25"/>'
            f'<text x="{_LEFT - 5}" y="{at}" dy=".35em" text-anchor="end">{tick:.4g}</text>'
        )
    middle, height = 0.5 * (_LEFT + WIDTH - _RIGHT), 0.5 * (_TOP + low)
    return [
        *out,
        f'<text x="{middle}" y="{low + 34}" text-anchor="middle">{escape(figure.x)}</text>',
        f'<text transform="translate(13 {height}) rotate(-90)" text-anchor="middle">'
        f"{escape(figure.y)}</text>",
    ]


def _points(xs: Values, ys: Values, x: PlotAxis, y: PlotAxis) -> list[str]:
    pairs = zip(xs, ys, strict=True)
    return [f"{x.at(a):.1f} {y.at(b):.1f}" for a, b in pairs if _finite((a, b)) == [a, b]]


def _drawn(line: PlotLine, style: dict[str, str], x: PlotAxis, y: PlotAxis) -> list[str]:
    color, points = style["color"], _points(line.x, line.y, x, y)
    if line.dots:
        return [_dot(at, line.dots, color) for at in points]
    if len(points) <= 1:  # a path needs two; a value that stands alone is seen as a dot
        return [_dot(at, _ALONE, color) for at in points]
    out = []
    band = [_points(line.x, edge, x, y) for edge in (line.low, line.high) if len(edge)]
    if band and all(len(edge) > 1 for edge in band):
        around = band[0] + band[1][::-1]
        out.append(f'<path d="M{"L".join(around)}Z" fill="{color}" fill-opacity=".15"/>')
    return [
        *out,
        f'<path d="M{"L".join(points)}" fill="none" '
        f'stroke="{color}" stroke-width="1.8" stroke-linejoin="round"{_dashed(style)}/>',
    ]


def _dashed(style: dict[str, str]) -> str:
    dash = _DASHES[style["dash"]]
    return f' stroke-dasharray="{dash}"' if dash else ""


def _dot(at: str, radius: float, color: str) -> str:
    x, y = at.split()
    return f'<circle cx="{x}" cy="{y}" r="{radius:g}" fill="{color}"/>'


def _entry(line: PlotLine, style: dict[str, str], k: int) -> str:
    """A line of the legend, below the drawing in two columns."""
    left, top = _LEFT + (k % 2) * (WIDTH - _LEFT) // 2, HEIGHT + _ROW * (k // 2)
    color = style["color"]
    mark = f'<path d="M{left} {top}h24" stroke="{color}" stroke-width="2.5"{_dashed(style)}/>'
    if line.dots:
        mark = _dot(f"{left + 12} {top}", line.dots, color)
    return f'{mark}<text x="{left + 30}" y="{top}" dy=".35em">{escape(line.name)}</text>'
