"""The sensors that have a stream: what they are set to, and what they send at a tick."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from carla_standin.blind import BLIND, Body
from carla_standin.blueprints import COLLISION, GNSS, NOISE
from carla_standin.geo import CARLAS_ORIGIN, GeoReference
from carla_standin.wire import Refused

if TYPE_CHECKING:
    from carla_standin.actors import Actor

# Type of the data, frame, time [s]; pose of the sensor.
HEADER = struct.Struct("<QQd6f")
_COLLISION_TYPE = 0
_GNSS_TYPE = 4
_IMU_TYPE = 5
_SAME_TIME = 1e-6
_GRAVITY = 9.81  # [m/s^2]


class Hit(NamedTuple):
    """Two vehicles whose boxes overlap, and the impulse that would stop their approach."""

    one: Actor
    other: Actor
    impulse: tuple[float, float]
    """On ``one``, in CARLA's world [N s]."""


@dataclass
class StreamedSensor:
    """A stream's source."""

    kind: str
    stream: int
    period: float = 0.0
    """Time between two measurements [s]; zero: at every tick."""
    noise: tuple[float, ...] = ()
    """What the attributes ``NOISE`` of its kind say."""
    rng: np.random.Generator = field(default_factory=np.random.default_rng)
    due: float = -math.inf
    """When the next measurement is due [s]."""
    origin: GeoReference = CARLAS_ORIGIN
    """Of the map on which it is."""
    body: Body | None = None
    """What it sends at a time, of one that sees nothing."""

    @classmethod
    def read(
        cls, kind: str, stream: int, attributes: dict[str, str], origin: GeoReference
    ) -> StreamedSensor:
        """From a blueprint's attributes.

        Raises:
            Refused: an attribute is no number, or one out of range.
        """
        try:
            period = float(attributes.get("sensor_tick", "0"))
            noise = {name: float(attributes.get(name, "0")) for name in NOISE.get(kind, ())}
            seed = abs(int(attributes.get("noise_seed", "0")))
        except ValueError as error:
            raise Refused(f"{kind}: {error}") from None
        least = [period, *(value for name, value in noise.items() if "stddev" in name)]
        if not all(map(math.isfinite, (period, *noise.values()))) or min(least) < 0.0:
            raise Refused(f"{kind}: sensor_tick and standard deviations must be 0 or more, finite")
        rng = np.random.default_rng(seed)
        blind = BLIND.get(kind)
        body = None if blind is None else blind.body(blind.attributes | attributes)
        return cls(kind, stream, period, tuple(noise.values()), rng, origin=origin, body=body)

    def measure(
        self, actor: Actor, hits: list[Hit], frame: int, time: float, heard: bool = True
    ) -> list[bytes]:
        """What the sensor ``actor`` sends at this tick; no image is made if it is not ``heard``."""
        if self.kind == COLLISION:
            mine = actor.parent
            said = [] if mine is None else [self._collision(mine, hit) for hit in hits]
            return [_message(_COLLISION_TYPE, frame, time, actor, data) for data in said if data]
        if time + _SAME_TIME < self.due:
            return []
        if self.period:
            late = time - self.due
            self.due = (time if late > self.period else self.due) + self.period
        if self.body is not None:
            head = HEADER.pack(BLIND[self.kind].data, frame, time, *actor.transform)
            return [head + self.body(time)] if heard else []
        if self.kind == GNSS:
            return [_message(_GNSS_TYPE, frame, time, actor, self._position(actor))]
        return [_message(_IMU_TYPE, frame, time, actor, self._inertia(actor))]

    @staticmethod
    def _collision(mine: Actor, hit: Hit) -> list[Any]:
        x, y = hit.impulse
        if hit.one is mine:
            return [mine.wire(), hit.other.wire(), [x, y, 0.0]]
        return [mine.wire(), hit.one.wire(), [-x, -y, 0.0]] if hit.other is mine else []

    def _position(self, actor: Actor) -> list[Any]:
        """Latitude and longitude [deg] and altitude [m]."""
        at = actor.transform
        true = (*self.origin.place(at.x, at.y), at.z)
        if not any(self.noise):
            return list(true)
        spread, bias = self.noise[:3], self.noise[3:]
        return [v + b + self.rng.normal(0.0, s) for v, b, s in zip(true, bias, spread, strict=True)]

    def _inertia(self, actor: Actor) -> list[Any]:
        """Specific force [m/s^2], rotation [rad/s], compass [rad], in the sensor's axes, y right.

        The sensor is upright: pitch and roll of its mounting are not taken into account. One that
        stands by itself is at rest.
        """
        (x, y), rate = _felt(actor)
        turned = math.radians(0.0 if actor.parent is None else actor.pose.yaw)
        c, s = math.cos(turned), math.sin(turned)
        force = [c * x - s * y, -c * y - s * x, _GRAVITY]
        turning = [0.0, 0.0, -rate]
        if any(self.noise):
            for i in range(3):
                force[i] += self.rng.normal(0.0, self.noise[i])
                turning[i] += self.noise[6 + i] + self.rng.normal(0.0, self.noise[3 + i])
        yaw = math.radians(actor.transform.yaw)
        # North is where CARLA's y axis does not point; east follows clockwise.
        return [force, turning, math.atan2(math.cos(yaw), -math.sin(yaw)) % math.tau]


def _felt(actor: Actor) -> tuple[tuple[float, float], float]:
    """Acceleration ahead and to the left of its car [m/s^2], and rate of yaw [rad/s], at a sensor.

    That of the point where it sits: a + spin x r - rate^2 r for the arm r from the centre of mass.
    """
    car = None if actor.parent is None else actor.parent.car
    if car is None:
        return (0.0, 0.0), 0.0
    rate, spin = car.motion.yaw_rate, car.yaw_acceleration
    a_x, a_y = car.motion.acceleration
    ahead, left = actor.pose.x - car.offset, -actor.pose.y
    forward = a_x - rate * rate * ahead - spin * left
    return (forward, a_y - rate * rate * left + spin * ahead), rate


def _message(kind: int, frame: int, time: float, actor: Actor, data: list[Any]) -> bytes:
    import msgpack

    # Degrees need all their digits.
    packed: bytes = msgpack.packb(data, use_single_float=kind != _GNSS_TYPE)
    return HEADER.pack(kind, frame, time, *actor.transform) + packed
