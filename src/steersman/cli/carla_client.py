"""``steersman carla doctor | calibrate | map``: checks and measurements of a CARLA server."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from steersman import files
from steersman.cli import settings
from steersman.cli.outcome import USER_ERROR
from steersman.cli.output import folded, note, show, show_json, table, write
from steersman.errors import ConfigError, suggestion
from steersman.words import YAML

if TYPE_CHECKING:
    from steersman.plants.base import PlantComponent
    from steersman.plants.carla import CarlaConfig
    from steersman.studies.calibrate.calibrate import Calibration
    from steersman.vehicles import Vehicle

DOCTOR_EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman carla doctor\n"
    "  steersman carla doctor plant.port=3000 plant.vehicle=vehicle.lincoln.mkz_2020 \\\n"
    "      vehicle=carla_mkz2020\n"
    "  steersman carla doctor --clean\n"
    "\n"
    "What can be set: steersman show plant carla"
)
CALIBRATE_EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman carla calibrate --out vehicle.yaml\n"
    "  steersman carla calibrate plant.port=3000 --out vehicle.yaml\n"
    "  steersman drive plant=carla plant.read_physics=false vehicle=file \\\n"
    "      vehicle.file=vehicle.yaml\n"
    "\n"
    "What can be set: steersman show plant carla"
)
MAP_EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman carla map --to town.xodr\n"
    "  steersman carla map plant.map=Town04 --to Town04.xodr"
)
_WORDS = typer.Argument(metavar="[key=value ...]", help="Settings of the plant and the vehicle.")
_PARTS = ("plant", "vehicle")


def doctor(
    words: Annotated[list[str] | None, _WORDS] = None,
    clean: Annotated[
        bool, typer.Option("--clean", help="Destroy all vehicles on the server first.")
    ] = False,
    as_json: settings.AsJson = False,
) -> None:
    """Check a CARLA server: connection, version, what was left behind, repeatability.

    Each fault is shown with its cure. The exit code is 0 if there is none, else 2.
    """
    plant, vehicle = _parts(words)
    config = _carla(plant)

    from steersman.plants.carla_doctor import Finding, examine

    found: list[Finding] = []
    for finding in examine(config, vehicle, clean=clean):
        found.append(finding)
        if not as_json:
            mark = "ok   " if finding.healthy else "FAULT"
            cure = f"\n      cure: {finding.cure}" if finding.cure else ""
            write(folded(f"{mark} {finding.name}: {finding.text}{cure}", sys.stdout) + "\n")
    if as_json:
        show_json([finding._asdict() for finding in found])
    if not all(finding.healthy for finding in found):
        raise typer.Exit(USER_ERROR)


def calibrate(
    out: Annotated[str, typer.Option("--out", metavar="FILE.yaml", help="The vehicle file.")],
    words: Annotated[list[str] | None, _WORDS] = None,
    as_json: settings.AsJson = False,
) -> None:
    """Fit a vehicle file to what a car does on a server.

    Drives steering and throttle manoeuvres, about three minutes of simulated time, and fits lock,
    rates and curve of the steering, the throttle map, the axles' cornering stiffnesses and the
    yaw inertia. The file is used with vehicle=file vehicle.file=FILE.yaml.
    """
    plant, vehicle = _parts(words)
    file = files.out_file(out, "--out", YAML)

    from steersman.studies.calibrate.calibrate import WIDTH, calibrate, write

    if plant.kind == "carla":
        plant = plant.model_copy(update={"lane_width": WIDTH, "map": None})
    driven = plant.make(vehicle)
    try:
        found = calibrate(driven, note)
    finally:
        driven.close()
    write(found, file, driven.source)
    if as_json:
        show_json({name: fit._asdict() for name, fit in found.fits.items()})
    else:
        _show(found, str(file))


def _show(found: Calibration, file: str) -> None:
    from steersman.messages import field_unit
    from steersman.studies.calibrate.calibrate import USUAL

    figures = table("figure", "before", "fitted", "unit", right=("before", "fitted"))
    kind = type(found.vehicle)
    for fit in found.fits.values():
        for name, value in fit.figures.items():
            if isinstance(value, float):
                unit = field_unit(kind.model_fields[name])
                figures.add_row(name, f"{getattr(found.before, name):.5g}", f"{value:.5g}", unit)
    for name, fit in found.fits.items():
        if fit.error > USUAL[name]:
            note(
                f"note: {name} leaves {fit.error:.2g} {fit.unit}, usual is {USUAL[name]:g} at most:"
                " the car does something that the fitted model does not have"
            )
    left = ", ".join(f"{name} {fit.error:.2g} {fit.unit}" for name, fit in found.fits.items())
    show(figures, f"\nRMS errors that the fits leave: {left}", f"written to {file}")


def fetch_map(
    to: Annotated[str, typer.Option("--to", metavar="FILE.xodr", help="The file to write.")],
    words: Annotated[list[str] | None, _WORDS] = None,
) -> None:
    """Write the OpenDRIVE file of a server's map: the present one, or plant.map.

    Routes on it become paths (path=opendrive path.file=FILE.xodr), to be driven on the same map.
    """
    plant, _ = _parts(words)
    config = _carla(plant)
    file = files.out_file(to, "--to", (".xodr",))

    from steersman.files import write_text

    session = config.session()
    try:
        session.open()
        if config.map is not None:
            session.load(config.map)
        found = session.world.get_map()
        name, text = str(found.name), str(found.to_opendrive())
    finally:
        session.close()
    write_text(file, text)
    note(f"written: {file} ({name})")


def _parts(words: list[str] | None) -> tuple[PlantComponent, Vehicle]:
    """The plant and the vehicle that the words name.

    Raises:
        ConfigError: they name something else.
    """
    from steersman.commands import split
    from steersman.config import build, dump, merge, override
    from steersman.plants.carla import CarlaConfig
    from steersman.rollout import RunConfig

    name, assignments = split(words or [])
    if name is not None:
        raise ConfigError(f"{name!r} is not a setting; write plant.port=2000")
    for word in assignments:
        part = word.partition("=")[0].split(".")[0].strip()
        if part not in _PARTS:
            raise ConfigError(f"{word!r}: unknown setting{suggestion(part, _PARTS)}")
    base = {"plant": dump(CarlaConfig())}
    run = build(RunConfig, override(merge({}, base), assignments))
    return run.plant, run.vehicle


def _carla(plant: PlantComponent) -> CarlaConfig:
    from steersman.plants.carla import CarlaConfig

    if not isinstance(plant, CarlaConfig):
        raise ConfigError(f"{plant.kind} is not allowed; this needs a server: carla", ("plant",))
    return plant
