"""``steersman compare``: drives, trainings, benchmarks or controllers side by side."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.bench import suite_progress
from steersman.cli.outcome import INTERRUPTED
from steersman.cli.output import note, show, show_json, table, tell_compiling
from steersman.errors import ConfigError, how_to_install

if TYPE_CHECKING:
    from steersman.studies.compare.contestants import Contestant
    from steersman.studies.compare.results import (
        AnyComparison,
        DriveCompareResult,
        ScenarioCompareResult,
    )

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman compare pid tuned/mpc_delay policy\n"
    "  steersman compare tuned/lqr mine=runs/tune_pid suite=core --out runs/lqr_or_pid\n"
    "  steersman compare runs/monza_mpc runs/monza_agent --out runs/monza_both\n"
    "  steersman compare runs/monza_mpc tuned/stanley      (drives what was driven there)\n"
    "  steersman compare runs/agent runs/agent2 --json     (the policies of two trainings)\n"
    "  steersman compare runs/bench:lqr,pid\n"
    "\n"
    "The first is what the others are compared with."
)
_OUT = "compare.json"
# Columns of figures that fit beside their meaning.
_COLUMNS = 4


def compare(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="A B... [suite=SUITE] [key=value ...]",
            help="Folders or .npz files of drives; folders of trainings, tunings or benchmarks;"
            " controllers as 'steersman bench' takes them; each also as name=...",
        ),
    ],
    out: Annotated[
        str | None,
        typer.Option("--out", metavar="DIR", help="Write compare.json and report.html there."),
    ] = None,
    seeds: Annotated[
        str | None, typer.Option("--seeds", metavar="LIST", help="Seeds of the suite: 0..4 (0).")
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print compare.json.")] = False,
) -> None:
    """Set drives, trainings, benchmarks or controllers side by side.

    Controllers and trainings drive the same scenarios of a suite (quick by default). Saved drives
    are compared place by place along their path, and a controller among them drives what the
    first one drove. Differences and ratios are paired and have 95 % bootstrap intervals.
    """
    from steersman.api.studies import suite_settings
    from steersman.cli.seeds import parse
    from steersman.studies.compare.contestants import contestants, sort_of

    named, chosen = suite_settings(words)
    numbers = None if seeds is None else parse(seeds)
    found = contestants(named)
    sort = sort_of(found)
    folder = None if out is None else _folder(out, found)
    tell_compiling()
    try:
        outcome: AnyComparison
        if sort == "drives":
            given = [*chosen.values(), *([] if seeds is None else ["--seeds"])]
            outcome, extra = _drives(found, given)
        else:
            outcome, extra = _scenarios(found, chosen, numbers, engine, jobs, folder)
    except KeyboardInterrupt:
        note("interrupted" + (f"; the same command goes on from {folder}" if folder else ""))
        raise typer.Exit(INTERRUPTED) from None
    for line in outcome.warnings:
        note(f"note: {line}")
    if folder is not None:
        _write(folder, outcome, extra)
    if as_json:
        show_json(outcome.plain())
    else:
        _show(outcome, folder)


def _folder(out: str, found: Sequence[Contestant]) -> FilePath:
    """The folder for results, which none of the contestants lies in."""
    folder = settings.out_folder(out)
    taken = {one.folder.resolve() for one in found if one.folder is not None}
    if folder.resolve() in taken:
        raise ConfigError(f"--out: {folder} is one of those compared; give another folder")
    return folder


def _drives(
    found: Sequence[Contestant], chosen: Sequence[str]
) -> tuple[DriveCompareResult, dict[str, Any]]:
    from steersman.studies.compare.drives import compare_drives

    if chosen:
        raise ConfigError(
            f"{chosen[0]}: drives are compared on what they drove; it goes with controllers"
        )
    result, episodes = compare_drives(found)
    return result, {"episodes": episodes}


def _scenarios(
    found: Sequence[Contestant],
    chosen: dict[str, str],
    seeds: list[int] | None,
    engine: str | None,
    jobs: int | None,
    folder: FilePath | None,
) -> tuple[ScenarioCompareResult, dict[str, Any]]:
    from steersman.studies.compare.scenarios import compare_scenarios, plan

    suite = chosen.get("suite", "").partition("=")[2].strip() or None
    over = plan(found, suite, [w for key, w in chosen.items() if key != "suite"], seeds)
    engine, jobs = settings.workers_for(over.suite.plant, engine, jobs)
    drivers = sum(one.entrant is not None for one in found)
    title = f"{len(over.scenarios)} scenarios x {drivers} controllers"
    with _place(folder) as place:
        if drivers:
            with suite_progress(title) as progress:
                result, cases = compare_scenarios(
                    found, over, place, engine=engine, jobs=jobs, progress=progress
                )
        else:
            result, cases = compare_scenarios(found, over, place)
    return result, {"cases": cases}


@contextmanager
def _place(folder: FilePath | None) -> Iterator[FilePath]:
    """Where rows are kept: in the folder for results, else nowhere for long."""
    if folder is not None:
        yield folder
        return
    with tempfile.TemporaryDirectory() as name:
        yield FilePath(name)


def _write(folder: FilePath, outcome: AnyComparison, extra: dict[str, Any]) -> None:
    outcome.write(folder / _OUT)
    if find_spec("jinja2") is None:
        note(f"no report.html: it needs {how_to_install('report')}")
        return
    from steersman.report.comparison import write_comparison

    write_comparison(outcome, folder / "report.html", **extra)


def _show(outcome: AnyComparison, folder: FilePath | None) -> None:
    from steersman.report.comparison import headers, legend, rows, sentences

    who = table("", "name", "from")
    for line in legend(outcome):
        who.add_row(*line)
    show(who)
    if outcome.sort == "drives":
        _show_metrics(outcome)
    for k in range(len(outcome.comparisons)):
        show("", *sentences(outcome, k))
        columns = headers(outcome, k)
        out = table(*columns.values(), right=tuple(columns.values())[1:])
        for row in rows(outcome, k, "\n"):
            out.add_row(*(row[key] for key in columns))
        if out.rows:
            show("", out)
    drawn = "paths" if outcome.sort == "scenarios" else "stretches of the path"
    show("", f"In brackets: 95 % intervals of a bootstrap over {drawn}.")
    if folder is not None:
        show(f"written to {folder}")


def _show_metrics(outcome: DriveCompareResult) -> None:
    """All metrics of all drives, so many to a table as fit."""
    from steersman.metrics.base import metrics
    from steersman.report.tables import text

    sides = outcome.contestants
    for first in range(0, len(sides), _COLUMNS):
        some = sides[first : first + _COLUMNS]
        letters = [one.letter for one in some]
        out = table("measured", "unit", *letters, right=tuple(letters))
        found = [outcome.metrics[one.name] for one in some]
        out.add_row("ended by", "-", *(str(m["end"]).replace("_", " ") for m in found))
        for name, metric in metrics().items():
            out.add_row(metric.meaning, metric.unit, *(text(m.get(name)) for m in found))
        show("", out)
