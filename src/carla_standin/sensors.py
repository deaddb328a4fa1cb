"""The two sensors that have a stream: inertial measurement and collisions."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from carla_standin.blueprints import COLLISION
from carla_standin.wire import Refused

if TYPE_CHECKING:
    from carla_standin.actors import Actor

# Type of the data, frame, time [s]; pose of the sensor.
HEADER = struct.Struct("<QQd6f")
_COLLISION_TYPE = 0
_IMU_TYPE = 5
_NOISE = ("accel_stddev", "gyro_stddev", "gyro_bias")
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
    noise: tuple[float, ...] = (0.0,) * 9
    """Standard deviations of acceleration and of rotation, bias of rotation, by axis."""
    rng: np.random.Generator = field(default_factory=np.random.default_rng)
    due: float = -math.inf
    """When the next measurement is due [s]."""

    @classmethod
    def read(cls, kind: str, stream: int, attributes: dict[str, str]) -> StreamedSensor:
        """From a blueprint's attributes.

        Raises:
            Refused: an attribute is no number, or one out of range.
        """
        try:
            period = float(attributes.get("sensor_tick", "0"))
            noise = tuple(
                float(attributes.get(f"noise_{what}_{axis}", "0"))
                for what in _NOISE
                for axis in "xyz"
            )
            seed = abs(int(attributes.get("noise_seed", "0")))
        except ValueError as error:
            raise Refused(f"{kind}: {error}") from None
        numbers = (period, *noise)
        if not all(map(math.isfinite, numbers)) or min(numbers[:7]) < 0.0:
            raise Refused(f"{kind}: sensor_tick and standard deviations must be 0 or more, finite")
        return cls(kind, stream, period, noise, np.random.default_rng(seed))

    def measure(self, actor: Actor, hits: list[Hit], frame: int, time: float) -> list[bytes]:
        """What the sensor ``actor`` sends at this tick."""
        if actor.parent is None or actor.parent.car is None:
            return []
        if self.kind == COLLISION:
            said = [self._collision(actor.parent, hit) for hit in hits]
            return [_message(_COLLISION_TYPE, frame, time, actor, data) for data in said if data]
        if time + _SAME_TIME < self.due:
            return []
        if self.period:
            late = time - self.due
            self.due = (time if late > self.period else self.due) + self.period
        return [_message(_IMU_TYPE, frame, time, actor, self._inertia(actor))]

    @staticmethod
    def _collision(mine: Actor, hit: Hit) -> list[Any]:
        x, y = hit.impulse
        if hit.one is mine:
            return [mine.wire(), hit.other.wire(), [x, y, 0.0]]
        return [mine.wire(), hit.one.wire(), [-x, -y, 0.0]] if hit.other is mine else []

    def _inertia(self, actor: Actor) -> list[Any]:
        """Specific force [m/s^2], rotation [rad/s], compass [rad], in the sensor's axes, y right.

        That of the point where it sits: a + spin x r - rate^2 r for the arm r from the centre of
        mass. The sensor is upright: pitch and roll of its mounting are not taken into account.
        """
        parent = actor.parent
        assert parent is not None and parent.car is not None  # noqa: PT018
        car = parent.car
        rate, spin = car.motion.yaw_rate, car.yaw_acceleration
        a_x, a_y = car.motion.acceleration
        ahead, left = actor.pose.x - car.offset, -actor.pose.y
        forward = a_x - rate * rate * ahead - spin * left
        leftward = a_y - rate * rate * left + spin * ahead
        turned = math.radians(actor.pose.yaw)
        c, s = math.cos(turned), math.sin(turned)
        right = -leftward
        force = [c * forward + s * right, c * right - s * forward, _GRAVITY]
        turning = [0.0, 0.0, -rate]
        if any(self.noise):
            for i in range(3):
                force[i] += self.rng.normal(0.0, self.noise[i])
                turning[i] += self.noise[6 + i] + self.rng.normal(0.0, self.noise[3 + i])
        yaw = math.radians(actor.transform.yaw)
        # North is where CARLA's y axis does not point; east follows clockwise.
        return [force, turning, math.atan2(math.cos(yaw), -math.sin(yaw)) % math.tau]


def _message(kind: int, frame: int, time: float, actor: Actor, data: list[Any]) -> bytes:
    import msgpack

    packed: bytes = msgpack.packb(data, use_single_float=True)
    return HEADER.pack(kind, frame, time, *actor.transform) + packed
