"""Bases of plants with equations of motion of their own.

Actuators (rates, lag), steering delay, integration, the steady turn at the start and the record of
what was measured are the embedded simulator's, for whatever equations of motion there are.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from steersman.config import param
from steersman.kernels import vehicle as car
from steersman.kernels.fleet import DELAY_LINE
from steersman.kernels.steady_turn import steady_turn
from steersman.kernels.vehicle import VehicleTable
from steersman.plants.base import ComputedComponent, ComputedPlant, PlantComponent
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import Vehicle

# Below this speed a steady turn is not searched for [m/s].
_CREEP = 1.0
# States of every plant: x, y, psi, v_x, v_y, yaw rate.
_PLANE = 6


class Motion(ABC):
    """Equations of motion.

    The state is x, y [m] and psi [rad] of the centre of mass, v_x and v_y [m/s] in the vehicle's
    frame (x forward, y left), the yaw rate [rad/s], and what the equations add. The actuators'
    positions are the normalised steering, left positive, throttle and brake.
    """

    more: int = 0
    """States beyond the six."""
    free: tuple[int, ...] = ()
    """Those of them that are unknown in a steady turn, beside side-slip, steering and pedals."""
    still: tuple[int, ...] = ()
    """As many states beyond the six whose derivatives vanish in a steady turn."""

    @abstractmethod
    def slope(self, table: VehicleTable, state: FloatArray, inputs: FloatArray) -> FloatArray:
        """Time derivative of the state (6 + more,).

        Args:
            table: figures of the vehicle that is driven, in the first row.
            state: the state.
            inputs: positions of the actuators (3,).
        """

    def advance(
        self,
        table: VehicleTable,
        state: FloatArray,
        inputs: FloatArray,
        command: FloatArray,
        h: float,
    ) -> None:
        """Move state and actuators for ``h`` [s] towards ``command`` (3,), in place.

        Here by the explicit midpoint rule, order 2.
        """
        middle = state + 0.5 * h * self.slope(table, state, inputs)
        car.move_inputs(table.rows[0], inputs, command, 0.5 * h)
        state += h * self.slope(table, middle, inputs)
        car.move_inputs(table.rows[0], inputs, command, 0.5 * h)

    def settle(self, table: VehicleTable, state: FloatArray, inputs: FloatArray) -> None:
        """Fill the states beyond the six for a car at rest in its springs that moves so."""
        state[_PLANE:] = 0.0

    def rolled_over(self, table: VehicleTable, state: FloatArray) -> bool:
        """Whether the vehicle has rolled over in that state; a planar one does not."""
        return False


class SteppedComponent(PlantComponent):
    """A plant that integrates equations of motion in steps that fill the control period."""

    integration_step: float = param(
        0.01, "s", "Longest integration step; a whole number of them fills the period.", gt=0
    )

    @abstractmethod
    def motion(self, vehicle: Vehicle) -> Motion:
        """The equations with the fields' figures, for a vehicle that is like that one."""

    @property
    def h(self) -> float:
        """Integration step [s]."""
        return whole_step(self.dt, self.integration_step)

    def make(self, vehicle: Vehicle) -> PhysicsPlant:
        """A plant that drives that vehicle."""
        return PhysicsPlant(self, self.motion(vehicle), vehicle)


class PhysicsComponent(SteppedComponent):
    """A plant whose subclasses declare their fields and their equations of motion."""

    cannot: ClassVar[frozenset[str]] = frozenset({"wind"})
    more: ClassVar[int] = 0
    """States beyond x, y [m], psi [rad], v_x, v_y [m/s] and yaw rate [rad/s]; they start at 0."""

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

    def motion(self, vehicle: Vehicle) -> Motion:
        """The equations that are declared, for that vehicle."""
        return _Derivative(self, vehicle)

    def delay_of(self, vehicle: Vehicle) -> int:
        """Steering delay in integration steps, the vehicle's own included."""
        return self.delay_substeps(vehicle.steer_delay)


class _Derivative(Motion):
    """The equations of a :class:`PhysicsComponent`, for the nominal vehicle."""

    def __init__(self, config: PhysicsComponent, vehicle: Vehicle) -> None:
        self._config, self._vehicle, self.more = config, vehicle, config.more

    def slope(self, table: VehicleTable, state: FloatArray, inputs: FloatArray) -> FloatArray:
        return self._config.derivative(self._vehicle, state, *inputs.tolist())

    def rolled_over(self, table: VehicleTable, state: FloatArray) -> bool:
        return self._config.rolled_over(self._vehicle, state)


class CompiledComponent(SteppedComponent, ComputedComponent):
    """A plant whose compiled equations read the figures of the vehicle at every step."""


def whole_step(dt: float, longest: float) -> float:
    """The largest step of at most ``longest`` that fills ``dt`` a whole number of times [s]."""
    return dt / math.ceil(dt / longest - 1e-9)


class PhysicsPlant(ComputedPlant):
    """The equations of a component at work; see :class:`steersman.protocols.Plant`."""

    def __init__(self, config: PlantComponent, motion: Motion, vehicle: Vehicle) -> None:
        """Prepare the plant; ``reset`` before the first step."""
        super().__init__(config, vehicle)
        self._motion = motion
        self._q = np.zeros(_PLANE + motion.more)
        self._inputs, self._command = np.zeros(3), np.zeros(3)
        self._delayed = np.zeros(DELAY_LINE * self._substeps)

    def reset(self, pose: Pose, speed: float, curvature: float) -> VehicleState:
        """Put the vehicle on ``pose`` in its steady turn, with its velocity along it."""
        self._steps = 0
        self._steady(speed, curvature)
        beta = float(np.arctan2(self._q[4], self._q[3])) if speed > 0.0 else 0.0
        self._q[:3] = pose.x, pose.y, pose.psi - beta
        self._delayed[:] = self._inputs[0]
        return self._read()

    def resume(self, state: VehicleState) -> None:
        """Put the vehicle back; no command is under way, and what the plant adds is at rest."""
        s = state
        self._q[:_PLANE] = s.x, s.y, s.psi, s.v_x, s.v_y, s.yaw_rate
        self._inputs[:] = s.steer, s.throttle, s.brake
        self._motion.settle(self.table, self._q, self._inputs)
        self._delayed[:] = s.steer

    def step(self, command: Command) -> VehicleState:
        """Hold ``command`` for one control period; steering acts after the delay."""
        self._command[:] = command
        moving = (self._q, self._inputs, self._command, self._h)
        for _ in range(self._substeps):
            self._delayed[1:] = self._delayed[:-1]
            self._delayed[0] = command.steer
            self._command[0] = self._delayed[self.delay]
            self._motion.advance(self.table, *moving)
        self._steps += 1
        return self._read()

    def _slope(self, q: FloatArray, inputs: FloatArray) -> FloatArray:
        return self._motion.slope(self.table, q, inputs)

    def _steady(self, speed: float, curvature: float) -> None:
        """Fill state and actuators with a steady turn, by Newton's method.

        The search begins at the embedded simulator's; where it fails, that is the answer.
        """
        row = np.zeros(car.N_STATE)
        steady_turn(self.table, 0, row, speed, curvature)
        free = list(self._motion.free)
        zero = [3, 4, 5, *self._motion.still]
        beta = float(np.arctan2(row[car.VY], row[car.VX])) if speed > 0.0 else 0.0
        first = [beta, row[car.STEER], row[car.THROTTLE] - row[car.BRAKE]]

        def place(unknown: FloatArray) -> None:
            beta, steer, pedal = unknown[:3].tolist()
            self._q[3:_PLANE] = speed * np.cos(beta), speed * np.sin(beta), speed * curvature
            self._inputs[:] = steer, max(pedal, 0.0), max(-pedal, 0.0)
            self._q[free] = unknown[3:]

        def left(unknown: FloatArray) -> FloatArray:
            place(unknown)
            return self._slope(self._q, self._inputs)[zero]

        self._q[:] = 0.0
        place(np.array([*first, *self._q[free]]))
        self._motion.settle(self.table, self._q, self._inputs)
        start = np.array([*first, *self._q[free]])
        unknown = start.copy()
        for _ in range(20 if speed > _CREEP else 0):
            rest = left(unknown)
            if np.abs(rest).max() < 1e-9:  # noqa: PLR2004 - of accelerations
                break
            slopes = [(left(unknown + 1e-6 * e) - rest) / 1e-6 for e in np.eye(len(unknown))]
            try:
                unknown -= np.clip(np.linalg.solve(np.array(slopes).T, rest), -0.2, 0.2)
            except np.linalg.LinAlgError:
                unknown = start
                break
        found = np.isfinite(unknown).all() and np.abs(unknown[:3]).max() <= 1.0
        place(unknown if found else start)

    def rolled_over(self) -> bool:
        """Whether the vehicle has rolled over."""
        return self._motion.rolled_over(self.table, self._q)

    def _read(self) -> VehicleState:
        """The state now; accelerations are those that the equations give there."""
        slope = self._slope(self._q, self._inputs)
        x, y, psi, v_x, v_y, rate = self._q[:_PLANE].tolist()
        steer, throttle, brake = self._inputs.tolist()
        a_x, a_y = float(slope[3]) - v_y * rate, float(slope[4]) + v_x * rate
        wheel = math.atan(car.wheel_tangents(self.table, 0, steer, abs(v_x))[2])
        time = self._steps * self.dt
        return VehicleState(
            time, x, y, psi, v_x, v_y, rate, a_x, a_y, steer, wheel, throttle, brake
        )
