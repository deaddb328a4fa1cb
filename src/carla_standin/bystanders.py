"""What stands or walks about: props, and pedestrians that go where a client's control says."""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

from carla_standin.wire import Refused, shaped

# Half of the boxes [m]: along, across, up. The sizes are about those of such things in general.
PROPS = {
    "static.prop.barrel": (0.3, 0.3, 0.45),
    "static.prop.bench01": (0.3, 0.9, 0.45),
    "static.prop.box01": (0.3, 0.3, 0.3),
    "static.prop.constructioncone": (0.2, 0.2, 0.35),
    "static.prop.container": (1.0, 0.6, 0.6),
    "static.prop.streetbarrier": (0.2, 0.6, 0.5),
    "static.prop.trafficcone01": (0.2, 0.2, 0.35),
    "static.prop.trafficwarning": (0.7, 1.2, 1.2),
    "static.prop.trashcan01": (0.3, 0.3, 0.5),
    "static.prop.warningaccident": (0.1, 0.4, 0.5),
}
PEDESTRIANS = tuple(f"walker.pedestrian.{number:04d}" for number in range(1, 11))
_BODY = (0.19, 0.19, 0.93)
EXTENTS = PROPS | dict.fromkeys(PEDESTRIANS, _BODY)
# Mass of a pedestrian [kg]; a prop gives way to nothing.
WEIGHT = 70.0
# Faster than anyone walks or runs [m/s].
_FASTEST = 20.0
# Direction, speed [m/s], jump, time stamp, as a snapshot has them.
_STATE = struct.Struct("<4f?f")


class WalkerControl(NamedTuple):
    """Direction in the world, of length 1 or 0, and speed [m/s] of a pedestrian."""

    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    speed: float = 0.0
    jump: bool = False

    @classmethod
    def read(cls, values: Any) -> WalkerControl:
        """From the wire.

        Raises:
            Refused: it is none, or not finite.
        """
        (x, y, z), speed, jump = shaped(values, ((0.0, 0.0, 0.0), 0.0, False))
        if not all(map(math.isfinite, (x, y, z, speed))):
            raise Refused(f"a walker's control must be finite: {values!r:.80}")
        length = math.hypot(x, y) or 1.0
        if not math.isfinite(length):
            raise Refused(f"a walker's direction is too long: {values!r:.80}")
        return cls((x / length, y / length, 0.0), min(max(speed, 0.0), _FASTEST), jump)

    @property
    def velocity(self) -> tuple[float, float]:
        """In the world's axes [m/s]."""
        return self.speed * self.direction[0], self.speed * self.direction[1]

    def snapshot(self) -> bytes:
        """As it travels in a snapshot."""
        return _STATE.pack(*self.direction, self.speed, self.jump, 0.0)
