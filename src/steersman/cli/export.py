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
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from steersman import files
from steersman.cli.dataset import home as dataset_home
from steersman.cli.output import note, write
from steersman.errors import ConfigError, DataError, SteersmanError, suggestion
from steersman.words import PARTS, with_parts

if TYPE_CHECKING:
    from steersman.delivery.controller import Setting
    from steersman.delivery.fmu.model import FmuModel

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman export precision --to c --out build/precision\n"
    "  steersman export tuned/lqr --to c --precision single\n"
    "  steersman export tuned/lqr --to c --with estimator,supervisor\n"
    "  steersman export tuned/lqr --to c --parameters lqr.csv sensor.count=20\n"
    "  steersman export runs/tune --to c                   (for the car of the tuning)\n"
    "  steersman export tuned/lqr --to c nominal=my_car.yaml\n"
    "  steersman export tuned/mpc_delay --to fmu --fmi 3\n"
    "  steersman export carla_model3 --to fmu path=monza speed=constant_speed\n"
    "  steersman export runs/agent/policy.onnx --to onnx --out delivery\n"
    "  steersman export runs/monza --to mcap\n"
    "  steersman export demo --to minari --out datasets\n"
    "\n"
    "\b\n"
)
STEERS = "a controller, or a policy"
UNIT = "a controller, a policy, or a vehicle with its road"
_PRECISIONS = ("single", "double")
_FMI = (2, 3)
POLICY = "a training's folder, a policy of the package, or an .onnx or .json file"
DRIVE = "a folder of steersman drive --out, or an episode's .npz file"
DATA = "a training's folder or preset (its demonstrator drives), a drive, or a ROS 2 recording"


class ToExport(NamedTuple):
    """What is to be exported."""

    run: str
    """RUN, as the user wrote it."""
    words: Sequence[str] = ()
    """Settings of the drive that a controller is exported for."""
    single: bool = False
    """Numbers in C are float; else double."""
    parameters: FilePath | None = None
    """A table with other values of a controller's parameters."""
    fmi: int | None = None
    """Version of an FMU's interface."""
    name: str = ""
    """What the names of files and functions hold; nothing: a short name of RUN."""


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
    from steersman.delivery.package import try_out, write_c

    setting = _setting(wanted)
    if setting is not None:
        from steersman.delivery.controller_package import write_controller

        files = write_controller(setting, folder)
    else:
        files = write_c(_policy(wanted), folder)
    note(try_out(files[0]))
    return files


def _setting(wanted: ToExport) -> Setting | None:
    """What a controller is exported for: the loop of a drive; None for a policy."""
    from steersman import words

    family = "controller"
    if not words.means(family, wanted.run):
        return None
    if words.fields_of(family, words.bare(wanted.run))["kind"] == "policy":
        if words.around(wanted.run)[0]:
            raise ConfigError(
                f"{wanted.run}: a policy cannot be exported to C with another controller around it"
                " yet; export the policy alone"
            )
        return None
    from steersman.api.cars import made_for_another, tuned_on
    from steersman.commands import configuration
    from steersman.delivery.controller import DESIGN, Setting
    from steersman.delivery.controller_package import read_table

    table = {} if wanted.parameters is None else read_table(wanted.parameters)
    made = {name: value for name, value in table.items() if name.startswith(DESIGN)}
    changed = [f"{family}.{name}={value!r}" for name, value in table.items() if name not in made]
    named = f"{family}={wanted.run}"
    config = configuration("drive", [named, *wanted.words, *changed])
    if not {"nominal", "vehicle"} & config.model_fields_set:
        found = tuned_on(wanted.run)
        if found is not None:
            config = config.model_copy(update={"vehicle": found[1]})
            note(
                f"vehicle: {getattr(found[1], 'file', found[1].kind)}, the car of the tuning"
                f" ({found[0]}); nominal=CAR designs for another"
            )
    car = config.nominal or config.vehicle
    other = made_for_another(config.controller, [named], car)
    if other is not None:
        note(f"controller: {other}")
    return Setting(
        wanted.name or words.short(wanted.run),
        config.controller,
        car,
        config.plant.dt,
        config.sensor.count,
        config.sensor.spacing,
        wanted.single,
        made,
    )


def _policy(wanted: ToExport) -> str:
    """RUN, for a target that takes nothing beside.

    Raises:
        ConfigError: there is more.
    """
    if wanted.words or wanted.single or wanted.parameters or wanted.name:
        raise ConfigError(
            f"{wanted.run}: settings, name and parameters are for controllers in C alone"
        )
    return wanted.run


def _fmu(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.fmu.archive import write_fmu

    return write_fmu(_model(wanted), wanted.fmi or 2, folder, note)


def _model(wanted: ToExport) -> FmuModel:
    """What becomes an FMU: a vehicle on its road, a controller, or a policy."""
    from steersman import words
    from steersman.delivery.fmu import model

    if words.means("vehicle", wanted.run):
        from steersman.commands import configuration
        from steersman.delivery.plant import translated_plant

        _policy(wanted._replace(words=()))
        config = configuration("drive", [f"vehicle={wanted.run}", *wanted.words])
        return model.plant_model(translated_plant(words.short(wanted.run), config))
    setting = _setting(wanted)
    if setting is not None:
        return model.controller_model(setting)
    from steersman.delivery.c_source import parts
    from steersman.delivery.graph import read_network
    from steersman.delivery.source import read_source

    source = read_source(_policy(wanted))
    return model.policy_model(parts(source, read_network(source.data, str(source.file))))


def _onnx(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.delivery.package import write_onnx

    return write_onnx(_policy(wanted), folder, note)


def _mcap(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.cli.recording import export_mcap

    return export_mcap(_policy(wanted), folder)


def _minari(wanted: ToExport, folder: FilePath) -> Sequence[FilePath]:
    from steersman.cli.dataset import export_minari

    return export_minari(_policy(wanted), folder)


TARGETS = (
    Target("c", STEERS, "C99 source without dependencies, test vector, Makefile, card", _c),
    Target("fmu", UNIT, "a unit for co-simulation (FMI 2.0, 3.0), binary and sources", _fmu),
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
        typer.Option("--precision", metavar="single|double", help="Numbers of a controller in C."),
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
        raise ConfigError(f"--precision: {precision!r} is not allowed; expected single or double")
    if fmi is not None and (fmi not in _FMI or to != "fmu"):
        raise ConfigError(f"--fmi: {fmi} is not allowed; expected 2 or 3, with --to fmu")
    if not run.strip():
        raise DataError("RUN: expected the name of what to export, given nothing")
    if out is None:
        out = chosen.home() or f"{FilePath(run).resolve().stem}_{to}"
    table = None if parameters is None else FilePath(parameters)
    run = with_parts(run, around)
    wanted = ToExport(run, words or [], precision == "single", table, fmi, name)
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
