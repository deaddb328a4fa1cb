"""A page of sections: what others measured beside what was measured, and what follows from it.

A section is plain data: ``title``; ``text``, sentences; ``findings``, each with ``agrees``
(true, false, or null for what can be neither) and ``text``; ``warnings``, sentences; ``tables``
(``title``, ``columns``, ``rows``) and ``figures``, each with ``file``, as
:func:`steersman.report.svg.line_plot`, :func:`steersman.report.charts.heat_map` (with ``cells``)
or :func:`steersman.report.charts.interval_plot` (with ``points``) take them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from steersman.files import make_folder, write_text
from steersman.report import tables, web
from steersman.report.charts import heat_map, interval_plot
from steersman.report.runs import Table
from steersman.report.scene import RoadGroup
from steersman.report.svg import line_plot

_WORDS = {True: "agrees", False: "differs", None: "note"}


LIMIT = 15_000_000
"""Bytes that a page may have; the rows of its drives are thinned until it does."""


def write_article(
    sections: Sequence[Mapping[str, Any]],
    out: FilePath,
    title: str,
    source: str = "",
    plots: str = "plots",
    replay: Sequence[RoadGroup] = (),
) -> FilePath:
    """Write the page, self-contained, and its figures as files into the folder ``plots`` beside it.

    Drives to replay stand behind the first section.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
        DataError: the files cannot be written.
    """
    page = web.template("article.html.j2")
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
        shown.append(
            {"warnings": (), **section, "figures": figures, "tables": grids, "findings": findings}
        )
    content = {
        "title": title,
        "style": web.resource("page.css"),
        "sections": shown,
        "source": source,
        "has_drives": bool(replay),
    }
    text = web.within(LIMIT, lambda rows: page.render(**content, **web.parts(replay, None, rows)))
    write_text(out, text)
    return out


def _drawn(figure: Mapping[str, Any]) -> str:
    if "cells" in figure:
        return heat_map(figure)
    return interval_plot(figure) if "points" in figure else line_plot(figure)
