"""``steersman bench``: every controller over the same scenarios, and their ranking."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from steersman.cli import settings
from steersman.cli.outcome import goes_on
from steersman.cli.output import console, note, show, show_json, suite_progress, table
from steersman.errors import counted, three_digits

if TYPE_CHECKING:
    from steersman.bench.results import BenchResult, ControllerSummary, IntervalEstimate

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman bench --out runs/bench\n"
    "  steersman bench quick --controllers pid,mpc_pid --out runs/quick\n"
    "  steersman bench maps --maps my_maps --out runs/maps\n"
    "  steersman bench foreign --tracks circuits --maps my_maps --tum tum --out runs/foreign\n"
    "  steersman bench --controllers tuned/lqr,ff=runs/pid/tuned.yaml,runs/demo/policy.onnx \\\n"
    "      --seeds 7 --out runs/bench\n"
    "  steersman bench quick plant=carla plant.port=2000 --out runs/carla\n"
    "\n"
    "The same command goes on where an interrupted one stopped; in the same folder, further\n"
    "controllers cost only their own runs."
)

# Columns that are left out where a terminal is too narrow, the first first.
_LAST = ("steer", "step", "typical", "regret")


def bench(  # noqa: PLR0913, PLR0917 - typer's options
    out: settings.Out,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SUITE] [key=value ...]",
            help="standard, core, standard_1, core_1, tuning, quick, faults, beyond_grip, acc,"
            " acc_tuning, maps, foreign, or a YAML file; and settings over it.",
        ),
    ] = None,
    controllers: Annotated[
        list[str] | None,
        typer.Option(
            "--controllers",
            metavar="LIST",
            help="Kinds, tuned/NAME, YAML files, policies' ONNX files or folders of tunings and"
            " trainings, those with several seeds too, each also as name=...; separated by"
            " commas. Without it: all tuned ones and the policies of the package.",
        ),
    ] = None,
    seeds: Annotated[
        str, typer.Option("--seeds", metavar="LIST", help="Seeds of all draws: 0..4 or 0,3,7.")
    ] = "0",
    maps: Annotated[
        str | None,
        typer.Option(
            "--maps",
            metavar="DIR",
            help="Adds seeded ways over every OpenDRIVE map (*.xodr) in this folder to the suite;"
            " the suite 'maps' holds them alone.",
        ),
    ] = None,
    tracks: Annotated[
        str | None,
        typer.Option("--tracks", metavar="DIR", help="Race circuits (*.csv) for 'foreign'."),
    ] = None,
    tum: Annotated[
        str | None,
        typer.Option("--tum", metavar="DIR", help="TUM-CONTROL's references (*.json), likewise."),
    ] = None,
    logs: Annotated[
        str | None, typer.Option("--logs", metavar="DIR", help="Recorded lines (*.csv), likewise.")
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: settings.AsJson = False,
) -> None:
    """Drive every controller through the same scenarios, and compare them.

    Writes rows.jsonl (a line for each run), results.parquet, results.json, suite.yaml and
    report.html. A controller that leaves the road is charged the corridor's half width for all
    that it did not drive.
    """
    import steersman as sm

    named = [word for text in controllers or [] for word in text.split(",") if word.strip()]
    with goes_on(out), suite_progress() as progress:
        outcome = sm.bench(
            *named,
            suite=words or "standard",
            seeds=seeds,
            maps=maps,
            tracks=tracks,
            tum=tum,
            logs=logs,
            out=out,
            engine=engine,
            jobs=jobs,
            progress=progress,
            notify=note,
        )
    if as_json:
        show_json(outcome.plain())
    else:
        _show(outcome, out)


def _show(outcome: BenchResult, folder: str) -> None:
    summary = outcome.summary
    best = summary.best_classical
    cells = {name: _cells(found) for name, found in summary.controllers.items()}
    columns, left_out = _fitting(cells)
    out = table("controller", *columns, right=tuple(columns))
    for name, row in cells.items():
        out.add_row(name, *(row[column] for column in columns))
    notes = (
        f"{counted(summary.scenarios, 'scenario')} on {counted(summary.paths, 'path')}; 95 %"
        " intervals of a bootstrap over paths, none over one path, and over seeds where a"
        " controller has several. clean, disturbed:"
        " RMS lateral error [mm]; typical: geometric mean of disturbed errors [mm]; lost: runs"
        " that ended early, charged in all errors; steer: change in a step [1/1000], RMS and"
        " under it the median; step: median computing time [us]; regret: median of"
        " error and price of steering [mm] beyond the oracle's, where there is one"
    )
    if best is not None:
        notes += f"; ratio: RMS error over that of {best}, the best classical controller"
    if "gap" in columns:
        notes += "; gap: RMS of the gap to the car ahead less the wished one [m]"
    if "jerk" in columns:
        notes += "; jerk: RMS, along the car, of drives behind another [m/s^3]"
    if "hit" in columns:
        notes += "; hit: runs that ended by a collision with it"
    notes += "."
    if any(one.beyond is not None for one in summary.controllers.values()):
        notes += " With a +: lost of the runs beyond grip, which no other column counts."
    if left_out:
        notes += f" A wider terminal has {', '.join(left_out)}, too; so has the page."
    show(out, "", notes, f"written to {folder}")


def _cells(found: ControllerSummary) -> dict[str, str]:
    """A controller's row by column."""
    return {
        "clean": _interval(found.clean.rms_m, 1e3),
        "disturbed": _interval(found.disturbed.rms_m, 1e3),
        "typical": _interval(found.disturbed.typical_m, 1e3),
        "lost": _lost(found),
        **_following(found),
        "steer": _steering(found),
        "step": _number(found.control_time_us_p50),
        "regret": "" if found.regret is None else _interval(found.regret.median_m, 1e3),
        "ratio": "" if found.ratio is None else _interval(found.ratio["all"].rms),
    }


def _following(found: ControllerSummary) -> dict[str, str]:
    """What tells of drives behind another car; empty where none was."""
    from steersman.episode import COLLISION
    from steersman.metrics.following import GAP_AND_JERK

    known = dict(zip(("gap", "jerk"), map(found.figures.get, GAP_AND_JERK), strict=True))
    shown = {name: _interval(one.rms) if one else "" for name, one in known.items()}
    return {"hit": f"{found.ends.get(COLLISION, 0)}/{found.runs}" if known["gap"] else "", **shown}


def _fitting(cells: Mapping[str, Mapping[str, str]]) -> tuple[list[str], list[str]]:
    """The columns that have something and room beside the names, and those without room."""
    rows = list(cells.values())
    columns = [name for name in rows[0] if any(row[name] for row in rows)]
    lines = {c: [c, *(line for row in rows for line in row[c].splitlines())] for c in columns}
    widths = {name: 2 + max(map(len, of)) for name, of in lines.items()}
    room = console(sys.stdout, like=sys.stdout).width - max(map(len, ["controller", *cells]))
    left_out: list[str] = []
    for name in _LAST:
        if sum(widths[c] for c in columns) > room and name in columns:
            columns.remove(name)
            left_out.append(name)
    return columns, left_out


def _number(value: float | None, factor: float = 1.0) -> str:
    if value is None:
        return "-"
    return three_digits(factor * value)


def _interval(found: IntervalEstimate | None, factor: float = 1.0) -> str:
    if found is None:
        return "-"
    value, low, high = (_number(v, factor) for v in (found.value, found.low, found.high))
    return value if found.low is None or low == high else f"{value}\n{low}..{high}"


def _lost(found: ControllerSummary) -> str:
    """Lost runs of all within grip, and under them of those beyond it."""
    beyond = found.beyond
    more = "" if beyond is None else f"\n+{beyond.failures}/{beyond.runs}"
    return f"{found.failures}/{found.runs}{more}"


def _steering(found: ControllerSummary) -> str:
    """Root mean square of the change in a step, and under it the median if it was kept."""
    known = found.figures.get("steer_change_rms")
    values = [found.steer_change_rms, *([] if known is None else [known.median.value])]
    return "\n".join(_number(value, 1e3) for value in values)
