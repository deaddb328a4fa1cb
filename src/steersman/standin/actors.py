"""Actors: what the world consists of, and how each looks on the wire."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from steersman.standin.axes import Transform, placed, rate_deg, to_world
from steersman.standin.wire import Refused

if TYPE_CHECKING:
    from steersman.standin.blueprints import Model
    from steersman.standin.car import Car
    from steersman.standin.control import Control
    from steersman.standin.sensors import Sensor

# An actor in a snapshot: id, state; pose, velocity [m/s], angular velocity [deg/s], acceleration
# [m/s^2]; 54 bytes that depend on its kind, for a vehicle its control, speed limit, traffic light
# and failure.
_MOTION = struct.Struct("<IB15f")
_CONTROL = struct.Struct("<3f3?ifB?IB")
_KIND_BYTES = 54
_ACTIVE = 1
_ROLLED_OVER = 1
_GREEN = 2
_SPEED_LIMIT = 30.0
_TAG_CAR = bytes([14])
# Farther than this from the origin nothing is placed [m].
_FARTHEST = 1e6


@dataclass
class Actor:
    """One actor; it has a car, or a sensor, or neither (the spectator)."""

    number: int
    description: list[Any]
    pose: Transform
    """In the world, or relative to the parent."""
    parent: Actor | None = None
    extent: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Half of the bounding box [m]."""
    car: Car | None = None
    model: Model | None = None
    control: Control | None = None
    sensor: Sensor | None = None
    token: bytes = b""
    applied_physics: list[Any] | None = field(default=None)
    """The last physics control that a client applied."""

    @property
    def kind(self) -> str:
        """Name of the blueprint."""
        return str(self.description[1])

    @property
    def driver(self) -> Control:
        """What moves its pedals.

        Raises:
            Refused: it has none.
        """
        if self.control is None:
            raise Refused(f"actor {self.number} ({self.kind}) is no vehicle")
        return self.control

    @property
    def transform(self) -> Transform:
        """Pose in the world."""
        if self.car is not None:
            return self.car.transform
        return self.pose if self.parent is None else placed(self.parent.transform, self.pose)

    def place(self, where: Transform) -> None:
        """Move it; what is attached moves relative to its parent."""
        if self.car is not None:
            self.car.transform = where
        else:
            self.pose = where

    def box(self) -> list[Any]:
        """Bounding box as it travels: centre and half size [m], rotation [deg], actor."""
        return [[0.0, 0.0, self.extent[2]], list(self.extent), [0.0, 0.0, 0.0], self.number]

    def wire(self) -> list[Any]:
        """The actor as it travels in calls."""
        parent = 0 if self.parent is None else self.parent.number
        tags = b"" if self.car is None else _TAG_CAR
        return [self.number, parent, self.description, self.box(), tags, self.token]

    def snapshot(self) -> bytes:
        """The actor as it travels in a snapshot."""
        if self.car is None or self.control is None:
            return _MOTION.pack(self.number, _ACTIVE, *self.transform, *[0.0] * 9) + bytes(
                _KIND_BYTES
            )
        car = self.car
        _, _, psi, v_x, v_y, rate, _, _, _, _, _, a_x, a_y, _ = car.state.tolist()
        where = car.transform
        motion = _MOTION.pack(
            self.number,
            _ACTIVE,
            *where,
            *to_world(psi, v_x, v_y),
            0.0,
            0.0,
            0.0,
            rate_deg(rate),
            *to_world(psi, a_x, a_y),
            0.0,
        )
        failure = _ROLLED_OVER if car.rolled_over() else 0
        told = _CONTROL.pack(*self.control.told, _SPEED_LIMIT, _GREEN, False, 0, failure)
        return motion + told.ljust(_KIND_BYTES, b"\0")


def read_transform(values: Any) -> Transform:
    """A transform from the wire.

    Raises:
        Refused: it is none, or beyond all bounds.
    """
    match values:
        case [[x, y, z], [pitch, yaw, roll]]:
            found = Transform(*map(float, (x, y, z, pitch, yaw, roll)))
            if all(math.isfinite(v) and abs(v) <= _FARTHEST for v in found):
                return found
    raise Refused(f"not a transform, or one farther than {_FARTHEST:g} m: {values!r:.80}")


def read_vector(values: Any) -> tuple[float, float, float]:
    """A vector from the wire.

    Raises:
        Refused: it is none, or beyond all bounds.
    """
    match values:
        case [x, y, z]:
            found = float(x), float(y), float(z)
            if all(math.isfinite(v) and abs(v) <= _FARTHEST for v in found):
                return found
    raise Refused(f"not a vector of finite numbers: {values!r:.80}")


def corners(actor: Actor) -> list[tuple[float, float]]:
    """Ground corners of the bounding box in the world [m]."""
    at = actor.transform
    c, s = math.cos(math.radians(at.yaw)), math.sin(math.radians(at.yaw))
    length, width, _ = actor.extent
    return [
        (at.x + c * u - s * v, at.y + s * u + c * v)
        for u, v in ((length, width), (-length, width), (-length, -width), (length, -width))
    ]


def overlap(one: Actor, other: Actor) -> bool:
    """Whether two boxes overlap on the ground: no side of either separates them."""
    a, b = one.transform, other.transform
    reach = math.hypot(*one.extent[:2]) + math.hypot(*other.extent[:2])
    if math.hypot(a.x - b.x, a.y - b.y) > reach:
        return False
    first, second = corners(one), corners(other)
    for yaw in (a.yaw, a.yaw + 90.0, b.yaw, b.yaw + 90.0):
        c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
        mine = [c * x + s * y for x, y in first]
        theirs = [c * x + s * y for x, y in second]
        if max(mine) < min(theirs) or max(theirs) < min(mine):
            return False
    return True
