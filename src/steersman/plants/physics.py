"""Base of plants of one's own: the physics is one method, everything else of a plant is here.

Actuators (rates, lag), steering delay, integration, the steady turn at the start and the record of
what was measured are the embedded simulator's, for whatever equations of motion there are.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from steersman.config import param
from steersman.kernels import vehicle as car
from steersman.kernels.actuator import slew, slew_lagged
from steersman.kernels.fleet import DELAY_LINE
from steersman.kernels.steady_turn import steady_turn
from steersman.plants.base import ComputedPlant, PlantComponent
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import Vehicle

# Below this speed a steady turn is not searched for [m/s].
_CREEP = 1.0


class PhysicsComponent(PlantComponent):
    """A plant whose subclasses declare their fields and their equations of motion."""

    cannot: ClassVar[frozenset[str]] = frozenset({"wind"})
    more: ClassVar[int] = 0
    """States beyond x, y [m], psi [rad], v_x, v_y [m/s] and yaw rate [rad/s]; they start at 0."""

    integration_step: float = param(0.01, "s", "Integration step.", gt=0)

    @abstractmethod
    def derivative(
        self, vehicle: Vehicle, state: FloatArray, steer: float, throttle: float, brake: float
    ) -> FloatArray:
        """Time derivative of the state (6 + more,).

        Args:
            vehicle: the figures of the vehicle that is driven.
            state: x, y [m] and psi [rad] of the centre of mass, v_x and v_y [m/s] in the
                vehicle's frame, yaw rate [rad/s], and what the plant adds; x forward, y left.
            steer: actual normalised steering, left positive, in [-1, 1];
                :meth:`Vehicle.wheel_angle` gives the angle of the front wheels.
            throttle: actual throttle, in [0, 1].
            brake: actual brake, in [0, 1].
        """

    def rolled_over(self, vehicle: Vehicle, state: FloatArray) -> bool:
        """Whether the vehicle has rolled over in that state; a planar one does not."""
        return False

    @property
    def h(self) -> float:
        """Integration step [s]."""
        return self.integration_step

    def make(self, vehicle: Vehicle) -> PhysicsPlant:
        """A plant that drives that vehicle."""
        return PhysicsPlant(self, vehicle)

    def delay_of(self, vehicle: Vehicle) -> int:
        """Steering delay in integration steps, the vehicle's own included."""
        return self.delay_substeps(vehicle.steer_delay)


class PhysicsPlant(ComputedPlant):
    """The equations of a component at work; see :class:`steersman.protocols.Plant`."""

    def __init__(self, config: PhysicsComponent, vehicle: Vehicle) -> None:
        """Prepare the plant; ``reset`` before the first step."""
        super().__init__(config, vehicle)
        self._config = config
        self._q = np.zeros(6 + config.more)
        self._inputs = np.zeros(3)
        self._acceleration = np.zeros(2)
        self._delayed = np.zeros(DELAY_LINE * self._substeps)

    def reset(self, pose: Pose, speed: float, curvature: float) -> VehicleState:
        """Put the vehicle on ``pose`` in its steady turn, with its velocity along it."""
        self._steps = 0
        self._q[:] = 0.0
        beta, steer, drive = self._steady(speed, curvature)
        self._q[:6] = (
            *(pose.x, pose.y, pose.psi - beta),
            *(speed * np.cos(beta), speed * np.sin(beta), speed * curvature),
        )
        self._inputs[:] = steer, max(drive, 0.0), max(-drive, 0.0)
        self._delayed[:] = steer
        self._slope(self._q, self._inputs)
        return self._read()

    def resume(self, state: VehicleState) -> None:
        """Put the vehicle back; no command is under way, and what the plant adds starts at 0."""
        s = state
        self._q[:] = 0.0
        self._q[:6] = s.x, s.y, s.psi, s.v_x, s.v_y, s.yaw_rate
        self._inputs[:] = s.steer, s.throttle, s.brake
        self._delayed[:] = s.steer

    def step(self, command: Command) -> VehicleState:
        """Hold ``command`` for one control period; steering acts after the delay."""
        h = self._h
        for _ in range(self._substeps):
            self._delayed[1:] = self._delayed[:-1]
            self._delayed[0] = command.steer
            steer = float(self._delayed[self.delay])
            middle = self._q + 0.5 * h * self._slope(self._q, self._inputs)
            self._move(steer, command, 0.5 * h)
            self._q += h * self._slope(middle, self._inputs)
            self._move(steer, command, 0.5 * h)
        self._steps += 1
        return self._read()

    def _move(self, steer: float, command: Command, h: float) -> None:
        """Move the actuators for a time [s]."""
        v, now = self.vehicle, self._inputs.tolist()
        pedal = (v.pedal_rate_up, v.pedal_rate_down, h)
        self._inputs[:] = (
            slew_lagged(now[0], steer, v.steer_rate_up, v.steer_rate_down, v.steer_lag, h),
            slew(now[1], command.throttle, *pedal),
            slew(now[2], command.brake, *pedal),
        )

    def _slope(self, q: FloatArray, inputs: FloatArray) -> FloatArray:
        out = self._config.derivative(self.vehicle, q, *inputs.tolist())
        self._acceleration[:] = out[3] - q[4] * q[5], out[4] + q[3] * q[5]
        return out

    def _steady(self, speed: float, curvature: float) -> tuple[float, float, float]:
        """Side-slip [rad], steering and pedals (brake negative) of a steady turn, by Newton.

        The search begins at the embedded simulator's; where it fails, that is the answer.
        """
        row = np.zeros(car.N_STATE)
        steady_turn(self.vehicle.table, 0, row, speed, curvature)
        beta = float(np.arctan2(row[car.VY], row[car.VX])) if speed > 0.0 else 0.0
        start = np.array([beta, row[car.STEER], row[car.THROTTLE] - row[car.BRAKE]])

        def left(unknown: FloatArray) -> FloatArray:
            q = np.zeros_like(self._q)
            q[3:6] = speed * np.cos(unknown[0]), speed * np.sin(unknown[0]), speed * curvature
            pedal = float(unknown[2])
            inputs = np.array([unknown[1], max(pedal, 0.0), max(-pedal, 0.0)])
            return self._slope(q, inputs)[3:6]

        unknown = start.copy()
        for _ in range(20 if speed > _CREEP else 0):
            rest = left(unknown)
            if np.abs(rest).max() < 1e-9:  # noqa: PLR2004 - of accelerations
                break
            slopes = [(left(unknown + 1e-6 * e) - rest) / 1e-6 for e in np.eye(3)]
            try:
                unknown -= np.clip(np.linalg.solve(np.array(slopes).T, rest), -0.2, 0.2)
            except np.linalg.LinAlgError:
                return tuple(start.tolist())
        found = unknown if np.abs(unknown).max() <= 1.0 else start
        return tuple(found.tolist())

    def rolled_over(self) -> bool:
        """Whether the vehicle has rolled over."""
        return self._config.rolled_over(self.vehicle, self._q)

    def _read(self) -> VehicleState:
        x, y, psi, v_x, v_y, rate = self._q[:6].tolist()
        steer, throttle, brake = self._inputs.tolist()
        a_x, a_y = self._acceleration.tolist()
        wheel = self.vehicle.wheel_angle(steer, abs(v_x))
        time = self._steps * self.dt
        return VehicleState(
            time, x, y, psi, v_x, v_y, rate, a_x, a_y, steer, wheel, throttle, brake
        )
