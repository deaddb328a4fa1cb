"""CARLA's axes and ours, converted here and nowhere else in the stand-in.

CARLA: x forward, y right, z up (left-handed), degrees, steering right-positive; an actor's pose is
that of its origin, which lies ``offset`` behind the centre of mass. Ours: ISO 8855, radians, the
centre of mass. The ground is flat: z, roll and pitch of a vehicle are zero.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.types import Pose

_DEG = 180.0 / math.pi


class Transform(NamedTuple):
    """A pose as CARLA says it: location [m] and rotation [deg]."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0

    def wire(self) -> list[list[float]]:
        """As it travels in calls."""
        return [[self.x, self.y, self.z], [self.pitch, self.yaw, self.roll]]


def origin_of(x: float, y: float, psi: float, offset: float) -> Transform:
    """Where the actor's origin is when its centre of mass is at x, y [m] with yaw psi [rad].

    >>> origin_of(10.0, 2.0, 0.0, 0.45)
    Transform(x=9.55, y=-2.0, z=0.0, pitch=0.0, yaw=0.0, roll=0.0)
    """
    yaw = -_DEG * math.remainder(psi, math.tau)
    along, across = math.cos(psi), math.sin(psi)
    return Transform(x=x - offset * along, y=0.0 - (y - offset * across), yaw=yaw + 0.0)


def mass_centre_of(transform: Transform, offset: float) -> Pose:
    """The inverse of :func:`origin_of`.

    >>> mass_centre_of(Transform(x=9.55, y=-2.0, yaw=0.0), 0.45)
    Pose(x=10.0, y=2.0, psi=0.0)
    """
    psi = 0.0 - transform.yaw / _DEG
    along, across = math.cos(psi), math.sin(psi)
    return Pose(transform.x + offset * along, offset * across - transform.y, psi)


def to_world(psi: float, forward: float, left: float) -> tuple[float, float]:
    """A vector in our vehicle's frame, as x and y in CARLA's world."""
    c, s = math.cos(psi), math.sin(psi)
    return c * forward - s * left, 0.0 - (s * forward + c * left)


def to_body(psi: float, x: float, y: float) -> tuple[float, float]:
    """The inverse of :func:`to_world`: forward and left."""
    c, s = math.cos(psi), math.sin(psi)
    return c * x - s * y, 0.0 - (s * x + c * y)


def placed(parent: Transform, relative: Transform) -> Transform:
    """A transform given relative to an upright parent (yaw only), in the world."""
    c, s = math.cos(parent.yaw / _DEG), math.sin(parent.yaw / _DEG)
    return Transform(
        parent.x + c * relative.x - s * relative.y,
        parent.y + s * relative.x + c * relative.y,
        parent.z + relative.z,
        relative.pitch,
        math.remainder(parent.yaw + relative.yaw, 360.0),
        relative.roll,
    )


def rate_deg(yaw_rate: float) -> float:
    """Our yaw rate [rad/s] as CARLA's [deg/s]; the other way round with :func:`rate_rad`."""
    return 0.0 - _DEG * yaw_rate


def rate_rad(rate: float) -> float:
    """CARLA's yaw rate [deg/s] as ours [rad/s]."""
    return 0.0 - rate / _DEG
