"""``steersman compare``: drives, trainings, benchmarks or controllers side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from steersman.cli import settings
from steersman.cli.outcome import goes_on
from steersman.cli.output import note, show, show_json, suite_progress, table

if TYPE_CHECKING:
    from steersman.studies.compare.replicates import ReplicatedComparison
    from steersman.studies.compare.results import AnyComparison, DriveCompareResult

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman compare pid tuned/mpc_delay policy\n"
    "  steersman compare tuned/lqr mine=runs/tune_pid suite=core --out runs/lqr_or_pid\n"
    "  steersman compare runs/monza_mpc runs/monza_agent --out runs/monza_both\n"
    "  steersman compare runs/monza_mpc tuned/stanley      (drives what was driven there)\n"
    "  steersman compare runs/agent runs/agent2 --json     (the policies of two trainings)\n"
    "  steersman compare tuned/lqr ddpg=runs/five td3=runs/five_td3   (folders of seeds)\n"
    "  steersman compare runs/bench:lqr,pid\n"
    "  steersman compare tuned/lqr tuned/stanley path=figure_eight duration=30\n"
    "\n"
    "The first is what the others are compared with."
)
# Columns of figures that fit beside their meaning.
_COLUMNS = 4


def compare(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="A B... [suite=SUITE | path=PATH] [key=value ...]",
            help="Folders or .npz files of drives; folders of trainings or tunings,"
            " also with several seeds, or of benchmarks;"
            " controllers as 'steersman bench' takes them; each also as name=...",
        ),
    ],
    out: settings.OptionalOut = None,
    seeds: Annotated[
        str | None, typer.Option("--seeds", metavar="LIST", help="Seeds of the suite: 0..4 (0).")
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: settings.AsJson = False,
) -> None:
    """Set drives, trainings, benchmarks or controllers side by side.

    Controllers and trainings drive the same scenarios of a suite (quick by default), or one drive
    if it has settings of one (path=track.csv laps=1). Saved drives
    are compared place by place along their path, and a controller among them drives what the
    first one drove. Differences and ratios are paired and have 95 % bootstrap intervals.
    """
    import steersman as sm

    with goes_on(out), suite_progress() as progress:
        outcome = sm.compare(
            *words, seeds=seeds, out=out, engine=engine, jobs=jobs, progress=progress, notify=note
        )
    for line in outcome.warnings:
        note(f"note: {line}")
    if as_json:
        show_json(outcome.plain())
    else:
        _show(outcome, out)


def _show(outcome: AnyComparison, folder: str | None) -> None:
    from steersman.report.comparison import headers, legend, rows, sentences

    who = table("", "name", "from")
    for line in legend(outcome):
        who.add_row(*line)
    show(who)
    if outcome.sort == "drives":
        _show_metrics(outcome)
    elif outcome.replicates is not None:
        _show_replicates(outcome.replicates)
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


def _show_replicates(found: ReplicatedComparison) -> None:
    from steersman.report.comparison import replicate_rows, replicate_words

    lines = replicate_rows(found, "\n")
    out = table(*lines[0], right=tuple(lines[0])[1:])
    for line in lines:
        out.add_row(*line.values())
    show("", replicate_words(found), "", out)


def _show_metrics(outcome: DriveCompareResult) -> None:
    """All metrics of all drives, so many to a table as fit."""
    from steersman.metrics.base import metrics, readable
    from steersman.report.tables import text

    sides = outcome.contestants
    for first in range(0, len(sides), _COLUMNS):
        some = sides[first : first + _COLUMNS]
        letters = [one.letter for one in some]
        out = table("measured", "unit", *letters, right=tuple(letters))
        found = [outcome.metrics[one.name] for one in some]
        out.add_row("ended by", "-", *(str(m["end"]).replace("_", " ") for m in found))
        for name, metric in metrics().items():
            shown = [readable(metric, m.get(name)) for m in found]
            out.add_row(metric.meaning, shown[0][0], *(text(value) for _, value in shown))
        show("", out)
