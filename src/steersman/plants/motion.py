"""Motion of one vehicle with any period: for worlds of their own, like the stand-in server's."""

from __future__ import annotations

import math

import numpy as np

from steersman.kernels import vehicle as kernel
from steersman.kernels.steady_turn import steady_turn
from steersman.types import Command, Pose
from steersman.vehicles import LONGEST_STEP, Vehicle


class VehicleMotion:
    """The embedded simulator's vehicle model without a plant: no control period, no delay, no wind.

    Axes and signs are ISO 8855's: x forward, y left, angles positive to the left. It stands at
    the origin to begin with, everything centred.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        """``vehicle``: its parameters; they may be exchanged at any time."""
        self.vehicle = vehicle
        self._row = np.zeros(kernel.N_STATE)
        self._command = np.zeros(3)
        self._work = np.zeros((3, kernel.N_MOTION))

    @property
    def vehicle(self) -> Vehicle:
        """Parameters; the state stays as it is when they are exchanged."""
        return self._vehicle

    @vehicle.setter
    def vehicle(self, vehicle: Vehicle) -> None:
        self._vehicle, self._table = vehicle, vehicle.table

    def advance(self, command: Command, dt: float, steps: int = 1) -> None:
        """Hold ``command`` for ``dt`` [s].

        Args:
            command: steering, throttle and brake.
            dt: time [s], above 0.
            steps: least number of integration steps; there are more where these would be longer
                than the longest stable step.
        """
        count = max(steps, math.ceil(dt / LONGEST_STEP - 1e-9))
        self._command[:] = command
        kernel.advance(self._table, 0, self._row, self._command, dt / count, count, self._work)

    def steady_turn(self, speed: float, curvature: float) -> bool:
        """Put it into the steady turn at ``speed`` [m/s]; False where there is none."""
        return bool(steady_turn(self._table, 0, self._row, speed, curvature))

    def stop(self) -> None:
        """Set velocities and accelerations to zero; pose and actuators stay."""
        self._row[kernel.VX : kernel.LOAD_AY + 1] = 0.0
        self._row[[kernel.AX, kernel.AY]] = 0.0

    @property
    def pose(self) -> Pose:
        """Pose of the centre of mass."""
        return Pose(*self._row[: kernel.VX].tolist())

    @pose.setter
    def pose(self, pose: Pose) -> None:
        self._row[[kernel.X, kernel.Y, kernel.PSI]] = pose

    @property
    def velocity(self) -> tuple[float, float]:
        """Velocity of the centre of mass forward and to the left [m/s]."""
        return float(self._row[kernel.VX]), float(self._row[kernel.VY])

    @velocity.setter
    def velocity(self, velocity: tuple[float, float]) -> None:
        self._row[[kernel.VX, kernel.VY]] = velocity

    @property
    def yaw_rate(self) -> float:
        """Yaw rate, positive to the left [rad/s]."""
        return float(self._row[kernel.YAW_RATE])

    @yaw_rate.setter
    def yaw_rate(self, rate: float) -> None:
        self._row[kernel.YAW_RATE] = rate

    @property
    def acceleration(self) -> tuple[float, float]:
        """Acceleration of the centre of mass forward and to the left [m/s^2]."""
        return float(self._row[kernel.AX]), float(self._row[kernel.AY])

    def wheel_angles(self) -> tuple[float, float]:
        """Angles of the left and the right front wheel [rad]."""
        left, right, _ = kernel.wheel_tangents(
            self._table, 0, float(self._row[kernel.STEER]), abs(float(self._row[kernel.VX]))
        )
        return math.atan(left), math.atan(right)

    def rolled_over(self) -> bool:
        """Whether both inner wheels have lifted."""
        return bool(kernel.rolls_over(self._table.rows[0], float(self._row[kernel.LOAD_AY])))
