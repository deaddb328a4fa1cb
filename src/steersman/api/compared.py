"""What a comparison is given in Python, and which of it was made for another car."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from steersman import core_yaml
from steersman.api.cars import Made, about_cars, cars_of
from steersman.commands import Notify, key, suite_settings
from steersman.config import dump
from steersman.errors import ConfigError, suggestion

if TYPE_CHECKING:
    from steersman.episode import Episode
    from steersman.rollout import RunConfig
    from steersman.studies.compare.contestants import Contestant
    from steersman.vehicles import Vehicle


def sorted_out(
    given: Sequence[Any], settings: Mapping[str, Any]
) -> tuple[list[str | Episode], dict[str, str]]:
    """What is compared, and by their key the settings as assignments.

    Raises:
        ConfigError: something is neither a word nor a drive, or a keyword is unknown.
    """
    from steersman.bench.suite import Suite
    from steersman.episode import Episode
    from steersman.rollout import RunConfig

    fields = {*RunConfig.model_fields} - {"controller"}
    known = {*Suite.model_fields, *fields}
    for name in settings:
        if name.partition(".")[0] not in known:
            raise ConfigError(f"unknown setting {name!r}{suggestion(name, known)}")
    every = [str(one) if isinstance(one, PathLike) else one for one in given]
    for one in every:
        if not isinstance(one, str | Episode):
            raise ConfigError(
                f"cannot compare an object of type {type(one).__name__}; allowed: words, folders"
                " and files as text, and drives (Episode)"
            )
    texts = [one for one in every if isinstance(one, str)]
    keys = {key(text) for text in texts if "=" in text}
    more = [_assignment(name, value) for name, value in settings.items() if name not in keys]
    words, chosen = suite_settings([*more, *texts], also=fields)
    return [one for one in every if not isinstance(one, str) or one in words], chosen


def _assignment(name: str, value: Any) -> str:
    """A keyword as the command line's word."""
    plain = dump(value) if isinstance(value, BaseModel) else value
    if isinstance(plain, PathLike):
        plain = str(plain)
    if isinstance(plain, str) and core_yaml.value(plain) == plain:
        return f"{name}={plain}"
    try:
        return f"{name}={json.dumps(plain)}"
    except (TypeError, ValueError):
        raise ConfigError(
            f"a value of type {type(value).__name__} is not allowed", (name,)
        ) from None


def cars_driven(found: Sequence[Contestant], drive: RunConfig | None) -> list[Vehicle]:
    """The car of a drive that is to be driven, else of the first saved one, as far as is known."""
    if drive is not None:
        return [drive.vehicle] if drive.plant.computed else []
    saved = next(one.episode for one in found if one.episode is not None)
    config = saved.meta.get("config")
    return [*cars_of([config.get("vehicle")])] if isinstance(config, dict) else []


def tell_cars(found: Sequence[Contestant], cars: Sequence[Vehicle], tell: Notify) -> None:
    """Say what the cars leave to others, and which controllers were made for another car."""
    drivers = ((one.source, driver.controller) for one in found for driver in one.drivers)
    for line in about_cars(cars, [Made(controller, [word]) for word, controller in drivers]):
        tell(line)
