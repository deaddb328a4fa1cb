"""What a user's car leaves to another one, and which controllers were made for another car."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

from steersman import tuned
from steersman import words as words_
from steersman.config import build, lookup, resolve
from steersman.core_yaml import read_yaml
from steersman.errors import ConfigError, DataError
from steersman.files import read_json
from steersman.kernels.vehicle import GRAVITY
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
# What a figure, or a ratio of figures, has in cars from a scale model to a lorry. A wrong unit is a
# factor of a thousand.
_LOCKS = "full locks a second"
_USUAL: dict[str, tuple[Callable[[Vehicle], float], float, float, str]] = {
    "l_f": (lambda car: car.l_f, 0.02, 10.0, "m"),
    "l_r": (lambda car: car.l_r, 0.02, 10.0, "m"),
    "track_width": (lambda car: car.track_width, 0.02, 5.0, "m"),
    "height": (lambda car: car.height, 0.0, 5.0, "m"),
    "width": (lambda car: car.width, 0.02, 5.0, "m"),
    "body_length": (lambda car: car.body_length, 0.05, 30.0, "m"),
    "mass": (lambda car: car.mass, 0.1, 1e5, "kg"),
    "yaw_inertia / (mass l_f l_r)": (
        *(lambda car: car.yaw_inertia / (car.mass * car.l_f * car.l_r), 0.1, 10.0),
        "",
    ),
    "c_f / (mass g)": (lambda car: car.c_f / (car.mass * GRAVITY), 0.2, 200.0, "/rad"),
    "c_r / (mass g)": (lambda car: car.c_r / (car.mass * GRAVITY), 0.2, 200.0, "/rad"),
    "steer_rate_up": (lambda car: car.steer_rate_up, 0.05, 20.0, _LOCKS),
    "steer_rate_down": (lambda car: car.steer_rate_down, 0.05, 20.0, _LOCKS),
    "pedal_rate_up": (lambda car: car.pedal_rate_up, 0.2, 100.0, "full strokes a second"),
    "pedal_rate_down": (lambda car: car.pedal_rate_down, 0.2, 100.0, "full strokes a second"),
}
# Figures of the base that belong to its mass and axles, and say the most of a car's handling.
_OF_MASS = ("yaw_inertia", "c_f", "c_r")
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
    kept = [name for name in _OF_MASS if name in left]
    of_mass = kept if {"mass", "l_f", "l_r"} & set(given) else []
    told = [
        text.format(**vehicle.model_dump())
        for start, text in _TOLD.items()
        if any(name.startswith(start) for name in left)
    ]
    told += [f"{name} ({getattr(vehicle, name):.4g})" for name in of_mass]
    if not told:
        return None
    others = sum(not name.startswith((*_TOLD, *of_mass)) for name in left)
    named = ", ".join(told) + (f" and {others} other figures" if others else "")
    source = CarlaModel3V1().kind if kind == "custom" else kind
    return (
        f"{vehicle.file} leaves {named} to {source}; lines in the file set them, "
        f"'steersman identify LOG --vehicle {vehicle.file}' measures them, "
        "'steersman show vehicle custom' lists them"
    )


def implausible(vehicle: Vehicle) -> str | None:
    """A sentence about the first figures that no car has, as if in another unit; None if none."""
    for name, (figure, low, high, unit) in _USUAL.items():
        value = figure(vehicle)
        if not low <= value <= high:
            told = f"{name} is {value:.4g}{f' {unit}' if unit else ''}, in cars it is {low:g} to "
            if unit == _LOCKS:
                degrees = math.degrees(vehicle.max_wheel_angle)
                return (
                    f"{told}{high:g}; of {value:.4g} deg/s of the road wheels it would be"
                    f" {value / degrees:.3g} (max_wheel_angle is {degrees:.3g} deg)"
                )
            return f"{told}{high:g}; figures are in m, kg, kg m^2, N, N/rad and 1/s"
    return None


class Made(NamedTuple):
    """A controller that is to be driven, and the words that it was given by."""

    controller: ControllerComponent
    words: Sequence[Any]
    """One of them names the file of its gains."""


def about_cars(cars: Iterable[Vehicle], made: Iterable[Made] = ()) -> Iterator[str]:
    """Sentences about what files of cars leave to others, and what was made for another car.

    Of many controllers the first three have a sentence of their own; the rest share one.

    Raises:
        DataError: the file of a car cannot be read any more.
    """
    cars = list(cars)
    for car in cars:
        for line in (inherited(car), implausible(car)):
            if line is not None:
                yield f"vehicle: {line}"
    told = []
    for one in made:
        lines = [made_for_another(*one, car) for car in cars]
        told += [line for line in lines if line is not None][:1]
    told = [*dict.fromkeys(told)]
    for line in told[:_SHOWN]:
        yield f"controller: {line}"
    if len(told) > _SHOWN:
        names = ", ".join(line.partition(" was ")[0] for line in told[_SHOWN:])
        yield f"controller: likewise made for another car: {names}"


def made_for_another(
    controller: ControllerComponent, words: Sequence[Any], vehicle: Vehicle
) -> str | None:
    """A sentence about a policy or gains that were made for another car; None if they fit.

    Args:
        controller: what drives.
        words: of the command, which name the file of the gains.
        vehicle: what it drives.
    """
    steers = _inside(controller)
    name, cars = _cars_of(steers, words)
    if not cars or any(_alike(car, vehicle) for car in cars):
        return None
    car, trained = cars[0], steers.kind in LEARNED
    apart = [
        f"{field} {getattr(car, field):.4g}, here {getattr(vehicle, field):.4g}"
        for field in _different(car, vehicle)[:_SHOWN]
    ]
    ours, beside = _written_in(vehicle)
    cure = f"train PRESET problem.vehicle={ours}" if trained else f"tune {name} --car {ours}"
    return (
        f"{name} was {'trained' if trained else 'tuned'} for {car.title}"
        f" ({'; '.join(apart)}); 'steersman {cure}' makes one for this car{beside}"
    )


def _written_in(vehicle: Vehicle) -> tuple[str, str]:
    """The word for a car; one with figures beside its file's, FILE, and what is to be in it."""
    ours = str(getattr(vehicle, "file", vehicle.kind))
    own = next(iter(cars_of([ours])), vehicle).model_dump()
    lines = [f"{k}: {v}" for k, v in vehicle.model_dump().items() if own.get(k) != v]
    return ("FILE", f"; FILE is {ours} with {', '.join(lines[:9])}") if lines else (ours, "")


def tuned_on(word: str) -> tuple[str, Vehicle] | None:
    """The file that says for which car a tuning was made, and the car.

    None if the word names no tuning, or one on several cars of which none is the most frequent.

    Args:
        word: for a controller: the folder of a tuning, or the file with its gains.
    """
    result = _result(words_.bare(word))
    if result is None:
        return None
    config = result.with_name("config.yaml")
    try:
        chosen = cars_of([read_yaml(config).get("vehicle")]) if config.is_file() else []
    except DataError:
        chosen = []
    if chosen:
        return str(config), chosen[0]
    cars = [(car, car.model_dump_json()) for car in _of_tuning(result)]
    most = Counter(text for _, text in cars).most_common(2)
    if not most or (len(most) > 1 and most[0][1] == most[1][1]):
        return None
    return str(result), next(car for car, text in cars if text == most[0][0])


def _inside(controller: ControllerComponent) -> ControllerComponent:
    """The controller that a supervisor, an estimator or a predictor is put around."""
    field = words_.wrapped().get(controller.kind)
    return controller if field is None else _inside(getattr(controller, field))


def _result(name: str) -> FilePath | None:
    """The result of the tuning that a folder, or a file with gains, belongs to."""
    place = FilePath(name)
    if not (place.is_dir() or place.suffix in words_.YAML):
        return None
    result = (place if place.is_dir() else place.parent) / "result.json"
    return result if result.is_file() else None


def _cars_of(
    controller: ControllerComponent, words: Sequence[Any]
) -> tuple[str, Sequence[Vehicle]]:
    """What the controller is called, and the cars that it was made for, as far as is known."""
    if controller.kind in LEARNED:
        return _of_policy(str(getattr(controller, "file", "")))
    for word in words:
        if not isinstance(word, str) or ("=" in word and not _names_controller(word)):
            continue
        name = words_.bare(word.partition("=")[2].strip() if "=" in word else word)
        if name in tuned.names():
            return name, cars_of([{"kind": tuned.VEHICLE}])
        result = _result(name)
        if result is not None:
            return name, _of_tuning(result)
    return controller.kind, []


def _names_controller(assignment: str) -> bool:
    """Whether it sets the controller, or the one inside: controller.inner=tuned/lqr."""
    first, *more = assignment.partition("=")[0].strip().split(".")
    return first == "controller" and set(more) <= set(words_.wrapped().values())


def _of_policy(file: str) -> tuple[str, Sequence[Vehicle]]:
    from steersman.policy_file import locate, read_policy

    try:
        _, card = read_policy(locate(file))
    except DataError:
        return file, []  # loading it raises with the cause
    problem = card.training.get("config", {}).get("problem", {})
    return file, cars_of([problem.get("vehicle")])


def _of_tuning(result: FilePath) -> Sequence[Vehicle]:
    try:
        return cars_of([run.get("vehicle") for run in read_json(result).get("suite", [])])
    except (DataError, AttributeError, TypeError):
        return []  # another command's, or none of ours


def cars_of(given: Sequence[Any]) -> Sequence[Vehicle]:
    """Cars from their fields as files keep them; those that cannot be made are left out."""
    found = []
    for fields in given:
        try:
            car = resolve("vehicle", fields, optional=True)
        except (ConfigError, DataError):  # its file is gone, or a plug-in's
            car = _written(fields)
        if isinstance(car, Vehicle):
            found.append(car)
    return found


def _written(fields: Any) -> Vehicle | None:
    """The car of a file that is gone, from the figures that were written down beside its name."""
    if not isinstance(fields, dict) or "mass" not in fields:
        return None
    figures = {name: value for name, value in fields.items() if name not in {"kind", "file"}}
    try:
        found = build(lookup("vehicle", "custom"), figures)
    except ConfigError:
        return None
    return found if isinstance(found, Vehicle) else None


def _alike(car: Vehicle, other: Vehicle) -> bool:
    same = car.kind in _MODEL3 and other.kind in _MODEL3
    return same or not _different(car, other)


def _different(car: Vehicle, other: Vehicle) -> list[str]:
    """The deciding figures that differ."""
    pairs = {name: (getattr(car, name), getattr(other, name)) for name in _DECIDING}
    return [name for name, (a, b) in pairs.items() if abs(a - b) > _ALIKE * max(abs(a), abs(b))]
