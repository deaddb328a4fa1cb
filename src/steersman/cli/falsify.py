"""``steersman falsify``: the mildest disturbance that takes a controller off the road."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.outcome import goes_on
from steersman.cli.output import TOLD, note, show, show_json, steps_bar, table

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman falsify controller=mpc_pid --out runs/falsify\n"
    "  steersman falsify controller=lqr path=figure_eight speed.speed=11 duration=30 \\\n"
    "      --out runs/lqr\n"
    "  steersman falsify controller=policy plant=carla plant.port=2000 --out runs/carla\n"
    "  steersman falsify runs/tune/tuned.yaml ranges.mass=0 ranges.delay=0.3 --out runs/two\n"
    "\n"
    "The same command goes on where an interrupted search stopped."
)


def falsify(
    out: settings.Out,
    words: settings.Words = None,
    trials: Annotated[
        int | None,
        typer.Option("--trials", min=0, help="Drives over everything at once; as trials=N."),
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: settings.AsJson = False,
) -> None:
    """Search for the mildest disturbance that takes a controller off the road.

    Mass, friction, steering delay, waypoint noise and speed are disturbed, each within its range.
    Writes config.yaml, drives.jsonl (a line for each drive), falsify.json and report.html.
    """
    import steersman as sm
    from steersman.report.falsification import sentences, single_rows
    from steersman.studies.hunt import most_drives

    given = [*(words or []), *([] if trials is None else [f"trials={trials}"])]
    config = sm.configure("falsify", *given)
    with goes_on(out), steps_bar(most_drives(config), "falsifying", "drives", TOLD) as update:
        result = sm.falsify(
            *given,
            out=out,
            progress=lambda done, _, found: update(done, found),
            engine=engine,
            jobs=jobs,
            notify=note,
        )
    if as_json:
        show_json(result.plain())
        return
    if result.singles:
        show(_table(single_rows(result)), "")
    show(*sentences(result), f"written to {out}")


def _table(rows: list[dict[str, str]]) -> Any:
    columns = ("holds at", "fails at", "share of range")
    out = table("one disturbance alone", *columns, right=columns)
    for row in rows:
        out.add_row(row["name"], row["holds"], row["fails"], row["norm"])
    return out
