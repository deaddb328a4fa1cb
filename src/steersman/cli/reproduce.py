"""``steersman reproduce``: the paper's trainings, tables and figures, measured anew."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import Annotated

import typer

from steersman import files
from steersman.cli import settings
from steersman.cli.outcome import goes_on
from steersman.cli.output import animated, note, steps_bar, write
from steersman.errors import ConfigError, counted

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman reproduce --out runs/paper\n"
    "  steersman reproduce --quick --out runs/quick\n"
    "  steersman reproduce --published --methods ddpg,adaptive --seeds 3 --out runs/a\n"
    "  steersman reproduce --published --methods reward,both --seeds 3 --out runs/b\n"
    "  steersman reproduce --join runs/a,runs/b --out runs/published\n"
    "\n"
    "The same command goes on where an interrupted one stopped."
)
_SHARES = 1000


def reproduce(  # noqa: PLR0913, PLR0917 - a parameter for each option
    out: settings.Out,
    quick: Annotated[
        bool, typer.Option("--quick", help="Smoke run: every stage, nearly nothing in it.")
    ] = False,
    published: Annotated[
        bool,
        typer.Option(
            "--published",
            help="Trainings as published: 200 000 updates, one after each step of one vehicle.",
        ),
    ] = False,
    methods: Annotated[
        str | None,
        typer.Option("--methods", metavar="NAME,...", help="Only these methods of the plan."),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option("--seeds", min=1, metavar="N", help="At most so many seeds of each method."),
    ] = None,
    other_version: Annotated[
        bool,
        typer.Option(
            "--other-version",
            help="Go on although another version began; results.json names all of them.",
        ),
    ] = False,
    join: Annotated[
        str | None,
        typer.Option(
            "--join",
            metavar="DIR,...",
            help="Train and drive nothing: put finished parts, each of other methods, on one page.",
        ),
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
) -> None:
    """Run the paper's experiments on the embedded simulator, and put its figures beside them.

    Trains two agents at a time (or --jobs), drives all tests, and writes results.json, plots/ and
    report.html, which puts what was measured beside the paper. What is finished is not done again.
    Methods and tests: docs/reproduce.md.
    """
    import ddpg_mpc_pid as study

    if quick and published:
        raise ConfigError("--quick and --published are two plans; give one of them")
    if join is not None:
        decided = {"quick": quick, "published": published, "methods": methods, "seeds": seeds}
        for name in (name for name, value in decided.items() if value):
            raise ConfigError(f"--join and --{name}: the parts have their plan; leave out --{name}")
        folder = files.out_folder(out)
        results = study.join([FilePath(part) for part in join.split(",") if part], folder)
    else:
        plan = study.quick() if quick else study.published() if published else study.full()
        plan = study.only(plan, tuple(methods.split(",")) if methods else None, seeds)
        folder = files.out_folder(out)
        work = study.estimate(plan)
        note(
            f"{counted(work.trainings, 'training')} of {work.updates} updates and their tests: "
            f"about {max(work.minutes, 1.0):.0f} min on 2 cores, if nothing is done yet"
        )
        with goes_on(str(folder)), _progress() as progress:
            results = study.reproduce(
                plan,
                folder,
                progress,
                note,
                other_version=other_version,
                engine=engine,
                at_once=jobs,
            )
    page = study.write_page(results, folder / "report.html")
    write(f"results: {folder / 'results.json'}\nreport: {page}\n")


@contextmanager
def _progress() -> Iterator[Callable[[int, int, float, str], None]]:
    """A function of the trainings' progress that draws a bar, or now and then a line."""
    if not animated():
        yield _lines()
        return
    with steps_bar(_SHARES, "trainings") as update:

        def progress(done: int, of: int, share: float, text: str) -> None:
            update(_SHARES * share, f"{done}/{of} trainings; {text}")

        yield progress


def _lines() -> Callable[[int, int, float, str], None]:
    """Writes progress to a log: a line for every percent, with the time left."""
    begun, first, last = time.monotonic(), -1.0, -1.0

    def progress(done: int, of: int, share: float, text: str) -> None:
        nonlocal first, last
        first = share if first < 0.0 else first
        if share < last + 0.01 and share < 1.0:
            return
        last = share
        spent = time.monotonic() - begun
        left = spent * (1.0 - share) / (share - first) / 60.0 if share > first else math.nan
        rest = f", {left:.0f} min left" if math.isfinite(left) else ""
        note(f"{100 * share:.0f} % ({done}/{of} trainings{rest}); {text}")

    return progress
