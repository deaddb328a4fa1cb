"""``steersman path``: paths as files of other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.output import note
from steersman.errors import ConfigError

if TYPE_CHECKING:
    from steersman.paths.base import PathComponent

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman path export monza --to monza.xodr\n"
    "  steersman path export circle radius=100 direction=right --to circle.xodr\n"
    "  steersman path export csv file=my_road.csv --to my_road.xodr --lane-width 3.5\n"
    "\n"
    "What can be set: steersman show path circle"
)
GROUP_EXAMPLES = "\b\nExamples:\n  steersman path export monza --to monza.xodr"


def export(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="KIND [key=value ...]",
            help="A kind of path (or a YAML file with a kind) and its settings.",
        ),
    ],
    to: Annotated[str, typer.Option("--to", metavar="FILE.xodr", help="The file to write.")],
    lane_width: Annotated[
        float, typer.Option("--lane-width", min=0.5, max=100.0, help="Width of the lane [m].")
    ] = 4.0,
    shoulder: Annotated[
        float, typer.Option(min=0.0, max=100.0, help="Width of the shoulders [m]; 0: none.")
    ] = 2.0,
) -> None:
    """Write a path as an OpenDRIVE road whose lane has the path as its centre."""
    path = _path(words)
    file = settings.out_file(to, "--to")

    from steersman.files import write_text
    from steersman.paths.xodr.write import opendrive

    text = opendrive(path, path.kind, lane_width=lane_width, shoulder=shoulder)
    write_text(file, text)
    lap = "closed" if path.closed else "open"
    note(f"written: {file} ({path.kind}, {path.length:.1f} m, {lap})")


def _path(words: list[str]) -> PathComponent:
    """The path that the words name, built."""
    from steersman.config import override, read_yaml, resolve
    from steersman.paths.base import PathComponent

    name, assignments = settings.split(words)
    if name is None:
        raise ConfigError(f"{words[0]!r} is a setting; first comes the kind of path, e.g. circle")
    fields: dict[str, Any] = {"kind": name}
    if name.endswith((".yaml", ".yml")):
        fields = read_yaml(settings.existing(name))
    path = resolve("path", override(fields, assignments))
    assert isinstance(path, PathComponent)  # the registry holds nothing else under "path"
    _ = path.table  # so that a fault in it is told before a folder is made
    return path
