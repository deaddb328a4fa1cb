"""``steersman live``: a page on which each change of a setting drives again."""

from __future__ import annotations

import webbrowser
from pathlib import Path as FilePath
from typing import Annotated

import typer

from steersman.cli import settings
from steersman.cli.output import note

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman live\n"
    "  steersman live tuned/lqr path=monza start.s=850 speed=constant_speed speed.speed=15\n"
    "  steersman live vehicle=my_car.yaml path=track.csv --no-browser\n"
    "  steersman live path=figure_eight --training runs/agent"
)


def live(
    words: settings.Words = None,
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port; 0 takes a free one.")
    ] = 0,
    token: Annotated[
        str | None,
        typer.Option("--token", help="Token of the address; by default a new one each time."),
    ] = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Whether to open the page.")
    ] = True,
    out: Annotated[
        str, typer.Option("--out", metavar="DIR", help="Folder for what is driven by hand.")
    ] = "runs/live",
    training: Annotated[
        str | None,
        typer.Option("--training", metavar="DIR", help="Folder of a training to follow."),
    ] = None,
) -> None:
    """Choose on a page what to drive; every change drives again, within a moment.

    The page is served on this machine alone, to those who have the token in its address.
    """
    from steersman.api import driving
    from steersman.live import server
    from steersman.live.page import LiveAddress

    server.require()
    config = driving.configure("drive", *(words or []))
    driving.announce_drive(config, words or [], note)
    address = LiveAddress(server.free_port(port), token or server.new_token())
    note(f"{address.url}\nCtrl-C ends it")
    if browser:
        webbrowser.open(address.url)
    server.serve(config, address, out, None if training is None else FilePath(training))
