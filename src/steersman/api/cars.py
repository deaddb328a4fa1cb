"""What a user's car leaves to another one, and which controllers were made for another car."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman import tuned
from steersman.config import build, lookup, resolve
from steersman.core_yaml import read_yaml
from steersman.errors import ConfigError, DataError
from steersman.policy_file import LEARNED
from steersman.vehicles import CarlaModel3V1, Vehicle, VehicleFile

if TYPE_CHECKING:
    from steersman.controllers.base import ControllerComponent

# Figures whose source a drive depends on most, by how their fields begin.
_TOLD = {
    "friction": "friction ({friction:g}: vehicle.friction=0.9)",
    "steer_curve": "the steering curve (steer_curve_speed, steer_curve_factor)",
    "map_": "the throttle map (map_throttle, map_speed, map_acceleration)",
}
# Figures that decide what a command of steering does, and how much they may differ.
_DECIDING = (
    *("mass", "yaw_inertia", "l_f", "l_r", "c_f", "c_r", "max_wheel_angle"),
    *("steer_rate_up", "steer_lag", "steer_delay"),
)
_ALIKE = 0.05
_SHOWN = 3
# The same car, before and after it was fitted to logs.
_MODEL3 = ("carla_model3", "carla_model3_v1")


def inherited(vehicle: Vehicle) -> str | None:
    """A sentence about figures that a vehicle's file leaves to its base; None if it has them all.

    Raises:
        DataError: the file cannot be read any more.
    """
    if not isinstance(vehicle, VehicleFile):
        return None
    given = read_yaml(vehicle.file)
    kind = str(given.pop("base", "custom"))
    base = build(lookup("vehicle", kind), {})
    left = [
        name
        for name in type(base).model_fields
        if name not in given and getattr(vehicle, name) == getattr(base, name)
    ]
    told = [
        text.format(**vehicle.model_dump())
        for start, text in _TOLD.items()
        if any(name.startswith(start) for name in left)
    ]
    if not told:
        return None
    others = sum(not name.startswith(tuple(_TOLD)) for name in left)
    named = ", ".join(told) + (f" and {others} other figures" if others else "")
    source = CarlaModel3V1().kind if kind == "custom" else kind
    return (
        f"{vehicle.file} leaves {named} to {source}; lines in the file set them, "
        f"'steersman identify LOG --vehicle {vehicle.file}' measures them, "
        "'steersman show vehicle custom' lists them"
    )


def made_for_another(
    controller: ControllerComponent, words: Sequence[Any], vehicle: Vehicle
) -> str | None:
    """A sentence about a policy or gains that were made for another car; None if they fit.

    Args:
        controller: what drives.
        words: of the command, which name the file of the gains.
        vehicle: what it drives.
    """
    name, cars = _cars_of(controller, words)
    if not cars or any(_alike(car, vehicle) for car in cars):
        return None
    car, trained = cars[0], controller.kind in LEARNED
    apart = [
        f"{field} {getattr(car, field):.4g}, here {getattr(vehicle, field):.4g}"
        for field in _different(car, vehicle)[:_SHOWN]
    ]
    ours = getattr(vehicle, "file", vehicle.kind)
    kind = getattr(controller, "inner", controller).kind
    cure = f"train PRESET problem.vehicle={ours}" if trained else f"tune {kind} --car {ours}"
    return (
        f"{name} was {'trained' if trained else 'tuned'} for {car.title}"
        f" ({'; '.join(apart)}); 'steersman {cure}' makes one for this car"
    )


def _cars_of(
    controller: ControllerComponent, words: Sequence[Any]
) -> tuple[str, Sequence[Vehicle]]:
    """What the controller is called, and the cars that it was made for, as far as is known."""
    if controller.kind in LEARNED:
        return _of_policy(str(getattr(controller, "file", "")))
    for word in words:
        if not isinstance(word, str) or ("=" in word and not word.startswith("controller=")):
            continue
        name = word.removeprefix("controller=").removeprefix("supervised/")
        if name in tuned.names():
            return name, [CarlaModel3V1()]
        place = FilePath(name)
        result = (place if place.is_dir() else place.parent) / "result.json"
        if (place.suffix in {".yaml", ".yml"} or place.is_dir()) and result.is_file():
            return name, _of_tuning(result)
    return controller.kind, []


def _of_policy(file: str) -> tuple[str, Sequence[Vehicle]]:
    from steersman.policy_file import locate, read_policy

    try:
        _, card = read_policy(locate(file))
    except DataError:
        return file, []  # loading it raises with the cause
    problem = card.training.get("config", {}).get("problem", {})
    return file, _vehicles([problem.get("vehicle")])


def _of_tuning(result: FilePath) -> Sequence[Vehicle]:
    try:
        suite = json.loads(result.read_text(encoding="utf-8")).get("suite", [])
        return _vehicles([run.get("vehicle") for run in suite])
    except (OSError, ValueError, AttributeError, TypeError):
        return []  # another command's, or none of ours


def _vehicles(given: Sequence[Any]) -> Sequence[Vehicle]:
    found = []
    for fields in given:
        try:
            car = resolve("vehicle", fields, optional=True)
        except (ConfigError, DataError):
            continue  # its file is gone, or a plug-in's
        if isinstance(car, Vehicle):
            found.append(car)
    return found


def _alike(car: Vehicle, other: Vehicle) -> bool:
    same = car.kind in _MODEL3 and other.kind in _MODEL3
    return same or not _different(car, other)


def _different(car: Vehicle, other: Vehicle) -> list[str]:
    """The deciding figures that differ."""
    pairs = {name: (getattr(car, name), getattr(other, name)) for name in _DECIDING}
    return [name for name, (a, b) in pairs.items() if abs(a - b) > _ALIKE * max(abs(a), abs(b))]
