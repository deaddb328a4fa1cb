"""A page of sections: what others measured beside what was measured, and what follows from it.

A section is plain data: ``title``; ``text``, sentences; ``findings``, each with ``agrees``
(true, false, or null for what can be neither) and ``text``; ``tables`` (``title``, ``columns``,
``rows``) and ``figures``, each with ``file``, as :func:`steersman.report.svg.line_plot`,
:func:`steersman.report.charts.heat_map` (with ``cells``) or
:func:`steersman.report.charts.interval_plot` (with ``points``) take them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from steersman.errors import SteersmanError
from steersman.files import make_folder, write_text
from steersman.report import tables
from steersman.report.charts import heat_map, interval_plot
from steersman.report.runs import Table
from steersman.report.svg import line_plot

_WORDS = {True: "agrees", False: "differs", None: "note"}


def write_article(
    sections: Sequence[Mapping[str, Any]],
    out: FilePath,
    title: str,
    source: str = "",
    plots: str = "plots",
) -> FilePath:
    """Write the page, self-contained, and its figures as files into the folder ``plots`` beside it.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
        DataError: the files cannot be written.
    """
    try:
        from jinja2 import Environment, StrictUndefined
    except ModuleNotFoundError:
        raise SteersmanError(
            "a report needs more packages: pip install 'steersman[report]'"
        ) from None
    folder = make_folder(out.parent / plots)
    shown = []
    for section in sections:
        figures = []
        for figure in section.get("figures", ()):
            figures.append(_drawn(figure))
            write_text(folder / f"{figure['file']}.svg", figures[-1])
        grids = [
            tables.grid(Table(t["title"], t["columns"], t["rows"]))
            for t in section.get("tables", ())
        ]
        findings = [(_WORDS[f["agrees"]], f["text"]) for f in section.get("findings", ())]
        shown.append({**section, "figures": figures, "tables": grids, "findings": findings})
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    template = environment.from_string(_resource("article.html.j2"))
    style = _resource("page.css")
    write_text(out, template.render(title=title, style=style, sections=shown, source=source))
    return out


def _drawn(figure: Mapping[str, Any]) -> str:
    if "cells" in figure:
        return heat_map(figure)
    return interval_plot(figure) if "points" in figure else line_plot(figure)


def _resource(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
