"""What can be spawned: vehicles, sensors, props, pedestrians; and the spectator's type."""

from __future__ import annotations

from typing import Any

import steersman as sm
from carla_standin.blind import BLIND
from carla_standin.bystanders import EXTENTS, PEDESTRIANS, PROPS
from carla_standin.catalogue import VehicleBlueprint
from carla_standin.wire import MAX_NAME, Refused

IMU = "sensor.other.imu"
GNSS = "sensor.other.gnss"
COLLISION = "sensor.other.collision"
LANE_INVASION = "sensor.other.lane_invasion"
SENSORS = (IMU, GNSS, COLLISION, LANE_INVASION, *BLIND)
SPECTATOR = "spectator"
# Listed, since clients look it up whether they need it or not, and never spawned.
WALKER_AI = "controller.ai.walker"
# Attribute, which CARLA does not have, that says what is here in the place of what is named.
STAND_IN = "stand_in"

# Types of attributes as CARLA counts them.
_BOOL, _INT, _FLOAT, _STRING, _COLOR = range(1, 6)
# Those of the Model 3 that clients name; there is nothing to paint here.
_COLORS = ("17,37,103", "75,87,173", "180,44,44", "180,180,180", "44,44,44", "137,0,0")
# Props whose box is half as long are medium [m].
_MEDIUM = 0.5
_PLACES = ("front", "back", "left", "right", "front_left", "front_right", "back_left", "back_right")
# Attributes that say how noisy a sensor is, in the order in which it keeps them.
_INERTIAL = ("accel_stddev", "gyro_stddev", "gyro_bias")
_ON_EARTH = ("lat_stddev", "lon_stddev", "alt_stddev", "lat_bias", "lon_bias", "alt_bias")
NOISE = {
    IMU: tuple(f"noise_{what}_{axis}" for what in _INERTIAL for axis in "xyz"),
    GNSS: tuple(f"noise_{what}" for what in _ON_EARTH),
}


def _given(name: str, kind: int, value: str) -> list[Any]:
    """An attribute that can be read and not set."""
    return [name, kind, value, [], False, False]


def _choice(name: str, kind: int, *values: str) -> list[Any]:
    """An attribute that can be set; these are recommended, the first is what it begins with."""
    return [name, kind, values[0], list(values), True, False]


def _car(model: VehicleBlueprint) -> list[list[Any]]:
    """Attributes of a vehicle, as 0.9.16 makes them, but for ``driver_id``."""
    fittings = str(model.fittings).lower()
    return [
        _choice("role_name", _STRING, "autopilot", "scenario", "ego_vehicle"),
        _choice("color", _COLOR, *_COLORS),
        _choice("sticky_control", _BOOL, "true"),
        _choice("terramechanics", _BOOL, "false"),
        _given("object_type", _STRING, ""),
        _given("base_type", _STRING, model.base),
        _given("special_type", _STRING, model.special),
        _given("number_of_wheels", _INT, str(model.wheels)),
        _given("generation", _INT, str(model.generation)),
        _given("has_dynamic_doors", _BOOL, fittings),
        _given("has_lights", _BOOL, fittings),
        _given(STAND_IN, _STRING, model.vehicle.title),
    ]


def definitions(vehicles: dict[str, VehicleBlueprint]) -> list[list[Any]]:
    """The blueprint library as it travels: uid, id, tags, attributes."""
    found = {name: _car(model) for name, model in vehicles.items()}
    found |= {name: _sensor(name) for name in SENSORS}
    found |= {name: _prop(PROPS[name]) for name in PROPS}
    found |= {name: _pedestrian() for name in PEDESTRIANS}
    found[WALKER_AI] = [_choice("role_name", _STRING, "default")]
    return [
        [uid, name, name.replace(".", ","), attributes]
        for uid, (name, attributes) in enumerate(found.items(), start=1)
    ]


def _sensor(name: str) -> list[list[Any]]:
    """Attributes of a sensor."""
    place = _choice("role_name", _STRING, *_PLACES)
    tick, seed = _choice("sensor_tick", _FLOAT, "0.0"), _choice("noise_seed", _INT, "0")
    if name in BLIND:
        own = [_choice(each, _type(value), value) for each, value in BLIND[name].attributes.items()]
        return [place, tick, *own, _given(STAND_IN, _STRING, BLIND[name].seen)]
    noise = [_choice(each, _FLOAT, "0.0") for each in NOISE.get(name, ())]
    return [place, tick, *noise, seed] if noise else [place]


def _prop(extent: tuple[float, ...]) -> list[list[Any]]:
    """Attributes of a prop."""
    size = "small" if max(extent) < _MEDIUM else "medium"
    return [_choice("role_name", _STRING, "prop"), _given("size", _STRING, size)]


def _pedestrian() -> list[list[Any]]:
    """Attributes of a pedestrian; all are alike."""
    return [
        _choice("role_name", _STRING, "pedestrian"),
        _choice("is_invincible", _BOOL, "true", "false"),
        _choice("speed", _FLOAT, "0.0", "1.4", "2.4"),
        _given("gender", _STRING, "other"),
        _given("age", _STRING, "adult"),
        _given("generation", _INT, "2"),
    ]


def _type(value: str) -> int:
    """Of an attribute that begins with this value."""
    if value in {"true", "false"}:
        return _BOOL
    if value.lstrip("-").isdigit():
        return _INT
    return _FLOAT if value.lstrip("-").replace(".", "", 1).isdigit() else _STRING


def check(name: str, vehicles: dict[str, VehicleBlueprint]) -> None:
    """Whether a blueprint of that name can be spawned.

    Raises:
        Refused: it cannot.
    """
    if name == WALKER_AI:
        raise Refused(
            f"{name}: there is no navigation here; a walker goes where apply_control says"
        )
    known = [*vehicles, *SENSORS, *EXTENTS]
    if name not in known:
        short = name[:MAX_NAME]
        raise Refused(f"{short!r} is not in the blueprint library{sm.suggestion(short, known)}")
