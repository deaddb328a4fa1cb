"""``steersman bench``: every controller over the same scenarios, and their ranking."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.outcome import INTERRUPTED
from steersman.cli.output import (
    TOLD,
    animated,
    note,
    share_bar,
    show,
    show_json,
    table,
    tell_compiling,
)
from steersman.errors import ConfigError, how_to_install

if TYPE_CHECKING:
    from steersman.bench.maps import Map
    from steersman.bench.results import BenchResult, IntervalEstimate
    from steersman.bench.suite import Suite

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman bench --out runs/bench\n"
    "  steersman bench quick --controllers pid,mpc_pid --out runs/quick\n"
    "  steersman bench maps --maps my_maps --out runs/maps\n"
    "  steersman bench --controllers tuned/lqr,ff=runs/pid/tuned.yaml,runs/demo/policy.onnx \\\n"
    "      --seeds 7 --out runs/bench\n"
    "  steersman bench quick plant=carla plant.port=2000 --out runs/carla\n"
    "\n"
    "The same command goes on where an interrupted one stopped; in the same folder, further\n"
    "controllers cost only their own runs."
)


def bench(
    out: Annotated[
        str, typer.Option("--out", metavar="DIR", help="Folder for rows, results and report.")
    ],
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SUITE] [key=value ...]",
            help="standard, core, tuning, quick, maps, or a YAML file; and settings over it.",
        ),
    ] = None,
    controllers: Annotated[
        list[str] | None,
        typer.Option(
            "--controllers",
            metavar="LIST",
            help="Kinds, tuned/NAME, YAML files or policies' ONNX files, each also as name=...;"
            " separated by commas. Without it: all tuned ones and the policies of the package.",
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
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json.")] = False,
) -> None:
    """Drive every controller through the same scenarios, and compare them.

    Writes rows.jsonl (a line for each run), results.parquet, results.json, suite.yaml and
    report.html. A controller that leaves the road is charged the corridor's half width for all
    that it did not drive.
    """
    from steersman.bench.entrants import entrants
    from steersman.bench.results import RESULTS
    from steersman.bench.suites import write_suite
    from steersman.bench.summary import results
    from steersman.cli.seeds import parse
    from steersman.commands import split

    named = [word for text in controllers or [] for word in text.split(",") if word.strip()]
    numbers = parse(seeds)
    name, assignments = split(words or [])
    suite = name or "standard"
    plan, read = _plan(suite, assignments, maps)
    engine, jobs = settings.workers_for(plan.plant, engine, jobs)
    found = entrants(named)
    settings.tell_plant(plan.plant)
    folder = settings.out_folder(out)
    tell_compiling()
    scenarios = plan.scenarios(numbers)
    _tell(plan, scenarios, plan.left_out(numbers))
    rows = _drive(scenarios, found, folder, jobs, engine)
    outcome = results(suite, plan, numbers, rows, found, read)
    outcome.write(folder / RESULTS)
    write_suite(plan, folder)
    _extras(folder, outcome, rows, scenarios, found)
    if as_json:
        show_json(outcome.plain())
    else:
        _show(outcome, folder)


def _plan(suite: str, assignments: Sequence[str], folder: str | None) -> tuple[Suite, list[Map]]:
    """The suite, with the courses over the maps in a folder if there is one."""
    from steersman.bench.maps import ALONE, read_maps, with_maps
    from steersman.bench.suites import laid_over
    from steersman.bench.suites import suite as read_suite

    if folder is None:
        if suite == ALONE:
            raise ConfigError("the suite 'maps' needs a folder of OpenDRIVE maps: --maps DIR")
        return read_suite(suite, assignments), []
    base = None if suite == ALONE else read_suite(suite)
    found = read_maps(FilePath(folder))
    for each in found:
        note(each.described())
    return laid_over(with_maps(base, found), assignments), found


def _tell(plan: Any, scenarios: Any, left_out: dict[str, int]) -> None:
    """Which scenarios the plant cannot do.

    Raises:
        ConfigError: it can do none.
    """
    kind = plan.plant.kind
    if not scenarios:
        raise ConfigError(f"plant={kind} can do none of its scenarios", ("suite",))
    if left_out:
        names = ", ".join(left_out)
        note(f"plant={kind} cannot do {sum(left_out.values())} scenarios, left out: {names}")


def _extras(folder: FilePath, outcome: BenchResult, rows: Any, scenarios: Any, found: Any) -> None:
    """The table and the page, each if its extra is installed."""
    from steersman.bench.replay import median_cases, worst_cases
    from steersman.bench.results import write_table

    if write_table(rows, folder) is None:
        note(f"no results.parquet: it needs {how_to_install('bench')}")
    if find_spec("jinja2") is None:
        note(f"no report.html: it needs {how_to_install('report')}")
        return
    from steersman.report.benchmark import write_benchmark

    cases = [*worst_cases(rows, scenarios, found), *median_cases(rows, scenarios, found)]
    write_benchmark(outcome, cases, folder / "report.html")


def _drive(
    scenarios: Any, found: Any, folder: FilePath, jobs: int | None, engine: str | None
) -> Any:
    from steersman.bench.runner import bench as run

    title = f"{len(scenarios)} scenarios x {len(found)} controllers"
    try:
        with suite_progress(title) as progress:
            return run(scenarios, found, folder, engine=engine, jobs=jobs, progress=progress)
    except KeyboardInterrupt:
        note(f"interrupted; the same command goes on from {folder}")
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def suite_progress(title: str) -> Iterator[Callable[[float, float], None]]:
    """A function of (simulated seconds done, in all) that draws a bar, or now and then a line."""
    note(title)
    if animated():
        with share_bar("driving") as update:
            assert update is not None  # it is where stderr is a terminal
            yield lambda done, total: update(done / max(total, 1.0))
        return
    shown = 0.0

    def line(done: float, total: float) -> None:
        nonlocal shown
        if done >= shown + TOLD * total or done >= total:
            shown = done
            share = 100.0 * done / max(total, 1.0)
            note(f"{share:.0f} % of {total / 60.0:.0f} simulated minutes")

    yield line


def _show(outcome: BenchResult, folder: FilePath) -> None:
    summary = outcome.summary
    best = summary.best_classical
    columns = ("clean", "disturbed", "failed", "steering", "step", "ratio")
    out = table("controller", *columns, right=columns)
    for name, found in summary.controllers.items():
        ratio = None if found.ratio is None else found.ratio["all"].rms
        out.add_row(
            name,
            _interval(found.clean.rms_m, 1e3),
            _interval(found.disturbed.rms_m, 1e3),
            str(found.failures),
            _number(found.steer_change_rms, 1e3),
            _number(found.control_time_us_p50),
            "" if ratio is None else _interval(ratio),
        )
    notes = (
        f"{summary.scenarios} scenarios on {summary.paths} paths; 95 % intervals of a"
        " bootstrap over paths. clean, disturbed: RMS lateral error [mm]; failed: runs"
        " that ended early, charged in all errors; steering: RMS change in a step [1/1000];"
        " step: median computing time [us]"
    )
    if best is not None:
        notes += f"; ratio: RMS error over that of {best}, the best classical controller"
    notes += "."
    show(out, "", notes, f"written to {folder}")


def _number(value: float | None, factor: float = 1.0) -> str:
    if value is None:
        return "-"
    text = f"{factor * value:.3g}"
    return f"{factor * value:.0f}" if "e+" in text else text


def _interval(found: IntervalEstimate, factor: float = 1.0) -> str:
    value, low, high = (_number(v, factor) for v in (found.value, found.low, found.high))
    return value if found.low is None else f"{value}\n{low}..{high}"
