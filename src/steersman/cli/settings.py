"""Where commands write, and how their settings are described in the help."""

from __future__ import annotations

import tempfile
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from steersman.cli.output import note
from steersman.errors import ConfigError, DataError

if TYPE_CHECKING:
    from steersman.plants.base import PlantComponent

HELP = "A YAML file, and settings over it; a setting of a part is written part.key=value."
METAVAR = "[CONFIG.yaml] [key=value ...]"
# Options of all commands that run many jobs (steersman.engine).
Jobs: TypeAlias = Annotated[
    int | None, typer.Option("--jobs", min=1, help="Jobs at a time; by default one for each core.")
]
Engine: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--engine",
        metavar="local|ray",
        help="local: processes of this machine; ray: a cluster, the default if RAY_ADDRESS is set.",
    ),
]


def tell_plant(plant: PlantComponent) -> None:
    """Say on whose server it is driven, if on one; a stand-in's numbers are never CARLA's.

    Raises:
        PlantError: the server does not answer.
    """
    if not plant.embedded:
        note(f"driven on: {plant.source()}")


def workers_for(
    plant: PlantComponent, engine: str | None, jobs: int | None
) -> tuple[str, int | None]:
    """The engine, and the jobs at a time; a plant that is not embedded has one car.

    Raises:
        ConfigError: there is no such engine, or the plant cannot do it.
    """
    from steersman.engine.jobs import engine_name

    try:
        name = engine_name(engine)
    except ConfigError as error:
        raise ConfigError(error.what, ("--engine",)) from None
    if plant.embedded:
        return name, jobs
    if engine not in {None, "local"}:
        raise ConfigError(f"{engine} is not allowed; plant={plant.kind}: local", ("--engine",))
    if jobs not in {None, 1}:
        raise ConfigError(f"{jobs} is not allowed; plant={plant.kind} has one car: 1", ("--jobs",))
    return "local", 1


def out_folder(name: str) -> FilePath:
    """The folder for results, made if need be and proved to be writable before anything runs.

    Raises:
        DataError: it cannot be made or written.
    """
    from steersman.files import make_folder

    if not name.strip():
        raise DataError("--out: expected the name of a folder, given nothing")
    folder = FilePath(name)
    if folder.exists() and not folder.is_dir():
        raise DataError(f"{folder}: is a file, expected a folder")
    make_folder(folder)
    try:
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        raise DataError(f"{folder}: cannot be written ({error.strerror})") from None


def out_file(name: str, option: str = "--out") -> FilePath:
    """The file for a result, in a folder that is proved to be writable before anything runs.

    ``option`` is what the user gave the name with.

    Raises:
        DataError: it is a folder, a device or the like, or its folder cannot be written.
    """
    from steersman.files import refuse_special

    file = FilePath(name)
    if not name.strip() or file.is_dir():
        raise DataError(f"{option}: expected the name of a file, given {name!r}")
    refuse_special(file)
    out_folder(str(file.parent))
    return file
