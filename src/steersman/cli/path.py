"""``steersman path``: paths as files of other programs, and the roads in such files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman import files
from steersman.cli import settings
from steersman.cli.outcome import OneLineGroup
from steersman.cli.output import note, show, show_json, table
from steersman.errors import ConfigError

if TYPE_CHECKING:
    from steersman.paths.base import PathComponent
    from steersman.paths.xodr.model import MapFault
    from steersman.paths.xodr.ways import Ways

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman path export monza --to monza.xodr\n"
    "  steersman path export circle radius=100 direction=right --to circle.xodr\n"
    "  steersman path export csv file=my_road.csv --to my_road.xodr --lane-width 3.5\n"
    "  steersman path export opendrive file=Town07.xodr route=[59,61] --to route.csv\n"
    "\n"
    "What can be set: steersman show path circle"
)
ROADS_EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman path roads Town07.xodr\n"
    "  steersman path roads Town07.xodr --json\n"
    "\n"
    "Then: steersman drive path=opendrive path.file=Town07.xodr path.route=[59,61]"
)
CHECK_EXAMPLES = (
    "\b\nExamples:\n  steersman path check Town07.xodr\n  steersman path check Town07.xodr --json"
)
GROUP_EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman path export monza --to monza.xodr\n"
    "  steersman path roads Town07.xodr\n"
    "  steersman path check Town07.xodr"
)
# A radius that says no more than that the road is straight [m].
_STRAIGHT = 1e4
# Faults of a map that are printed one by one.
_MOST_TOLD = 10


def export(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="KIND [key=value ...]",
            help="A kind of path (or a YAML file with a kind) and its settings.",
        ),
    ],
    to: Annotated[
        str, typer.Option("--to", metavar="FILE.xodr", help="The file to write; .csv: a table.")
    ],
    lane_width: Annotated[
        float, typer.Option("--lane-width", min=0.5, max=100.0, help="Width of the lane [m].")
    ] = 4.0,
    shoulder: Annotated[
        float, typer.Option(min=0.0, max=100.0, help="Width of the shoulders [m]; 0: none.")
    ] = 2.0,
) -> None:
    """Write a path as an OpenDRIVE road whose lane has it as its centre, or as a table (.csv).

    Height and banking go with it, where the path has them.
    """
    path = _path(words)
    file = files.out_file(to, "--to", (".xodr", ".csv"))

    from steersman.files import write_text
    from steersman.paths.table import csv_table
    from steersman.paths.xodr.write import opendrive

    if file.suffix == ".csv":
        text = csv_table(path)
    else:
        sizes = {"lane_width": lane_width, "shoulder": shoulder}
        text = opendrive(path, path.kind, **sizes, surface=path.surface())
    write_text(file, text)
    lap = "closed" if path.closed else "open"
    note(f"written: {file} ({path.kind}, {path.length:.1f} m, {lap})")


def roads(
    file: Annotated[
        str, typer.Argument(metavar="FILE.xodr|FILE.osm", help="An OpenDRIVE or a Lanelet2 map.")
    ],
    as_json: settings.AsJson = False,
) -> None:
    """List the roads of an OpenDRIVE map that have lanes to drive on, or the lanelets of a map."""
    if file.endswith(".osm"):
        _lanelets(file, as_json)
        return
    from steersman.paths.xodr.read import read_network
    from steersman.paths.xodr.ways import Ways

    ways = Ways(read_network(FilePath(file)))
    found = {name: row for name in ways.network.roads if (row := _road(ways, name))}
    lost = (ways.fault(place) for place in ways.graph.all())
    _tell_left_out([*ways.network.left_out, *(fault for fault in lost if fault is not None)])
    if as_json:
        show_json(found)
        return
    columns = ("length [m]", "radius [m]")
    rows = table("road", "lanes", *columns, "leads to", right=columns)
    for name, row in found.items():
        radius = "" if row["radius_m"] is None else f"{row['radius_m']:.1f}"
        lanes, onward = (", ".join(map(str, row[key])) for key in ("lanes", "leads_to"))
        rows.add_row(name, lanes, f"{row['length_m']:.1f}", radius, onward)
    show(rows, "", "radius: that of the sharpest bend of its lanes")


def check(
    file: Annotated[str, typer.Argument(metavar="FILE.xodr", help="An OpenDRIVE map.")],
    as_json: settings.AsJson = False,
) -> None:
    """List what is wrong with an OpenDRIVE map, by road and place on it [m].

    The exit code is 1 if anything is found.
    """
    from steersman.paths.xodr.check import faults
    from steersman.paths.xodr.read import read_network
    from steersman.paths.xodr.ways import Ways

    found = faults(Ways(read_network(FilePath(file))))
    if as_json:
        show_json([fault._asdict() for fault in found])
    elif found:
        rows = table("road", "s [m]", "what is wrong", right=("s [m]",))
        for fault in found:
            rows.add_row(fault.road, "" if fault.s is None else f"{fault.s:.1f}", fault.text)
        show(rows, "", f"{len(found)} found; all else can be driven")
    else:
        note(f"{file}: nothing is wrong")
    if found:
        raise typer.Exit(1)


def _tell_left_out(found: Sequence[MapFault]) -> None:
    """A line for each element that is left out; of many, the first."""
    for fault in found[:_MOST_TOLD]:
        note(str(fault))
    if len(found) > _MOST_TOLD:
        note(f"and {len(found) - _MOST_TOLD} more; 'steersman path check' lists all")


def _lanelets(file: str, as_json: bool) -> None:
    from steersman.paths.lanelet2_path import read_lanelets

    found = read_lanelets(FilePath(file)).lanelets
    if as_json:
        keys = ("subtype", "leads_to")
        rows = {
            k: {"length_m": v.length, **{n: getattr(v, n) for n in keys}} for k, v in found.items()
        }
        show_json(rows)
        return
    lines = table("lanelet", "kind", "length [m]", "leads to", right=("length [m]",))
    for name, row in found.items():
        lines.add_row(name, row.subtype, f"{row.length:.1f}", ", ".join(row.leads_to))
    show(lines)


def _road(ways: Ways, name: str) -> dict[str, Any] | None:
    """A road's length, lanes, sharpest bend and what its lanes lead to; None without lanes."""
    places = [place for place in ways.graph.of_road(name) if ways.fault(place) is None]
    if not places:
        return None
    radius = min(ways.radius(place) for place in places)
    onward = {other.road: None for place in places for other in ways.next(place)}
    return {
        "length_m": ways.network.roads[name].length,
        "lanes": sorted({place.lane for place in places}, reverse=True),
        "radius_m": radius if radius < _STRAIGHT else None,
        "leads_to": [other for other in onward if other != name],
    }


def _path(words: list[str]) -> PathComponent:
    """The path that the words name, built."""
    from steersman.commands import split
    from steersman.config import override, resolve
    from steersman.paths.base import PathComponent

    name, assignments = split(words)
    if name is None:
        raise ConfigError(f"{words[0]!r} is a setting; first comes the kind of path, e.g. circle")
    path = resolve("path", override({"kind": name}, assignments))
    assert isinstance(path, PathComponent)  # the registry holds nothing else under "path"
    _ = path.table  # so that a fault in it is reported before a folder is made
    return path


app = typer.Typer(
    cls=OneLineGroup,
    rich_markup_mode=None,
    add_completion=False,
    help="Paths and roads as OpenDRIVE.",
    epilog=GROUP_EXAMPLES,
)
app.command("export", epilog=EXAMPLES)(export)
app.command("roads", epilog=ROADS_EXAMPLES)(roads)
app.command("check", epilog=CHECK_EXAMPLES)(check)
