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
    "  steersman tune lqr --car my_car.yaml --road my_track.csv --out runs/lqr\n"
    "  steersman tune mpc_pid seeds=0..2 --trials 200 --out runs/mpc_pid\n"
    "  steersman tune pid controller.feedforward=true suite=my_suite.yaml --out runs/pid\n"
    "\n"
    "The same command goes on where an interrupted study stopped."
)


def tune(
    out: settings.Out,
    words: settings.Words = None,
    car: Annotated[
        str | None,
        typer.Option("--car", metavar="CAR", help="A vehicle or its YAML file; as vehicle=CAR."),
    ] = None,
    road: Annotated[
        str | None,
        typer.Option("--road", metavar="ROAD", help="A path or its file; the same as road=ROAD."),
    ] = None,
    trials: Annotated[
        int | None, typer.Option("--trials", min=1, help="Trials in all; the same as trials=N.")
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
) -> None:
    """Tune a controller's gains with Optuna on a suite of runs.

    Without suite=... that is the suite 'tuning', which holds every kind of disturbance; --car and
    --road put it on a car and a road of your own. seeds=0..2 searches with three seeds, into
    seed_0 and so on; tuned.yaml is then the one of the median cost.

    Writes study.jsonl, tuned.yaml (the best controller), result.json (with the simulated seconds
    that the tuning cost), and the trials' errors against their steering activity: pareto.json,
    pareto.svg and report.html.
    """
    import steersman as sm
    from steersman.config import to_yaml
    from steersman.ranges import split_seeds

    given = {"vehicle": car, "road": road, "trials": trials}
    seeds, others = split_seeds(words or [])
    more = [f"{name}={value}" for name, value in given.items() if value is not None]
    config = sm.configure("tune", *more, *others)
    total = config.trials * len(seeds or (0,))
    driven = False
    said: list[str] = []
    with goes_on(out), steps_bar(total, "tuning", "trials", TOLD) as update:

        def tell(done: int, cost: float) -> None:
            nonlocal driven
            driven = True
            update(done, f"cost {1e3 * cost:.4g} mm")

        best = sm.tune(
            config,
            out=out,
            seeds=seeds,
            progress=tell,
            engine=engine,
            jobs=jobs,
            notify=lambda text: note(text) if text.startswith("warning") else said.append(text),
        )
    write(to_yaml(best.controller))
    if not driven:
        note(f"{out} holds the {total} trials that were asked for: none was driven")
    for text in said:
        note(text)
