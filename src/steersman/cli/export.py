"""``steersman export``: a result in the format of another tool.

A target is a line in :data:`TARGETS`. To add one: a function that takes what the user named and
a folder that exists and is writable, writes into it and returns the files written (the one to name
first), and its line in the table. The function imports what it needs when it is called, and
raises a :class:`~steersman.errors.SteersmanError` about an input that is not what it takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path as FilePath
from typing import Annotated, NamedTuple

import typer

from steersman import files
from steersman.cli.dataset import home as dataset_home
from steersman.cli.output import note, write
from steersman.errors import ConfigError, DataError, SteersmanError, suggestion

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman export precision --to c --out build/precision\n"
    "  steersman export runs/agent/policy.onnx --to onnx --out delivery\n"
    "  steersman export runs/monza --to mcap\n"
    "  steersman export demo --to minari --out datasets\n"
    "\n"
    "\b\n"
)
POLICY = "a training's folder, a policy of the package, or an .onnx or .json file"
DRIVE = "a folder of steersman drive --out, or an episode's .npz file"
DATA = "a training's folder or preset (its demonstrator drives), a drive, or a ROS 2 recording"


class Target(NamedTuple):
    """A format that something can be exported to."""

    name: str
    """What --to says."""
    takes: str
    """What RUN may be, as the help says it."""
    makes: str
    """What is written, as the help says it."""
    write: Callable[[str, FilePath], Sequence[FilePath]]
    """From RUN and a folder to the files written into it, the one to name first."""
    home: Callable[[], str | None] = lambda: None
    """The folder without --out, if it is not ./NAME_TARGET."""


def _c(source: str, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.package import try_out, write_c

    files = write_c(source, folder)
    note(try_out(files[0]))
    return files


def _onnx(source: str, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.package import write_onnx

    return write_onnx(source, folder, note)


def _mcap(source: str, folder: FilePath) -> Sequence[FilePath]:
    from steersman.cli.recording import export_mcap

    return export_mcap(source, folder)


def _minari(source: str, folder: FilePath) -> Sequence[FilePath]:
    from steersman.cli.dataset import export_minari

    return export_minari(source, folder)


TARGETS = (
    Target("c", POLICY, "C99 source without dependencies, test vector, Makefile, card", _c),
    Target("onnx", POLICY, "the network as a checked ONNX file with its card", _onnx),
    Target("mcap", DRIVE, "a recording with ROS 2 messages", _mcap),
    Target("minari", DATA, "a dataset of what was seen and done", _minari, dataset_home),
)
EXAMPLES += "\n".join(f"  --to {t.name}: from {t.takes}: {t.makes}" for t in TARGETS)


def target(name: str) -> Target:
    """The target of that name.

    Raises:
        ConfigError: there is none.
    """
    known = {each.name: each for each in TARGETS}
    if name not in known:
        raise ConfigError(f"--to: unknown target {name!r}{suggestion(name, known)}")
    return known[name]


def export(
    run: Annotated[str, typer.Argument(metavar="RUN", help="What to export.")],
    to: Annotated[
        str, typer.Option("--to", metavar="|".join(t.name for t in TARGETS), help="The format.")
    ],
    out: Annotated[
        str | None,
        typer.Option("--out", metavar="DIR", help="Folder to write into; else ./NAME_TARGET."),
    ] = None,
) -> None:
    """Write a result in the format of another tool.

    What is written is checked against what it was made from. The path of the main file is printed
    on stdout.
    """
    chosen = target(to)
    if not run.strip():
        raise DataError("RUN: expected the name of what to export, given nothing")
    if out is None:
        out = chosen.home() or f"{FilePath(run).resolve().stem}_{to}"
    was_there = FilePath(out).exists()
    folder = files.out_folder(out)
    try:
        written = chosen.write(run, folder)
    except SteersmanError:
        if not was_there:
            with suppress(OSError):  # something may have been written before the fault
                folder.rmdir()
        raise
    write(f"{written[0]}\n")
