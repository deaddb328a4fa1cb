"""A page of sections: what others measured beside what was measured, and what follows from it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import NamedTuple, TypeAlias

from steersman.files import make_folder, write_text
from steersman.report import tables, web
from steersman.report.charts import HeatMap, IntervalPlot
from steersman.report.runs import Table
from steersman.report.scene import RoadGroup
from steersman.report.svg import LinePlot, PlotLine

__all__ = [
    "Figure",
    "LinePlot",
    "PageFinding",
    "PlotLine",
    "Section",
    "Table",
    "write_article",
    "write_tables",
]

_WORDS = {True: "agrees", False: "differs", None: "note"}
LIMIT = 15_000_000
"""Bytes that a page may have; the rows of its drives are thinned until it does."""

Figure: TypeAlias = LinePlot | HeatMap | IntervalPlot


class PageFinding(NamedTuple):
    """A sentence, and whether a statement holds that was made elsewhere."""

    agrees: bool | None
    """None: neither yes nor no."""
    text: str


class Section(NamedTuple):
    """A section of a page."""

    title: str
    text: Sequence[str] = ()
    """Paragraphs."""
    findings: Sequence[PageFinding] = ()
    tables: Sequence[Table] = ()
    """Those without rows are left out."""
    figures: Sequence[Figure] = ()
    warnings: Sequence[str] = ()
    """Paragraphs that are set apart."""


def write_article(
    sections: Sequence[Section],
    out: FilePath,
    title: str,
    source: str = "",
    plots: str = "plots",
    replay: Sequence[RoadGroup] = (),
) -> FilePath:
    """Write the page, self-contained, and its figures as files into the folder ``plots`` beside it.

    The drives to replay are shown behind the first section.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
        DataError: the files cannot be written.
    """
    text = article_page(sections, title, source, replay)
    folder = make_folder(out.parent / plots)
    for section in sections:
        for figure in section.figures:
            write_text(folder / f"{figure.file}.svg", figure.svg())
    write_text(out, text)
    return out


def write_tables(sections: Sequence[Section], folder: FilePath) -> None:
    """Write the tables as Markdown, a file for each, named after its title.

    Raises:
        DataError: the files cannot be written.
    """
    make_folder(folder)
    for table in (each for section in sections for each in section.tables if each.rows):
        name = "_".join(re.findall(r"[a-z0-9]+", table.title.lower()))
        write_text(folder / f"{name}.md", markdown(table))


def markdown(table: Table) -> str:
    """A table as Markdown."""
    grid = tables.grid(table)
    rule = ["---:" if header.number else "---" for header in grid.headers]
    rows = [[cell.text for cell in row] for row in (grid.headers, *grid.rows)]
    lines = ["| " + " | ".join(row) + " |" for row in (rows[0], rule, *rows[1:])]
    return "\n".join(lines) + "\n"


def article_page(
    sections: Sequence[Section], title: str, source: str = "", replay: Sequence[RoadGroup] = ()
) -> str:
    """The page as text, self-contained.

    Raises:
        SteersmanError: the extra ``report`` is not installed.
    """
    page = web.template("article.html.j2")
    content = {
        "title": title,
        "style": web.resource("page.css"),
        "sections": [
            section._asdict()
            | {
                "findings": [(_WORDS[found.agrees], found.text) for found in section.findings],
                "tables": [tables.grid(table) for table in section.tables if table.rows],
                "figures": [figure.svg() for figure in section.figures],
            }
            for section in sections
        ],
        "source": source,
        "has_drives": bool(replay),
    }
    return web.within(LIMIT, lambda rows: page.render(**content, **web.parts(replay, None, rows)))
