"""``steersman tune``: search a controller's gains."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated

import typer

from steersman.cli import settings
from steersman.cli.outcome import INTERRUPTED
from steersman.cli.output import TOLD, note, steps_bar, tell_compiling, write
from steersman.errors import how_to_install

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman tune controller=mpc_pid --trials 200 --out runs/tune\n"
    "  steersman tune controller=pid controller.feedforward=true --out runs/tune_pid\n"
    "\n"
    "The same command goes on where an interrupted study stopped."
)


def tune(
    out: Annotated[
        str, typer.Option("--out", metavar="DIR", help="Folder for the study and its result.")
    ],
    words: Annotated[
        list[str] | None, typer.Argument(metavar=settings.METAVAR, help=settings.HELP)
    ] = None,
    trials: Annotated[
        int | None, typer.Option("--trials", min=1, help="Trials in all; the same as trials=N.")
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
) -> None:
    """Tune a controller's gains with Optuna on a suite of runs.

    Writes study.jsonl, tuned.yaml (the best controller), result.json (with the simulated seconds
    that the tuning cost), and the trials' errors against their steering activity: pareto.json,
    pareto.svg and report.html.
    """
    import steersman as sm
    from steersman.config import to_yaml

    config = sm.configure("tune", *(words or []), *([f"trials={trials}"] if trials else []))
    engine, jobs = settings.workers_for(config.plant, engine, jobs)
    settings.tell_plant(config.plant)
    folder = settings.out_folder(out)
    tell_compiling()
    driven = False
    try:
        with steps_bar(config.trials, "tuning", "trials", TOLD) as update:

            def tell(done: int, cost: float) -> None:
                nonlocal driven
                driven = True
                update(done, f"cost {1e3 * cost:.4g} mm")

            best = sm.tune(config, out=folder, progress=tell, engine=engine, jobs=jobs)
    except KeyboardInterrupt:
        note(f"interrupted; the same command goes on from {folder}")
        raise typer.Exit(INTERRUPTED) from None
    write(to_yaml(best))
    if not driven:
        note(f"{folder} holds the {config.trials} trials that were asked for: none was driven")
    _tell(folder)


def _tell(folder: FilePath) -> None:
    """Write the drawing and the page, and say what was chosen at what price."""
    from steersman.report.tuning import chosen_words, spent_words, write_tuning
    from steersman.studies.trials import TuningTrials

    trade = TuningTrials.read(folder / "pareto.json")
    if not write_tuning(trade, folder):
        note(f"no report.html: it needs {how_to_install('report')}")
    note(chosen_words(trade))
    note(spent_words(trade))
