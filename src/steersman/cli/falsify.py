"""``steersman falsify``: the mildest disturbance that takes a controller off the road."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.outcome import INTERRUPTED
from steersman.cli.output import TOLD, note, show, show_json, steps_bar, table, tell_compiling
from steersman.errors import how_to_install

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
    out: Annotated[
        str, typer.Option("--out", metavar="DIR", help="Folder for the drives and the result.")
    ],
    words: Annotated[
        list[str] | None, typer.Argument(metavar=settings.METAVAR, help=settings.HELP)
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option("--trials", min=0, help="Drives over everything at once; as trials=N."),
    ] = None,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print falsify.json.")] = False,
) -> None:
    """Search for the mildest disturbance that takes a controller off the road.

    Mass, friction, steering delay, waypoint noise and speed are disturbed, each within its range.
    Writes config.yaml, drives.jsonl (a line for each drive), falsify.json and report.html.
    """
    import steersman as sm
    from steersman.report.falsification import sentences, single_rows, write_falsification
    from steersman.studies.hunt import most_drives

    given = [] if trials is None else [f"trials={trials}"]
    config = sm.configure("falsify", *(words or []), *given, notify=note)
    engine, jobs = settings.workers_for(config.plant, engine, jobs)
    settings.tell_plant(config.plant)
    folder = settings.out_folder(out)
    tell_compiling()
    try:
        with steps_bar(most_drives(config), "falsifying", "drives", TOLD) as update:
            result = sm.falsify(
                config,
                out=folder,
                progress=lambda done, _, found: update(done, found),
                engine=engine,
                jobs=jobs,
            )
    except KeyboardInterrupt:
        note(f"interrupted; the same command goes on from {folder}")
        raise typer.Exit(INTERRUPTED) from None
    if not write_falsification(result, folder / "report.html"):
        note(f"no report.html: it needs {how_to_install('report')}")
    if as_json:
        show_json(result.plain())
        return
    if result.singles:
        show(_table(single_rows(result)), "")
    show(*sentences(result), f"written to {folder}")


def _table(rows: list[dict[str, str]]) -> Any:
    columns = ("holds at", "fails at", "share of range")
    out = table("one disturbance alone", *columns, right=columns)
    for row in rows:
        out.add_row(row["name"], row["holds"], row["fails"], row["norm"])
    return out
