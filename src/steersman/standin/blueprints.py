"""What can be spawned: vehicles, the spectator's type, and two sensors."""

from __future__ import annotations

from typing import Any, NamedTuple

from steersman.errors import suggestion
from steersman.standin.wire import MAX_NAME, Refused
from steersman.vehicles import CarlaMkz2020, CarlaModel3, Vehicle

MODEL3 = "vehicle.tesla.model3"
MKZ = "vehicle.lincoln.mkz_2020"
IMU = "sensor.other.imu"
COLLISION = "sensor.other.collision"
SPECTATOR = "spectator"

# Types of attributes as CARLA counts them.
_BOOL, _INT, _FLOAT, _STRING, _COLOR = range(1, 6)
_NOISE = ("accel_stddev", "gyro_stddev", "gyro_bias")


class Model(NamedTuple):
    """A vehicle that can be spawned, and what our parameters do not say of it."""

    vehicle: Vehicle
    offset: float
    """Centre of mass ahead of the actor's origin [m]."""
    below: float
    """Centre of mass above the actor's origin [m]; negative: below."""
    height: float
    """Of the body [m]."""
    radius: float
    """Of the wheels [m]."""


def models(model3: Vehicle) -> dict[str, Model]:
    """The vehicles by blueprint; ``model3`` is what drives behind the Model 3's name.

    Offsets, heights and radii: CARLA's blueprints; the MKZ's body is taken to be the Model 3's.
    """
    return {
        MODEL3: Model(model3, 0.45, -0.3, 1.49, 0.37),
        MKZ: Model(CarlaMkz2020(), 0.6, -0.3, 1.49, 0.37),
    }


def default_models() -> dict[str, Model]:
    """The vehicles as they are shipped."""
    return models(CarlaModel3())


def _attribute(name: str, kind: int, value: str, modifiable: bool = True) -> list[Any]:
    return [name, kind, value, [], modifiable, False]


def definitions(vehicles: dict[str, Model]) -> list[list[Any]]:
    """The blueprint library as it travels: uid, id, tags, attributes."""
    found: dict[str, list[list[Any]]] = {}
    for name in vehicles:
        found[name] = [
            _attribute("base_type", _STRING, "car", False),
            _attribute("number_of_wheels", _INT, "4", False),
            _attribute("color", _COLOR, "180,180,180"),
            _attribute("role_name", _STRING, "autopilot"),
            _attribute("sticky_control", _BOOL, "true"),
        ]
    common = [_attribute("role_name", _STRING, "front"), _attribute("sensor_tick", _FLOAT, "0.0")]
    noise = [_attribute(f"noise_{what}_{axis}", _FLOAT, "0.0") for what in _NOISE for axis in "xyz"]
    found[IMU] = [*common, *noise, _attribute("noise_seed", _INT, "0")]
    found[COLLISION] = [_attribute("role_name", _STRING, "front")]
    return [
        [uid, name, name.replace(".", ","), attributes]
        for uid, (name, attributes) in enumerate(found.items(), start=1)
    ]


def check(name: str, vehicles: dict[str, Model]) -> None:
    """Whether a blueprint of that name can be spawned.

    Raises:
        Refused: it cannot.
    """
    known = [*vehicles, IMU, COLLISION]
    if name not in known:
        short = name[:MAX_NAME]
        raise Refused(f"{short!r} is not in the blueprint library{suggestion(short, known)}")
