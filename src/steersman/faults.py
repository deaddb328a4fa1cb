"""Faults between sensor, controller and actuator: what a controller meets in a car that breaks.

Sensor and actuator break in the world (:class:`Faults`), so that every plant, controller and
training meets them alike. What breaks inside a controller breaks inside a supervisor's inner
controller (:class:`Dying`); an agent that learns has no such inside.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from steersman.config import Of, Settings, param, required
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.controllers.supervisor import Supervisor
from steersman.disturbances import Disturber
from steersman.kernels import world as kernel
from steersman.kernels.fleet import Fleet, World
from steersman.types import Decision, Observation, Status
from steersman.vehicles import Vehicle

Seed: TypeAlias = tuple[int, ...]
_Controller = Annotated[ControllerComponent, Of("controller")]

# What happens inside the controller, from a bend on for ever.
_INSIDE = ("raises", "answers_nan")


class Fault(Settings):
    """What breaks, when, and for how long.

    ``frozen``: all numbers of the observation stay what they were, its time goes on. ``dropped``:
    samples get lost, and the last one is there again. ``nan``: all numbers are NaN. ``saturated``:
    the actuator does not go beyond ``limit``. ``stuck``: it stays where it is. ``raises`` and
    ``answers_nan``: from the first bend after ``begin`` on, the controller does only that.
    """

    kind: Literal["frozen", "dropped", "nan", "saturated", "stuck", "raises", "answers_nan"] = (
        required("-", "What breaks.")
    )
    begin: float = param(5.0, "s", "When it happens first.", ge=0)
    length: float | None = param(None, "s", "How long it lasts; null: for good.", gt=0)
    every: float | None = param(None, "s", "Time from one to the next; null: but once.", gt=0)
    share: float = param(0.5, "-", "Share of samples that are dropped.", ge=0, le=1)
    limit: float = param(1.0, "-", "Largest steering of a saturated actuator.", ge=0, le=1)
    bend: float = param(0.01, "1/m", "Curvature from which on a road is a bend.", ge=0)

    def active(self, time: float) -> bool:
        """Whether it is there at that time of the run [s]."""
        since = time - self.begin + 1e-9
        if since < 0.0:
            return False
        if self.every is not None:
            since %= self.every
        return self.length is None or since < self.length

    def within(self, controller: ControllerComponent) -> ControllerComponent:
        """The controller with what breaks inside it, which is a supervisor's inner controller."""
        if self.kind not in _INSIDE:
            return controller
        if isinstance(controller, Supervisor):
            return controller.model_copy(
                update={"inner": Dying(inner=controller.inner, fault=self)}
            )
        return Dying(inner=controller, fault=self)

    def make(self, n: int, seed: int) -> Disturber | None:
        """What breaks in sensor and actuator at work on a world; None if that is nothing."""
        return None if self.kind in _INSIDE else Faults(self, seed)

    def arrives(self, time: float, dt: float, seed: Seed) -> int:
        """What arrives of the observation at a time [s]: ``kernels.world.MEASURED``, ..."""
        if not self.active(time):
            return kernel.MEASURED
        if self.kind == "nan":
            return kernel.NOTHING
        step = round(time / dt)
        if step and self.kind == "frozen":
            return kernel.FROZEN
        if step and self.kind == "dropped":
            drawn = np.random.default_rng([*seed, step]).random()
            return kernel.DROPPED if drawn < self.share else kernel.MEASURED
        return kernel.MEASURED


class Faults(Disturber):
    """A fault of sensor or actuator, in every vehicle at the same time of its drive."""

    def __init__(self, fault: Fault, seed: int) -> None:
        """``seed`` decides which samples are dropped."""
        self._fault, self._seed = fault, seed

    def act(self, world: World, fleet: Fleet, i: int, time: float) -> None:
        """Limit what the actuator takes."""
        fault = self._fault
        if fault.kind in ("saturated", "stuck") and fault.active(time):
            stuck = fault.kind == "stuck"
            limits = (fleet.sent[i], fleet.sent[i]) if stuck else (-fault.limit, fault.limit)
            fleet.bounds[i] = limits

    def sense(
        self, world: World, fleet: Fleet, i: int, time: float, rng: np.random.Generator
    ) -> None:
        """Lose what does not arrive; the first vehicle loses what a single one does."""
        seed = (self._seed, i) if i else (self._seed,)
        fleet.arrives[i] = self._fault.arrives(time, world.dt, seed)


class Dead(Exception):
    """What a dying controller raises."""


class DyingState(NamedTuple):
    """The controller's own state, and whether it is dead."""

    inner: Any
    dead: bool = False


class Dying(Wrapper):
    """A controller that breaks in a bend and stays broken, also when it is started anew."""

    family: ClassVar[str] = "controller"
    kind: ClassVar[str] = "dying"

    inner: _Controller = required("-", "Controller until then.")
    fault: Fault = required("-", "What happens then.")

    def init(self, vehicle: Vehicle, dt: float) -> DyingState:
        """State before the first step."""
        return DyingState(self.inner.init(vehicle, dt))

    def step(self, state: DyingState, observation: Observation) -> tuple[Decision, DyingState]:
        """The controller's decision, while it lives.

        Raises:
            Dead: it is dead.
        """
        active = self.fault.active(observation.time)
        if active and (state.dead or abs(observation.curvature) >= self.fault.bend):
            if self.fault.kind == "raises":
                raise Dead("division by zero")
            return _Nan().step(None, observation)[0], state._replace(dead=True)
        decision, inner = self.inner.step(state.inner, observation)
        return decision, state._replace(inner=inner)

    def executed(self, state: DyingState, steer: float) -> DyingState:
        """The controller gets the executed command."""
        return state._replace(inner=self.inner.executed(state.inner, steer))


class _Nan(ControllerComponent):
    """Every controller of this package answers like this one if it arrives at NaN."""

    def init(self, vehicle: Vehicle, dt: float) -> None:
        """Nothing to keep."""

    def decide(self, state: None, observation: Observation) -> tuple[float, Status, None]:
        """NaN, which ``step`` turns into the present steering, marked as a fallback."""
        return math.nan, Status.SOLVED, None
