"""CARLA's axes, signs and units, and ours: converted here, and nowhere else in the plant.

CARLA is left-handed: x forward, y right, z up; yaw turns to the right, in degrees, and so do yaw
rates [deg/s] and steering. Ours are ISO 8855's: y left, angles to the left, radians. CARLA tells
the pose of an actor's *origin*; we use that of the centre of mass. Its velocity needs no transfer:
the engine's body velocity is that of the centre of mass already.

``ahead`` and ``left`` say where the centre of mass is, seen from the origin [m].
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.types import Pose


class Placement(NamedTuple):
    """Where CARLA has an actor's origin: x, y [m] in CARLA's world, yaw [deg]."""

    x: float
    y: float
    yaw: float


class Offset(NamedTuple):
    """The centre of mass, seen from the actor's origin, in our axes [m]."""

    ahead: float = 0.0
    left: float = 0.0


def placement(pose: Pose, offset: Offset) -> Placement:
    """The actor's placement for a pose of its centre of mass; the inverse of :func:`pose_of`.

    >>> placement(Pose(10.0, 2.0, 0.0), Offset(0.45))
    Placement(x=9.55, y=-2.0, yaw=0.0)
    """
    c, s = math.cos(pose.psi), math.sin(pose.psi)
    x = pose.x - c * offset.ahead + s * offset.left
    y = pose.y - s * offset.ahead - c * offset.left
    return Placement(x, 0.0 - y, degrees_right(math.remainder(pose.psi, math.tau)))


def pose_of(at: Placement, offset: Offset) -> Pose:
    """The pose of the centre of mass, yaw within a turn of zero.

    >>> pose_of(Placement(9.55, -2.0, 0.0), Offset(0.45))
    Pose(x=10.0, y=2.0, psi=0.0)
    """
    psi = radians_left(at.yaw)
    c, s = math.cos(psi), math.sin(psi)
    return Pose(
        at.x + c * offset.ahead - s * offset.left,
        s * offset.ahead + c * offset.left - at.y,
        psi,
    )


def degrees_right(angle: float) -> float:
    """An angle [rad] or rate [rad/s] to the left, as CARLA's to the right [deg], [deg/s]."""
    return 0.0 - math.degrees(angle)


def radians_left(angle: float) -> float:
    """The inverse of :func:`degrees_right`."""
    return 0.0 - math.radians(angle)


def world_vector(psi: float, forward: float, left: float) -> tuple[float, float]:
    """A vector in our vehicle's frame as x and y in CARLA's world."""
    c, s = math.cos(psi), math.sin(psi)
    return c * forward - s * left, 0.0 - (s * forward + c * left)


def body_vector(psi: float, x: float, y: float) -> tuple[float, float]:
    """The inverse of :func:`world_vector`: forward and left."""
    c, s = math.cos(psi), math.sin(psi)
    return c * x - s * y, 0.0 - (s * x + c * y)


def unwrapped(angle: float, near: float) -> float:
    """The angle [rad], whole turns added so that it is as near as can be to ``near``."""
    return near + math.remainder(angle - near, math.tau)


def a_step_before(pose: Pose, course: float, speed: float, yaw_rate: float, dt: float) -> Pose:
    """Where a vehicle in a steady turn was ``dt`` [s] earlier.

    ``course`` is the direction of its velocity at ``pose`` [rad]. The chord of the arc is as long
    as the arc times sin(x)/x of half the turned angle, in the direction of its middle.
    """
    half = 0.5 * yaw_rate * dt
    chord = speed * dt * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)  # noqa: PLR2004
    middle = course - half
    return Pose(
        pose.x - chord * math.cos(middle), pose.y - chord * math.sin(middle), pose.psi - 2.0 * half
    )
