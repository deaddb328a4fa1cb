"""Disturbances as points of a box around the nominal, and how far a point is from it.

Each quantity has a coordinate: 0 is the nominal value, 1 the end of its stated range, -1 the other
end where it can be disturbed both ways. How mild a disturbance is, is the Euclidean norm of its
coordinates: 0.5 is half a range of one quantity, or less of several at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

from pydantic import model_validator

from steersman.bench.disturbance import Disturbance
from steersman.config import Settings, param
from steersman.errors import ConfigError
from steersman.rollout import RunConfig
from steersman.speed import SpeedComponent

Point: TypeAlias = dict[str, float]

# Fields that are multiplied when everything is to be driven faster, by the kind of speed.
_SPEEDS = {
    "constant_speed": ("speed",),
    "nedc": ("scale",),
    "path": ("scale",),
    "random_profile": ("low", "high", "change"),
}


class Axis(NamedTuple):
    """A quantity that is disturbed."""

    unit: str
    """Unit of its value."""
    sides: tuple[float, ...]
    """Coordinates of the ends of its range."""


AXES = {
    "mass": Axis("-", (-1.0, 1.0)),
    "friction": Axis("-", (1.0,)),
    "delay": Axis("s", (1.0,)),
    "waypoint_noise": Axis("m", (1.0,)),
    "speed": Axis("-", (-1.0, 1.0)),
}


class Ranges(Settings):
    """How far each quantity is disturbed at most; 0 leaves it alone."""

    mass: float = param(0.5, "-", "Mass and yaw inertia: 1 +- this, times the car's.", ge=0, lt=1)
    friction: float = param(
        0.3, "-", "Lowest tyre friction coefficient; on a logarithmic scale from the car's.", ge=0
    )
    delay: float = param(0.5, "s", "Longest steering delay, added to the vehicle's own.", ge=0)
    waypoint_noise: float = param(
        0.5, "m", "Waypoints are shifted by up to this in x and in y, anew at each step.", ge=0
    )
    speed: float = param(0.5, "-", "Speeds: 1 +- this, times the given ones.", ge=0, lt=1)

    @model_validator(mode="after")
    def _some(self) -> Ranges:
        if not self.names():
            raise ConfigError("all are 0; at least one quantity has to be disturbed")
        return self

    def names(self) -> list[str]:
        """The quantities that are disturbed."""
        return [name for name in AXES if getattr(self, name) > 0.0]

    def values(self, point: Mapping[str, float], run: RunConfig) -> dict[str, float]:
        """The physical values of a point: factors, friction coefficient, delay [s], noise [m].

        A delay is a whole number of the steps at which the plant's commands can begin to act.

        >>> Ranges().values({"mass": -0.5, "delay": 0.995}, RunConfig())
        {'mass': 0.75, 'delay': 0.5}
        """
        return {name: self._value(name, u, run) for name, u in point.items()}

    def _value(self, name: str, u: float, run: RunConfig) -> float:
        end: float = getattr(self, name)
        if name == "friction":
            friction = run.vehicle.friction
            return float(friction * (end / friction) ** u)
        if name == "delay":
            return round(u * end / run.plant.h) * run.plant.h
        return 1.0 + u * end if name in ("mass", "speed") else u * end

    def disturbed(self, run: RunConfig, point: Mapping[str, float]) -> RunConfig:
        """The run at a point; ``run`` is the undisturbed one.

        Raises:
            ConfigError: the run's speed cannot be scaled.
        """
        values = self.values(point, run)
        mass = values.get("mass", 1.0)
        # The car's own friction is no disturbance: speeds are only as careful as they were.
        friction = values["friction"] if point.get("friction") else None
        disturbance = Disturbance(
            mass=mass,
            yaw_inertia=mass,
            friction=friction,
            delay=values.get("delay", 0.0),
            waypoint_noise=values.get("waypoint_noise", 0.0),
        )
        speed = scaled(run.speed, values.get("speed", 1.0))
        return disturbance.apply(run.model_copy(update={"speed": speed}))


def scaled(speed: SpeedComponent, factor: float) -> SpeedComponent:
    """The same source of speed with all speeds times ``factor``; a cap in bends stays.

    Raises:
        ConfigError: this kind has no speeds to multiply.
    """
    if factor == 1.0:
        return speed
    return speed.model_copy(
        update={name: factor * getattr(speed, name) for name in scaled_fields(speed)}
    )


def scaled_fields(speed: SpeedComponent) -> tuple[str, ...]:
    """The fields that are multiplied.

    Raises:
        ConfigError: this kind has no speeds to multiply.
    """
    if speed.kind not in _SPEEDS:
        raise ConfigError(
            f"the speeds of {speed.kind!r} cannot be scaled; allowed: {', '.join(_SPEEDS)};"
            " or leave the speed alone with ranges.speed=0",
            ("speed",),
        )
    return _SPEEDS[speed.kind]


def norm(point: Mapping[str, float]) -> float:
    """How mild a disturbance is: the Euclidean norm of its coordinates.

    >>> norm({"mass": -0.6, "delay": 0.8})
    1.0
    """
    return math.hypot(*point.values())


def shown(values: Mapping[str, float]) -> dict[str, float]:
    """Physical values by names that tell their unit."""
    suffix = {"s": "_s", "m": "_m", "-": ""}
    return {f"{name}{suffix[AXES[name].unit]}": value for name, value in values.items()}
