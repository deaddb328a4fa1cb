"""CARLA's axes, signs and units, converted to ours and back: here and nowhere else.

CARLA is left-handed: x forward, y right, z up; yaw, yaw rates [deg/s] and steering are positive to
the right, in degrees. Ours are ISO 8855's: y left, angles positive to the left, radians. CARLA
gives the pose of an actor's *origin*; ours is that of the centre of mass. Velocities need no
transfer: the engine's body velocity is that of the centre of mass already.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from steersman.types import Pose


class Placement(NamedTuple):
    """An actor's origin in CARLA's world: x, y [m], yaw [deg]."""

    x: float
    y: float
    yaw: float

    @classmethod
    def of(cls, transform: Any) -> Placement:
        """From a ``carla.Transform``."""
        return cls(transform.location.x, transform.location.y, transform.rotation.yaw)


class CarlaFrame(NamedTuple):
    """Where an actor's centre of mass is, seen from its origin, in our axes [m].

    >>> CarlaFrame(0.45).placement(Pose(10.0, 2.0, 0.0))
    Placement(x=9.55, y=-2.0, yaw=0.0)
    >>> CarlaFrame(0.45).pose(9.55, -2.0, 0.0)
    Pose(x=10.0, y=2.0, psi=0.0)
    """

    ahead: float = 0.0
    left: float = 0.0

    def placement(self, pose: Pose) -> Placement:
        """CARLA's placement of the origin for a pose of the centre of mass."""
        c, s = math.cos(pose.psi), math.sin(pose.psi)
        x = pose.x - c * self.ahead + s * self.left
        y = pose.y - s * self.ahead - c * self.left
        return Placement(x, 0.0 - y, self.degrees_right(math.remainder(pose.psi, math.tau)))

    def pose(self, x: float, y: float, yaw: float) -> Pose:
        """The pose of the centre of mass for a placement of the origin."""
        psi = self.radians_left(yaw)
        c, s = math.cos(psi), math.sin(psi)
        return Pose(x + c * self.ahead - s * self.left, s * self.ahead + c * self.left - y, psi)

    @staticmethod
    def degrees_right(angle: float) -> float:
        """An angle [rad] or rate [rad/s] to the left as CARLA's to the right [deg], [deg/s]."""
        return 0.0 - math.degrees(angle)

    @staticmethod
    def radians_left(angle: float) -> float:
        """The inverse of :meth:`degrees_right`."""
        return 0.0 - math.radians(angle)

    @staticmethod
    def world_vector(psi: float, forward: float, left: float) -> tuple[float, float]:
        """A vector in the frame of a vehicle with yaw psi [rad], as x and y in CARLA's world."""
        c, s = math.cos(psi), math.sin(psi)
        return c * forward - s * left, 0.0 - (s * forward + c * left)

    @staticmethod
    def body_vector(psi: float, x: float, y: float) -> tuple[float, float]:
        """The inverse of :meth:`world_vector`: components forward and left."""
        c, s = math.cos(psi), math.sin(psi)
        return c * x - s * y, 0.0 - (s * x + c * y)


def unwrapped(angle: float, near: float) -> float:
    """The angle [rad] with whole turns added, so that it differs least from ``near``."""
    return near + math.remainder(angle - near, math.tau)


def a_step_before(pose: Pose, course: float, speed: float, yaw_rate: float, dt: float) -> Pose:
    """The pose of a vehicle in a steady turn, ``dt`` [s] earlier.

    ``course`` is the direction of its velocity at ``pose`` [rad]. The chord of the arc is as long
    as the arc times sin(x)/x of half the turned angle, in the direction of its middle.
    """
    half = 0.5 * yaw_rate * dt
    chord = speed * dt * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)  # noqa: PLR2004
    middle = course - half
    return Pose(
        pose.x - chord * math.cos(middle), pose.y - chord * math.sin(middle), pose.psi - 2.0 * half
    )
