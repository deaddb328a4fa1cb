"""What moves the vehicles that learn: the kernels all of them at once, or a plant one of them.

Everything else of a step (what the action means, pedals, tracking, reward, features) is the same
compiled code in both cases, so that a policy may be trained on whatever plant there is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from steersman.errors import ConfigError
from steersman.kernels import step as kernel
from steersman.kernels import vehicle as car
from steersman.kernels.step import Fleet, World
from steersman.learning.problem import Problem
from steersman.plants.simulator import place
from steersman.protocols import Plant
from steersman.types import Command, FloatArray, Pose, VehicleState
from steersman.vehicles import Vehicle

# A load at which any car has rolled over [m/s^2].
_ROLLED = 1e9


class Mover(Protocol):
    """Puts the vehicles of a fleet at their starts, and moves them."""

    vehicle: Vehicle
    """The nominal vehicle, as far as it is known."""
    shared: Shared | None
    """The plant, if there is one, for others to drive it in turns."""

    def begin(
        self, world: World, fleet: Fleet, i: int, pose: Pose, speed: float, curvature: float
    ) -> None:
        """Put vehicle ``i`` on ``pose`` in the steady turn; ``fleet.path`` says on which road."""
        ...

    def step(self, world: World, fleet: Fleet, actions: FloatArray, shifts: FloatArray) -> None:
        """One control step of all vehicles, as :func:`steersman.kernels.step.step` has it."""
        ...

    def lose(self) -> None:
        """The fleet's state was replaced: the vehicles have to be put there before a step."""
        ...

    def close(self) -> None:
        """Release whatever is held; may be called twice."""
        ...


@dataclass
class Shared:
    """A plant, and who drives it at the moment."""

    plant: Plant
    driver: Seat | None = None


def make_mover(problem: Problem, n: int, shared: Shared | None = None) -> Mover:
    """The kernels, or a plant: ``shared`` if it is given, else the problem's own.

    Raises:
        ConfigError: ``n`` vehicles are wanted of a plant that drives one.
        PlantError: the plant cannot be reached.
    """
    if shared is None and problem.plant.embedded:
        return Kernels(problem.vehicle)
    if n != 1:
        raise ConfigError(
            f"plant={problem.plant.kind} drives one vehicle, {n} are wanted; set agent.vehicles=1"
        )
    ours = shared is None
    shared = shared or Shared(problem.plant.make(problem.vehicle))
    try:
        return Seat(problem, shared)
    except BaseException:  # a Ctrl-C too: nobody else could close it
        if ours:
            shared.plant.close()
        raise


class Kernels:
    """The embedded simulator: all vehicles in one call."""

    shared: Shared | None = None

    def __init__(self, vehicle: Vehicle) -> None:
        """Of that nominal vehicle; ``world.vehicles`` has each one's own."""
        self.vehicle = vehicle

    def begin(
        self, world: World, fleet: Fleet, i: int, pose: Pose, speed: float, curvature: float
    ) -> None:
        """Fill the vehicle's row."""
        place(world.vehicles, i, fleet.state[i], fleet.delayed[i], pose, speed, curvature)

    def step(self, world: World, fleet: Fleet, actions: FloatArray, shifts: FloatArray) -> None:
        """One call of the kernel."""
        kernel.step(world, fleet, actions, shifts)

    def lose(self) -> None:
        """They are where the fleet has them."""

    def close(self) -> None:
        """Nothing to release."""


class Seat:
    """A seat in a plant's vehicle, which several take in turns.

    Training and validation drive the same one: who did not drive last puts it back first.
    """

    def __init__(self, problem: Problem, shared: Shared) -> None:
        """Enter the first road, so that whatever is missing is told before anything is learned."""
        self.shared: Shared | None = shared
        self._shared = shared
        self._plant = shared.plant
        self._roads = problem.roads
        if shared.driver is None:
            at = self._roads[0].at(0.0)
            self._plant.enter(self._roads[0])
            self._plant.reset(Pose(at.x, at.y, at.psi), 0.0, 0.0)
            shared.driver = self
        self.vehicle: Vehicle = self._plant.vehicle

    def begin(
        self, world: World, fleet: Fleet, i: int, pose: Pose, speed: float, curvature: float
    ) -> None:
        """Enter the road and start there."""
        self._shared.driver = self
        self._plant.enter(self._roads[int(fleet.path[i])])
        self._plant.delay = int(fleet.delay[i])
        self._write(fleet, self._plant.reset(pose, speed, curvature))

    def step(self, world: World, fleet: Fleet, actions: FloatArray, shifts: FloatArray) -> None:
        """The kernel's step, but for who moves the car."""
        if self._shared.driver is not self:
            self._return(world, fleet)
        steer = kernel.decide(world, fleet, 0, float(actions[0]), fleet.command)
        near = kernel.expected_place(world, fleet, 0)
        self._write(fleet, self._plant.step(Command(*fleet.command.tolist())))
        kernel.conclude(world, fleet, 0, steer, near, shifts[0])

    def _return(self, world: World, fleet: Fleet) -> None:
        """Put the vehicle where the fleet has it."""
        self._shared.driver = self
        self._plant.enter(self._roads[int(fleet.path[0])])
        self._plant.delay = int(fleet.delay[0])
        row = dict(zip(_COLUMNS, fleet.state[0, list(_COLUMNS.values())].tolist(), strict=True))
        self._plant.resume(VehicleState(time=0.0, **row))

    def _write(self, fleet: Fleet, state: VehicleState) -> None:
        row = fleet.state[0]
        for name, column in _COLUMNS.items():
            row[column] = getattr(state, name)
        row[car.LOAD_AX], row[car.LOAD_AY] = 0.0, _ROLLED * self._plant.rolled_over()

    def lose(self) -> None:
        """Nobody drives: the next step begins with putting the vehicle back."""
        self._shared.driver = None

    def close(self) -> None:
        """Release the plant, for all who share it."""
        self._plant.close()


# Where a state row has what a plant tells.
_COLUMNS = {
    "x": car.X,
    "y": car.Y,
    "psi": car.PSI,
    "v_x": car.VX,
    "v_y": car.VY,
    "yaw_rate": car.YAW_RATE,
    "a_x": car.AX,
    "a_y": car.AY,
    "steer": car.STEER,
    "wheel_angle": car.WHEEL,
    "throttle": car.THROTTLE,
    "brake": car.BRAKE,
}
