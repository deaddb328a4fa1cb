"""A vehicle of the stand-in: the embedded simulator's car, told and read in CARLA's terms."""

from __future__ import annotations

import math

import numpy as np

from steersman.kernels import vehicle as kernel
from steersman.standin.axes import Transform, mass_centre_of, origin_of, rate_rad, to_body, to_world
from steersman.types import Command
from steersman.vehicles import LONGEST_STEP, Vehicle

# Wheels as CARLA counts them.
FRONT_LEFT, FRONT_RIGHT, BACK_LEFT, BACK_RIGHT = range(4)


class Car:
    """State of one vehicle; ``offset`` is how far its centre of mass is ahead of the origin [m]."""

    def __init__(self, vehicle: Vehicle, offset: float) -> None:
        """At rest on the origin, with everything centred."""
        self.vehicle = vehicle
        self.offset = offset
        self.command = Command(0.0, 0.0, 0.0)
        self.moves = True
        self.state = np.zeros(kernel.N_STATE)
        self.yaw_acceleration = 0.0
        """Mean over the last tick [rad/s^2]."""
        self._table = vehicle.table
        self._command = np.zeros(3)
        self._work = np.zeros((3, kernel.N_MOTION))

    def fit(self, vehicle: Vehicle, offset: float) -> None:
        """Go on with other parameters; the origin stays where it is."""
        where = self.transform
        self.vehicle, self.offset, self._table = vehicle, offset, vehicle.table
        self._stand_on(where)

    def advance(self, dt: float, substeps: int) -> None:
        """Hold the command for ``dt`` [s], in that many steps or more, none beyond the stable."""
        if not self.moves or dt <= 0.0:
            self.yaw_acceleration = 0.0
            return
        state = self.state
        before = float(state[kernel.YAW_RATE])
        count = max(substeps, math.ceil(dt / LONGEST_STEP - 1e-9))
        self._command[:] = self.command
        kernel.advance(self._table, 0, state, self._command, dt / count, count, self._work)
        self.yaw_acceleration = (float(state[kernel.YAW_RATE]) - before) / dt

    @property
    def transform(self) -> Transform:
        """Pose of the actor's origin."""
        x, y, psi = self.state[: kernel.VX].tolist()
        return origin_of(x, y, psi, self.offset)

    @transform.setter
    def transform(self, where: Transform) -> None:
        """Teleport: the velocity over ground stays as it is, whatever the new heading."""
        x, y = self.velocity
        self._stand_on(where)
        self.velocity = (x, y)

    def _stand_on(self, where: Transform) -> None:
        self.state[[kernel.X, kernel.Y, kernel.PSI]] = mass_centre_of(where, self.offset)

    @property
    def velocity(self) -> tuple[float, float]:
        """Velocity of the centre of mass in CARLA's world [m/s]."""
        _, _, psi, v_x, v_y = self.state[: kernel.YAW_RATE].tolist()
        return to_world(psi, v_x, v_y)

    @velocity.setter
    def velocity(self, value: tuple[float, float]) -> None:
        psi = float(self.state[kernel.PSI])
        self.state[[kernel.VX, kernel.VY]] = to_body(psi, *value)

    def turn_at(self, rate: float) -> None:
        """Set CARLA's yaw rate [deg/s]."""
        self.state[kernel.YAW_RATE] = rate_rad(rate)

    def freeze(self, frozen: bool) -> None:
        """Stop taking part in the physics, standing, or take part again."""
        self.moves = not frozen
        if frozen:
            self.state[kernel.VX : kernel.LOAD_AY + 1] = 0.0
            self.state[[kernel.AX, kernel.AY]] = 0.0

    def wheel_angle(self, wheel: int) -> float:
        """Angle of one wheel, right-positive [deg]."""
        if wheel not in {FRONT_LEFT, FRONT_RIGHT}:
            return 0.0
        tangents = kernel.wheel_tangents(
            self._table, 0, float(self.state[kernel.STEER]), abs(float(self.state[kernel.VX]))
        )
        return 0.0 - math.degrees(math.atan(tangents[wheel]))

    def rolled_over(self) -> bool:
        """Whether both inner wheels have lifted."""
        return bool(kernel.rolls_over(self._table.rows[0], float(self.state[kernel.LOAD_AY])))


def warm_up() -> None:
    """Compile, or load, what a car needs: nobody should wait for it in a call."""
    car = Car(Vehicle(), 0.0)
    car.advance(LONGEST_STEP, 1)
    car.wheel_angle(FRONT_LEFT)
    car.rolled_over()
