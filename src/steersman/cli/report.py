"""``steersman report``: runs as one page."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated

import typer

from steersman.cli import settings
from steersman.cli.output import note

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
    page = settings.out_file(out)

    from steersman.report import load_runs, write_report

    write_report(load_runs([FilePath(folder) for folder in folders]), page, title)
    note(f"written: {page}")
