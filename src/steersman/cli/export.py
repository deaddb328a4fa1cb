"""``steersman export``: a result in the format of another tool.

A target is a line in :data:`TARGETS`. To add one: a function that takes what the user named and
a folder that exists and is writable, writes into it and returns the files written (the one to name
first), and its line in the table. The function imports what it needs when it is called, and
raises a :class:`~steersman.errors.SteersmanError` about an input that is not what it takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, NamedTuple

import typer

from steersman import files
from steersman.cli.dataset import home as dataset_home
from steersman.cli.exported import ToExport, model_of, policy_of, setting_of, unit_of
from steersman.cli.output import note, write
from steersman.errors import ConfigError, DataError, SteersmanError, suggestion
from steersman.words import PARTS, with_parts

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman export precision --to c --out build/precision\n"
    "  steersman export tuned/lqr --to c --precision single\n"
    "  steersman export tuned/lqr --to c --with estimator,supervisor\n"
    "  steersman export tuned/mpc --to c --precision mixed --measure\n"
    "  steersman export tuned/lqr --to c --parameters lqr.csv sensor.count=20\n"
    "  steersman export runs/tune --to c                   (for the car of the tuning)\n"
    "  steersman export tuned/lqr --to c nominal=my_car.yaml\n"
    "  steersman export tuned/mpc_delay --to fmu --fmi 3\n"
    "  steersman export carla_model3 --to fmu path=monza speed=constant_speed\n"
    "  steersman export supervised/tuned/lqr --to ros2\n"
    "  steersman export runs/agent/policy.onnx --to onnx --out delivery\n"
    "  steersman export runs/monza --to mcap\n"
    "  steersman export runs/monza --to csv\n"
    "  steersman export demo --to minari --out datasets\n"
    "\n"
    "\b\n"
)
STEERS = "a controller, or a policy"
UNIT = "a controller, a policy, or a vehicle with its road"
_PRECISIONS = ("single", "double", "mixed")
_FMI = (2, 3)
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
    write: Callable[[ToExport, FilePath], Sequence[FilePath]]
    """From what is wanted and a folder to the files written into it, the one to name first."""
    home: Callable[[], str | None] = lambda: None
    """The folder without --out, if it is not ./NAME_TARGET."""


def _c(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.controller_package import write_controller
    from steersman.delivery.package import proven, try_out

    files = write_controller(setting_of(wanted), folder, note, measure=wanted.measure)
    note(proven(files, partial(try_out, files[0])))
    return files


def _fmu(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.fmu.archive import write_fmu

    return write_fmu(model_of(wanted), wanted.fmi or 2, folder, note)


def _ros2(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.ros2 import write_package

    return write_package(unit_of(wanted), folder, note)


def _onnx(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.package import write_onnx

    return write_onnx(policy_of(wanted), folder, note)


def _mcap(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.cli.recording import export_mcap

    return export_mcap(policy_of(wanted), folder)


def _table(suffix: str, wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.cli.recording import export_table

    return export_table(policy_of(wanted), folder, suffix)


def _minari(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.cli.dataset import export_minari

    return export_minari(policy_of(wanted), folder)


TARGETS = (
    Target("c", STEERS, "C99 source without dependencies, test vector, Makefile, card", _c),
    Target("fmu", UNIT, "a unit for co-simulation (FMI 2.0, 3.0), binary and sources", _fmu),
    Target("ros2", STEERS, "a package (ament_cmake) with a node for Autoware's messages", _ros2),
    Target("onnx", POLICY, "the network as a checked ONNX file with its card", _onnx),
    Target("mcap", DRIVE, "a recording with ROS 2 messages", _mcap),
    Target("csv", DRIVE, "the signals, a row for each control step", partial(_table, ".csv")),
    Target("mat", DRIVE, "the same for MATLAB", partial(_table, ".mat")),
    Target("parquet", DRIVE, "the same for pandas and others", partial(_table, ".parquet")),
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


def export(  # noqa: PLR0913, PLR0917 - typer's options
    run: Annotated[str, typer.Argument(metavar="RUN", help="What to export.")],
    to: Annotated[
        str, typer.Option("--to", metavar="|".join(t.name for t in TARGETS), help="The format.")
    ],
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KEY=VALUE]...",
            help="Of a controller or vehicle: settings of a drive (nominal, sensor, path ...).",
        ),
    ] = None,
    precision: Annotated[
        str,
        typer.Option(
            "--precision", metavar="|".join(_PRECISIONS), help="Numbers of a controller in C."
        ),
    ] = "double",
    parameters: Annotated[
        str | None,
        typer.Option("--parameters", metavar="FILE", help="Its parameters: a table, changed."),
    ] = None,
    fmi: Annotated[
        int | None,
        typer.Option("--fmi", metavar="2|3", help="Version of an FMU's interface; else 2."),
    ] = None,
    around: Annotated[
        str,
        typer.Option(
            "--with",
            metavar=",".join(PARTS),
            help="Of a controller in C: what is put around it; some of these.",
        ),
    ] = "",
    measure: Annotated[
        bool,
        typer.Option(
            "--measure",
            help="Of a controller in C: size and instructions on a Cortex-M4F (arm-none-eabi-gcc,"
            " qemu-system-arm), steps of its quadratic programs in a benchmark; into its card.",
        ),
    ] = False,
    name: Annotated[
        str,
        typer.Option("--name", metavar="NAME", help="Of a controller in C: its name there."),
    ] = "",
    out: Annotated[
        str | None,
        typer.Option("--out", metavar="DIR", help="Folder to write into; else ./NAME_TARGET."),
    ] = None,
) -> None:
    """Write a result in the format of another tool.

    What is written is checked against what it was made from (an FMU is compiled, not run). The
    path of the main file is printed on stdout.
    """
    chosen = target(to)
    if precision not in _PRECISIONS:
        raise ConfigError(
            f"--precision: {precision!r} is not allowed; expected single, double or mixed"
        )
    if fmi is not None and (fmi not in _FMI or to != "fmu"):
        raise ConfigError(f"--fmi: {fmi} is not allowed; expected 2 or 3, with --to fmu")
    if not run.strip():
        raise DataError("RUN: expected the name of what to export, given nothing")
    if measure and to != "c":
        raise ConfigError(f"--measure: is for --to c, given --to {to}")
    if out is None:
        out = chosen.home() or f"{FilePath(run).resolve().stem}_{to}"
    table = None if parameters is None else FilePath(parameters)
    run = with_parts(run, around)
    wanted = ToExport(run, words or [], precision, table, fmi, name, measure)
    was_there = FilePath(out).exists()
    folder = files.out_folder(out)
    try:
        written = chosen.write(wanted, folder)
    except SteersmanError:
        if not was_there:
            with suppress(OSError):  # something may have been written before the fault
                folder.rmdir()
        raise
    write(f"{written[0]}\n")
