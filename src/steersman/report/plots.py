"""The figures of a result, drawn with Matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from steersman.errors import ConfigError, SteersmanError, how_to_install, suggestion
from steersman.report.article import Figure
from steersman.report.charts import HeatMap, IntervalPlot
from steersman.report.signals import look
from steersman.report.svg import LinePlot, Values
from steersman.report.view import ResultView
from steersman.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as PlotFigure

_DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
# Of one of the figures, of a row of a chart, and of what is above and below its rows [inches].
_WIDTH, _HEIGHT, _ROW, _FRAME = 8.0, 2.6, 0.24, 1.6
# Up to so many lines have their legend inside the axes.
_FEW = 3


def drawn(view: ResultView, names: Sequence[str]) -> PlotFigure:
    """The named figures below each other, by default those that are shown first.

    Raises:
        ConfigError: there is no figure of a name, or none at all.
        SteersmanError: the extra ``notebook`` is not installed.
    """
    known = {figure.file: figure for figure in view.figures}
    if not known:
        raise ConfigError("this result has no figure", ("plot",))
    for name in names:
        if name not in known:
            raise ConfigError(f"no figure {name!r}{suggestion(name, known)}", ("plot",))
    chosen = [known[name] for name in names or list(known)[: view.first]]
    lines = all(isinstance(figure, LinePlot) for figure in chosen)
    shared = lines and len({figure.x for figure in chosen if isinstance(figure, LinePlot)}) == 1
    heights = [_height(figure) for figure in chosen]
    whole = _empty(sum(heights))
    ratios = {"height_ratios": heights}
    places = whole.subplots(len(chosen), squeeze=False, sharex=shared, gridspec_kw=ratios)[:, 0]
    for figure, axes in zip(chosen, places, strict=True):
        draw(figure, axes)
    if shared:
        for axes in whole.axes[:-1]:
            axes.set_xlabel("")
    return whole


def _empty(height: float) -> PlotFigure:
    """A figure that a notebook shows, whichever of Matplotlib's back ends is in use."""
    try:
        from matplotlib.figure import Figure as Plain
    except ModuleNotFoundError:
        raise SteersmanError(f"a plot needs {how_to_install('notebook')}") from None

    class NotebookFigure(Plain):
        def _repr_png_(self) -> bytes:
            stream = io.BytesIO()
            self.savefig(stream, format="png")
            return stream.getvalue()

    return NotebookFigure(figsize=(_WIDTH, height), layout="constrained")


def _height(figure: Figure) -> float:
    if isinstance(figure, LinePlot):
        return _HEIGHT
    rows = figure.rows if isinstance(figure, HeatMap) else figure.points
    return _FRAME + _ROW * len(rows)


@singledispatch
def draw(figure: Any, axes: Axes) -> None:
    """Draw a figure of a page on axes of Matplotlib."""
    raise NotImplementedError


@draw.register(LinePlot)
def _lines(figure: LinePlot, axes: Axes) -> None:
    for k, line in enumerate(figure.lines):
        style = look(k if line.look is None else line.look)
        marks: dict[str, Any] = {"color": style["color"], "label": line.name}
        if line.dots:
            axes.scatter(_known(line.x), _known(line.y), s=(2.0 * line.dots) ** 2, **marks)
            continue
        axes.plot(_known(line.x), _known(line.y), linestyle=_DASHES[style["dash"]], **marks)
        if len(line.low):
            band = _known(line.low), _known(line.high)
            axes.fill_between(_known(line.x), *band, color=style["color"], alpha=0.15)
    axes.set(title=figure.title, xlabel=figure.x, ylabel=figure.y)
    if figure.log:
        axes.set_yscale("log")
    if figure.log_x:
        axes.set_xscale("log")
    if figure.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if len(figure.lines) > 1:
        few = len(figure.lines) <= _FEW
        outside: dict[str, Any] = {} if few else {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
        axes.legend(fontsize="small", **outside)
    axes.grid(alpha=0.3)


@draw.register(IntervalPlot)
def _intervals(figure: IntervalPlot, axes: Axes) -> None:
    points = [point for point in figure.points if point.value]
    for k, point in enumerate(points):
        color = look(point.look)["color"]
        ends = [point.low or point.value, point.high or point.value]
        axes.plot(_known(ends), [k, k], color=color)
        axes.plot(_known([point.value]), [k], "D" if point.diamond else "o", color=color)
    axes.set(title=figure.title, xlabel=figure.x, xscale="log")
    axes.set_yticks(range(len(points)), [point.name for point in points])
    axes.invert_yaxis()
    axes.grid(alpha=0.3, axis="x")


@draw.register(HeatMap)
def _heat_map(figure: HeatMap, axes: Axes) -> None:
    cells = np.array([_known(row) for row in figure.cells])
    axes.imshow(cells, norm="log", vmin=figure.low, vmax=figure.high, cmap="cividis", aspect="auto")
    axes.set_xticks(range(len(figure.columns)), list(figure.columns), rotation=40, ha="right")
    axes.set_yticks(range(len(figure.rows)), list(figure.rows))
    for i, row in enumerate(figure.marks):
        for k, mark in enumerate(row):
            axes.text(k, i, mark, ha="center", va="center", fontsize="x-small", color="white")
    axes.set(title=figure.title)


def _known(values: Values) -> FloatArray:
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
