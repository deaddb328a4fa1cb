"""What is to be exported: from the user's words to a controller, a policy, or a car."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

from steersman.cli.output import note
from steersman.errors import ConfigError

if TYPE_CHECKING:
    from steersman.delivery.controller import Setting
    from steersman.delivery.fmu.model import FmuModel
    from steersman.rollout import RunConfig
    from steersman.vehicles import Vehicle


# Waypoints that a sensor gives.
_FEWEST = 4


class ToExport(NamedTuple):
    """What is to be exported."""

    run: str
    """RUN, as the user wrote it."""
    words: Sequence[str] = ()
    """Settings of the drive that a controller is exported for."""
    precision: str = "double"
    """Of numbers in C: single, double, or mixed."""
    parameters: FilePath | None = None
    """A table with other values of a controller's parameters."""
    fmi: int | None = None
    """Version of an FMU's interface."""
    name: str = ""
    """What the names of files and functions hold; nothing: a short name of RUN."""
    measure: bool = False
    """Whether a controller's costs on a processor are measured."""


def setting_of(wanted: ToExport) -> Setting:
    """What a controller is exported for: the loop of a drive.

    A policy alone is exported for the control period and the waypoints of its card, where the
    words say nothing else; it may be named by its card.

    Raises:
        ConfigError: there is no such controller, or a word is unknown or not allowed.
    """
    from steersman import words

    family, run = "controller", FilePath(wanted.run)
    if run.suffix == ".json":
        wanted = wanted._replace(run=str(run.with_suffix(".onnx")))
    if not words.means(family, wanted.run):
        raise words.unknown(family, wanted.run)
    from steersman.delivery.controller import DESIGN, Setting
    from steersman.delivery.controller_package import read_table

    table = {} if wanted.parameters is None else read_table(wanted.parameters)
    made = {name: value for name, value in table.items() if name.startswith(DESIGN)}
    changed = [f"{family}.{name}={value!r}" for name, value in table.items() if name not in made]
    of_card = _of_card(words.fields_of(family, wanted.run))
    try:
        config, car = loop_of(wanted.run, [*of_card, *wanted.words, *changed])
    except ConfigError as error:
        if (name := ".".join(error.where[1:])) not in table:
            raise
        raise ConfigError(f"{wanted.parameters}: {name}: {error.what}") from None
    return Setting(
        wanted.name or words.short(wanted.run),
        config.controller,
        car,
        config.plant.dt,
        config.sensor.count,
        config.sensor.spacing,
        wanted.precision,
        made,
        frozenset(table),
    )


def _of_card(fields: dict[str, Any]) -> list[str]:
    """The control period and the waypoints of a policy's card, as words."""
    from steersman.policy_file import LEARNED, locate, read_policy

    if fields["kind"] not in LEARNED or "file" not in fields:
        return []
    card = read_policy(locate(fields["file"]))[1]
    count = f"sensor.count={max(card.waypoints, _FEWEST)}"
    return [f"plant.dt={card.dt}", count, f"sensor.spacing={card.spacing}"]


def loop_of(run: str, words: Sequence[str]) -> tuple[RunConfig, Vehicle]:
    """The drive that a controller is meant for, and the car that it is designed for.

    Raises:
        ConfigError: a word is unknown or not allowed.
    """
    from steersman.api.cars import Made, tuned_on
    from steersman.api.driving import announce
    from steersman.commands import configuration

    named = f"controller={run}"
    config = configuration("drive", [named, *words])
    if not {"nominal", "vehicle"} & config.model_fields_set:
        found = tuned_on(run)
        if found is not None:
            config = config.model_copy(update={"vehicle": found[1]})
            note(
                f"vehicle: {getattr(found[1], 'file', found[1].kind)}, the car of the tuning"
                f" ({found[0]}); nominal=CAR designs for another"
            )
    car = config.nominal or config.vehicle
    announce(config.plant, note, [car], [Made(config.controller, [named])])
    return config, car


def policy_of(wanted: ToExport) -> str:
    """RUN, for a target that takes nothing beside.

    Raises:
        ConfigError: there is more.
    """
    if wanted.words or wanted.precision != "double" or wanted.parameters or wanted.name:
        raise ConfigError(
            f"{wanted.run}: settings, name and parameters are for controllers in C alone"
        )
    return wanted.run


def model_of(wanted: ToExport) -> FmuModel:
    """What becomes an FMU: a vehicle on its road, a controller, or a policy."""
    from steersman import words
    from steersman.delivery.fmu import model

    if words.means("vehicle", wanted.run):
        from steersman.api.driving import announce
        from steersman.commands import configuration
        from steersman.delivery.plant import translated_plant

        policy_of(wanted._replace(words=(), name=""))
        config = configuration("drive", [f"vehicle={wanted.run}", *wanted.words])
        announce(config.plant, note, [config.vehicle])
        return model.plant_model(translated_plant(wanted.name or words.short(wanted.run), config))
    return model.controller_model(unit_of(wanted), note)


def unit_of(wanted: ToExport) -> Setting:
    """A controller for a target without a test vector of its own, which in float runs before.

    Raises:
        ConfigError: there is no such controller, or a word is unknown or not allowed.
        DataError: float is too coarse for the controller.
    """
    from steersman.delivery.controller_package import check_float

    setting = setting_of(wanted)
    if setting.single:
        check_float(setting)
    return setting
