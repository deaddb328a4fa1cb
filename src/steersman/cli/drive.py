"""``steersman drive``: one closed loop, its figures and its record."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman import files
from steersman.cli import recording, settings
from steersman.cli.outcome import INTERRUPTED
from steersman.cli.output import note, share_bar, show, show_json, table
from steersman.errors import SteersmanError
from steersman.naming import called, titled

if TYPE_CHECKING:
    from steersman.episode import Episode
    from steersman.rollout import RunConfig

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman drive\n"
    "  steersman drive controller=mpc_pid path=circle path.radius=50 \\\n"
    "      speed=constant_throttle speed.throttle=0.4 duration=60 --json\n"
    "  steersman drive path=monza laps=1 --out runs/monza --mcap monza.mcap\n"
    "  steersman drive path=monza laps=1 --report runs/monza.html\n"
    "  steersman drive tuned/lqr path=circle duration=20 --video drive.mp4\n"
    "  steersman drive runs/monza/config.yaml controller.horizon=30\n"
    "  steersman drive controller=policy\n"
    "  steersman drive plant=carla plant.port=2000 controller=policy path=monza laps=1\n"
    "  steersman drive controller=policy controller.file=runs/demo/training/policy.onnx\n"
    "\n"
    "What can be set: steersman show drive"
)


def drive(
    words: settings.Words = None,
    out: settings.OptionalOut = None,
    overwrite: settings.Overwrite = False,
    report: settings.Report = None,
    as_json: settings.AsJson = False,
    mcap: Annotated[
        str | None,
        typer.Option("--mcap", metavar="FILE", help="Write a recording with ROS 2 messages."),
    ] = None,
    video: Annotated[
        str | None,
        typer.Option("--video", metavar="FILE", help="Write a video of it: NAME.mp4 or NAME.gif."),
    ] = None,
) -> None:
    """Drive one closed loop and print what was measured.

    Files named in settings are relative to the current folder.
    """
    from steersman.api import driving
    from steersman.api.noted import after, noted
    from steersman.config import dump
    from steersman.outcome import Interrupted
    from steersman.rollout import attempt

    config = driving.configure("drive", *(words or []))
    driving.announce_drive(config, words or [], note)
    folder = None if out is None else files.out_folder(out)
    if folder is not None:
        driving.drive_folder(folder, overwrite=overwrite)
    page = None if report is None else _page(report)
    file, film = recording.recording_file(mcap), recording.video_file(video)
    error, interrupted = None, False
    try:
        with share_bar("driving") as progress:
            tried = attempt(config, progress)
        episode, error = tried.episode, tried.error
    except Interrupted as stopped:
        episode, interrupted = stopped.episode, True
    episode = noted(config, words or [], episode)
    metrics = driving.drive_metrics(episode)
    if folder is not None:
        driving.write_drive(folder, config, episode)
    _replay(page, config, episode)
    recording.record(file, config, episode)
    if film is not None:
        episode.save(film)
        note(f"video: {film}")
    if error is not None:
        kept = "" if folder is None else f"; what was driven until then is in {folder}"
        raise SteersmanError(f"{error}{kept}") from error
    for hint in after(config, episode):
        note(hint)
    if as_json:
        show_json({"config": dump(config), "metrics": metrics})
    else:
        _show(config, metrics, folder, episode)
    if interrupted:
        raise typer.Exit(INTERRUPTED)


def _page(name: str) -> FilePath:
    """The file of the page, proved to be possible before anything is driven.

    Raises:
        DataError: it cannot be written.
        SteersmanError: the extra ``report`` is not installed.
    """
    from steersman.report.web import template

    template("page.html.j2")
    return files.out_file(name, "--report", files.HTML)


def _replay(page: FilePath | None, config: RunConfig, episode: Episode) -> None:
    """Write the page of the drive, if there is a file for it.

    Raises:
        DataError: it cannot be written.
    """
    if page is None:
        return
    from steersman.metrics.base import summarise
    from steersman.report import ReportRun, write_report

    name, road = titled(config.controller), titled(config.path)
    drive = ReportRun(name, episode, summarise(episode), config=dict(episode.meta))
    write_report([drive], page, f"{name} on {road}")
    note(f"replay: {page}")


def _show(
    config: RunConfig, found: dict[str, Any], folder: FilePath | None, episode: Episode
) -> None:
    from steersman.metrics.base import evaluate, metrics, readable
    from steersman.metrics.following import following
    from steersman.metrics.stopping import stopping
    from steersman.report.tables import text

    steady = found["steady"]
    figures = table("measured", "unit", "run", "last half", right=("run", "last half"))
    for name, metric in metrics().items():
        unit, value = readable(metric, found[name])
        late = text(readable(metric, steady[name])[1]) if name in steady else ""
        figures.add_row(metric.meaning, unit, text(value), late)
    more = following() if config.lead is not None else {}
    more |= stopping() if getattr(config.speed, "end", None) == 0.0 else {}
    for name, value in evaluate(episode, more).items():
        unit, shown = readable(more[name], value)
        figures.add_row(more[name].meaning, unit, text(shown), "")
    who = f"{called(config.controller)} drives {config.plant.car(config.vehicle)}"
    where = f"on {called(config.path)}, {called(config.speed)}"
    end = str(found["end"]).replace("_", " ")
    written = [] if folder is None else [f"\nwritten to {folder}"]
    show(f"{who} {where}; ended by: {end}\n", figures, *written)
