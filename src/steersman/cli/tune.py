"""``steersman tune``: search a controller's gains."""

from __future__ import annotations

from typing import Annotated

import typer

from steersman.cli import settings
from steersman.cli.outcome import goes_on
from steersman.cli.output import TOLD, note, steps_bar, write

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman tune controller=mpc_pid --trials 200 --out runs/tune\n"
    "  steersman tune controller=pid controller.feedforward=true --out runs/tune_pid\n"
    "\n"
    "The same command goes on where an interrupted study stopped."
)


def tune(
    out: settings.Out,
    words: settings.Words = None,
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
    driven = False
    said: list[str] = []
    with goes_on(out), steps_bar(config.trials, "tuning", "trials", TOLD) as update:

        def tell(done: int, cost: float) -> None:
            nonlocal driven
            driven = True
            update(done, f"cost {1e3 * cost:.4g} mm")

        best = sm.tune(config, out=out, progress=tell, engine=engine, jobs=jobs, notify=said.append)
    write(to_yaml(best.controller))
    if not driven:
        note(f"{out} holds the {config.trials} trials that were asked for: none was driven")
    for text in said:
        note(text)
