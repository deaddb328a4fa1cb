"""``steersman demo``: train, drive what was never seen, compare, report."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated, Any

import typer

from steersman import files
from steersman.cli import settings, train
from steersman.cli.outcome import INTERRUPTED
from steersman.cli.output import note, show, table

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman demo --out runs/demo\n"
    "  steersman demo seed=1 --out runs/demo1\n"
    "  steersman demo --preset demo --out runs/ddpg\n"
    "  steersman demo --policy runs/agent/policy.onnx --out runs/demo2"
)
# What the terminal shows of the table; the report has all of it.
_SHOWN = {
    "test": "test",
    "driver": "driver",
    "ale_mm": "|d| mm",
    "steer_std": "SD",
    "aoe_deg": "head",
    "speed": "m/s",
    "a_y": "a_y",
}
_LEGEND = """
|d|: mean lateral error of the whole run. SD: of normalised steering. head: mean
heading error [deg], nearly all of it the car's own side-slip. a_y: largest
lateral acceleration [m/s^2]. The paper gives no speeds; 9.9 to 24.2 m/s are
inferred from its heading errors. MPC-PID is tuned for 30 km/h; sched. has a
model for each speed. mpc_delay est. is estimated/tuned/mpc_delay, the classical
controller with the least error in a typical scenario of results/bench. oracle:
the best steering for the true car when the whole drive is known beforehand.
"""


def demo(
    out: settings.Out = "runs/demo",
    policy: Annotated[
        str | None,
        typer.Option("--policy", metavar="FILE", help="Drive this policy instead of training."),
    ] = None,
    preset: Annotated[
        str,
        typer.Option(
            "--preset",
            metavar="NAME",
            help="What is trained: apg, by the simulator's derivatives; or demo, DDPG with MPC-PID"
            " demonstrating.",
        ),
    ] = "apg",
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[key=value ...]", help="Settings over the preset."),
    ] = None,
) -> None:
    """Train an agent and compare it with classical controllers where none of them has been.

    Trains a few minutes, drives the circle of radius 50 m and a lap of Monza with the agent, with
    MPC-PID, with the best classical controller and with the best steering that an optimisation
    finds, prints the table beside the paper's figures, and writes policy, resolved configuration,
    episodes and report.html.
    """
    from steersman.commands import existing

    given = existing(policy) if policy else None
    folder = files.out_folder(out)
    try:
        file = given or _train(preset, words or [], folder)
        rows = _drive(file, folder)
    except KeyboardInterrupt:
        note(f"interrupted; what was done until then is in {folder}")
        raise typer.Exit(INTERRUPTED) from None
    from steersman.report.html import write_report
    from steersman.report.runs import load_runs

    report = write_report(load_runs([folder]), folder / "report.html", "Steersman: the demo")
    _show(rows, folder, report)


def _train(preset: str, words: list[str], folder: FilePath) -> FilePath:
    import steersman as sm

    config = sm.configure("train", preset, *words, notify=note)
    return train.train_with_bar(config, folder / "training", overwrite=True).policy


def _drive(policy: FilePath, folder: FilePath) -> list[dict[str, Any]]:
    from steersman.studies.demo import drive_tests

    return drive_tests(policy, folder)


def _show(rows: list[dict[str, Any]], folder: FilePath, report: FilePath) -> None:
    from steersman.studies.demo import COLUMNS, cells

    headers = list(_SHOWN.values())
    out = table(*headers, right=tuple(headers[2:]))
    for column in out.columns:
        column.no_wrap = True
    unfinished = []
    before = ""
    for row, texts in zip(rows, cells(rows), strict=True):
        values = dict(zip(COLUMNS, texts, strict=True))
        if not row["completed"]:
            values["ale_mm"] += "*"
            unfinished.append(
                f"* {row['test']}, {row['driver']}: {values['end']} after {row['duration_s']:.1f} s"
            )
        # A test's name stands once, before the first of its drives.
        values["test"], before = ("" if row["test"] == before else values["test"]), row["test"]
        out.add_row(*(values[key] for key in _SHOWN))
    written = f"policy, config, episodes: {folder}\nreport: {report}"
    show(out, "\n".join(["", *unfinished]), _LEGEND, written)
