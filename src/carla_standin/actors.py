"""Actors: what the world consists of, and how each looks on the wire."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from carla_standin.wire import Refused, Transform

if TYPE_CHECKING:
    from carla_standin.bystanders import WalkerControl
    from carla_standin.car import Car, VehicleControl
    from carla_standin.catalogue import VehicleBlueprint
    from carla_standin.sensors import StreamedSensor

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
_TAG_CAR, _TAG_WALKER = bytes([14]), bytes([12])


@dataclass
class Actor:
    """One actor; it has a car, a sensor, a walk, or none (the spectator, props)."""

    number: int
    description: list[Any]
    pose: Transform
    """In the world, or relative to the parent."""
    parent: Actor | None = None
    extent: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Half of the bounding box [m]."""
    car: Car | None = None
    model: VehicleBlueprint | None = None
    control: VehicleControl | None = None
    sensor: StreamedSensor | None = None
    walk: WalkerControl | None = None
    token: bytes = b""
    lights: int = 0
    """Which of its lights a client has switched on, as flags; none is seen."""
    applied_physics: list[Any] | None = field(default=None)
    """The last physics control that a client applied."""

    @property
    def kind(self) -> str:
        """Name of the blueprint."""
        return str(self.description[1])

    @property
    def driver(self) -> VehicleControl:
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
        return self.pose if self.parent is None else self.parent.transform.placed(self.pose)

    def place(self, where: Transform) -> None:
        """Move it; what is attached moves relative to its parent."""
        if self.car is not None:
            self.car.transform = where
        else:
            self.pose = where

    def box(self) -> list[Any]:
        """Bounding box as it travels: centre and half size [m], rotation [deg], actor."""
        middle = self.extent[2] if self.walk is None else 0.0
        return [[0.0, 0.0, middle], list(self.extent), [0.0, 0.0, 0.0], self.number]

    @property
    def sunk(self) -> float:
        """Its box's lower end below its origin [m], which is in the middle of a pedestrian."""
        return 0.0 if self.walk is None else self.extent[2]

    def wire(self) -> list[Any]:
        """The actor as it travels in calls."""
        parent = 0 if self.parent is None else self.parent.number
        tags = _TAG_CAR if self.car is not None else b"" if self.walk is None else _TAG_WALKER
        return [self.number, parent, self.description, self.box(), tags, self.token]

    @property
    def solid(self) -> bool:
        """Whether it takes room."""
        return self.extent[0] > 0.0

    @property
    def velocity(self) -> tuple[float, float]:
        """Of its centre of mass, or of a walk, in the world's axes [m/s]."""
        if self.car is not None:
            return self.car.velocity
        return (0.0, 0.0) if self.walk is None else self.walk.velocity

    def advance(self, dt: float) -> None:
        """Walk for ``dt`` [s], facing where it goes."""
        if self.walk is not None and self.walk.speed > 0.0:
            x, y = self.velocity
            yaw = math.degrees(math.atan2(y, x))
            at = self.pose
            self.pose = at._replace(x=at.x + dt * x, y=at.y + dt * y, yaw=yaw)

    def snapshot(self) -> bytes:
        """The actor as it travels in a snapshot."""
        if self.car is None or self.control is None:
            state = b"" if self.walk is None else self.walk.snapshot()
            rest = [0.0] * 7
            moved = _MOTION.pack(self.number, _ACTIVE, *self.transform, *self.velocity, *rest)
            return moved + state.ljust(_KIND_BYTES, b"\0")
        car = self.car
        where = car.transform
        motion = _MOTION.pack(
            self.number,
            _ACTIVE,
            *where,
            *car.velocity,
            0.0,
            0.0,
            0.0,
            car.yaw_rate,
            *car.acceleration,
            0.0,
        )
        failure = _ROLLED_OVER if car.motion.rolled_over() else 0
        told = _CONTROL.pack(*self.control.told, _SPEED_LIMIT, _GREEN, False, 0, failure)
        return motion + told.ljust(_KIND_BYTES, b"\0")


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
    """Whether two upright boxes overlap: neither height nor a side of either separates them."""
    a, b = one.transform, other.transform
    reach = math.hypot(*one.extent[:2]) + math.hypot(*other.extent[:2])
    if math.hypot(a.x - b.x, a.y - b.y) > reach:
        return False
    low, high = a.z - one.sunk, b.z - other.sunk
    if low + 2.0 * one.extent[2] < high or high + 2.0 * other.extent[2] < low:
        return False
    first, second = corners(one), corners(other)
    for yaw in (a.yaw, a.yaw + 90.0, b.yaw, b.yaw + 90.0):
        c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
        mine = [c * x + s * y for x, y in first]
        theirs = [c * x + s * y for x, y in second]
        if max(mine) < min(theirs) or max(theirs) < min(mine):
            return False
    return True
