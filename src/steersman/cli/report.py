"""``steersman report``: runs as one page."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated

import typer

from steersman import files
from steersman.cli.output import note
from steersman.errors import DataError

# Files of what a report is made of.
_REPORTED = ("*.npz", "progress.csv", "metrics.json", "table*.json")

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman report runs/demo --out report.html\n"
    "  steersman report runs/mpc runs/agent --out compare.html --title 'MPC or agent'"
)


def report(
    folders: Annotated[
        list[str],
        typer.Argument(metavar="DIR...", help="Folders with episodes, metrics, training records."),
    ],
    out: Annotated[str, typer.Option("--out", metavar="FILE.html", help="The page to write.")],
    title: Annotated[str, typer.Option("--title", help="Its heading.")] = "Steersman report",
) -> None:
    """Make one HTML page of tables and plots that needs no network."""
    page = files.out_file(out, "--out", files.HTML)

    from steersman.report import load_runs, write_report

    write_report(load_runs(_to_report(folders)), page, title)
    note(f"written: {page}")


def _to_report(folders: list[str]) -> list[FilePath]:
    """The folders without those that are nothing but the like of a tuning, with a page of its own.

    Raises:
        DataError: none is left.
    """
    kept, pages = [], []
    for folder in map(FilePath, folders):
        page = _own_page(folder)
        if page is None:
            kept.append(folder)
        else:
            pages.append((folder, page))
    for folder, page in pages:
        if not kept:
            raise DataError(f"{folder}: no drive or training to report; its own page is {page}")
        note(f"{folder}: no drive or training, left out; its own page is {page}")
    return kept


def _own_page(folder: FilePath) -> FilePath | None:
    """The page of a benchmark, tuning, search or comparison that left nothing else to report."""
    page = folder / "report.html"
    if not page.is_file() or any(next(folder.rglob(name), None) for name in _REPORTED):
        return None
    return page
