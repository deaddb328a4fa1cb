"""The embedded simulator: one vehicle, stepped by the kernel that the environments use too."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from steersman.config import param, register
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.kernels.fleet import DELAY_LINE
from steersman.kernels.steady_turn import steady_turn
from steersman.plants.base import ComputedComponent, ComputedPlant
from steersman.sensing import state_row, to_state
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import Vehicle

_NOT_KEPT = np.zeros((0, 2))


@register("plant", "simulator")
class SimulatorConfig(ComputedComponent):
    """The embedded planar four-wheel simulator."""

    embedded: ClassVar[bool] = True

    dt: float = param(
        0.05, "s", "Control period; a whole multiple of the integration step.", gt=0, le=2
    )
    steering_delay: float = param(
        0.0, "s", "Time until a steering command acts; rounded to whole integration steps.", ge=0
    )
    record: bool = param(
        False, "-", "Keep the accelerations of every integration step in the episode."
    )

    def source(self) -> str:
        """The simulator is part of the package."""
        return "embedded simulator"

    def recorded(self) -> SimulatorConfig:
        """The same, keeping accelerations."""
        return self.model_copy(update={"record": True})

    def make(self, vehicle: Vehicle) -> Simulator:
        """A simulator of that vehicle alone, in calm air; a world steps the kernels itself."""
        return Simulator(self, vehicle)


class Simulator(ComputedPlant):
    """A plant with one vehicle; see :class:`steersman.protocols.Plant`."""

    def __init__(self, config: SimulatorConfig, vehicle: Vehicle) -> None:
        """Prepare the simulator; ``reset`` before the first step."""
        super().__init__(config, vehicle)
        self._state = np.zeros(car.N_STATE)
        self._delayed = np.zeros(DELAY_LINE)
        self._work = np.zeros((3, car.N_MOTION))

    def reset(self, pose: Pose, speed: float, curvature: float) -> VehicleState:
        """Put the vehicle on ``pose`` in the steady turn; its velocity points along ``pose.psi``.

        Args:
            pose: position of the centre of mass and direction of its velocity (the course).
            speed: magnitude of the velocity [m/s].
            curvature: curvature of the turn [1/m].
        """
        place(self.table, 0, self._state, self._delayed, pose, speed, curvature)
        self._steps = 0
        return self._read()

    def resume(self, state: VehicleState) -> None:
        """Put the vehicle back; loads follow the accelerations, and no command is under way."""
        self._state[:] = state_row(state)
        self._state[[car.LOAD_AX, car.LOAD_AY]] = state.a_x, state.a_y
        self._delayed[:] = state.steer

    def step(self, command: Command) -> VehicleState:
        """Hold ``command`` for one control period."""
        kernel.drive(
            self.table,
            0,
            self._state,
            np.array(command, dtype=np.float64),
            self._delayed,
            self.delay,
            self._h,
            self._substeps,
            self._work,
            _NOT_KEPT,
        )
        self._steps += 1
        return self._read()

    def rolled_over(self) -> bool:
        """Whether both inner wheels have lifted."""
        return car.rolls_over(self.table.rows[0], self._state[car.LOAD_AY])

    def _read(self) -> VehicleState:
        return to_state(self._state, self._steps * self.dt)


def place(
    table: car.VehicleTable,
    n: int,
    state: FloatArray,
    delayed: FloatArray,
    pose: Pose,
    speed: float,
    curvature: float,
) -> None:
    """Fill a state row with the steady turn on ``pose``, and the delay line with its steering."""
    steady_turn(table, n, state, speed, curvature)
    slip = float(np.arctan2(state[car.VY], state[car.VX])) if speed > 0.0 else 0.0
    state[car.X], state[car.Y], state[car.PSI] = pose.x, pose.y, pose.psi - slip
    delayed[:] = state[car.STEER]
