"""Motion of one vehicle with any period: for worlds of their own, like the stand-in server's."""

from __future__ import annotations

import math

import numpy as np

from steersman.kernels import vehicle as kernel
from steersman.kernels.actuator import slew
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
        self._backwards = 0.0  # position of the pedal that the reverse gear takes

    @property
    def vehicle(self) -> Vehicle:
        """Parameters; the state stays as it is when they are exchanged."""
        return self._vehicle

    @vehicle.setter
    def vehicle(self, vehicle: Vehicle) -> None:
        self._vehicle, self._table = vehicle, vehicle.table

    def advance(self, command: Command, dt: float, steps: int = 1, reverse: bool = False) -> None:
        """Hold ``command`` for ``dt`` [s].

        In reverse, a throttle accelerates backwards by what the map gives for it beyond an idle
        one at the same speed, at most by what the tyres' friction allows; the axles' loads and the
        tyres' sideways grip do not feel that force.

        Args:
            command: steering, throttle and brake.
            dt: time [s], above 0.
            steps: least number of integration steps; there are more where these would be longer
                than the longest stable step.
            reverse: whether the reverse gear is engaged.
        """
        count = max(steps, math.ceil(dt / LONGEST_STEP - 1e-9))
        wanted = command.throttle if reverse else 0.0
        self._command[:] = command
        if not wanted and not self._backwards:
            kernel.advance(self._table, 0, self._row, self._command, dt / count, count, self._work)
            return
        if reverse:
            self._command[kernel.CMD_THROTTLE] = 0.0
        self._reverse(wanted, dt / count, count)

    def _reverse(self, wanted: float, h: float, steps: int) -> None:
        """Steps of ``h`` [s] in which the pedal of the reverse gear moves to ``wanted``."""
        row, state, back = self._table.rows[0], self._row, 0.0
        for _ in range(steps):
            self._backwards = slew(
                self._backwards, wanted, row[kernel.PEDAL_UP], row[kernel.PEDAL_DOWN], h
            )
            speed = min(abs(state[kernel.VX]), self._table.map_speed[-1])
            driven, idle = (
                kernel.map_acceleration(self._table, pedal, speed)
                for pedal in (self._backwards, 0.0)
            )
            back = min(max(driven - idle, 0.0), row[kernel.MU] * kernel.GRAVITY)
            state[kernel.VX] -= h * back
            kernel.advance(self._table, 0, state, self._command, h, 1, self._work)
        state[kernel.AX] -= back

    def steady_turn(self, speed: float, curvature: float) -> bool:
        """Put it into the steady turn at ``speed`` [m/s]; False where there is none."""
        return bool(steady_turn(self._table, 0, self._row, speed, curvature))

    def stop(self) -> None:
        """Set velocities and accelerations to zero; pose and actuators stay."""
        self._backwards = 0.0
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
