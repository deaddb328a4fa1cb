"""Draw the figures of the equations pages with the package's own code.

    python docs/images/draw.py [NAME ...]

Without names, all of them. Each is an SVG beside this file; what it shows is in the function of its
name.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import controller_figures  # noqa: E402 - they lie beside this file, which is no package
import geometry_figures  # noqa: E402
import learning_figures  # noqa: E402
import vehicle_figures  # noqa: E402

from steersman.report.svg import LinePlot, PlotLine  # noqa: E402

FIGURES: dict[str, Callable[[], Any]] = {
    **geometry_figures.FIGURES,
    **vehicle_figures.FIGURES,
    **controller_figures.FIGURES,
    **learning_figures.FIGURES,
}


def drawn(name: str) -> str:
    """A figure as SVG."""
    figure: dict[str, Any] | str = FIGURES[name]()
    if isinstance(figure, str):  # a drawing, no plot
        return figure
    lines = [PlotLine(**line) for line in figure.pop("lines")]
    return LinePlot(name, lines=lines, **figure).svg()


def main(names: list[str]) -> None:
    """Write the figures that are named, or all."""
    for name in names or FIGURES:
        (HERE / f"{name}.svg").write_text(drawn(name), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
