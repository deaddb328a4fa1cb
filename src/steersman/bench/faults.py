"""Faults between sensor, controller and actuator: what a controller meets in a car that breaks.

They happen around the controller, so that every plant, sensor and controller can meet them. What
breaks inside a controller breaks inside a supervisor, too.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np

from steersman.config import Of, Settings, param, required
from steersman.controllers.base import ControllerComponent, Wrapper
from steersman.controllers.supervisor import Supervisor
from steersman.types import Decision, Observation, Status
from steersman.vehicles import Vehicle

_Controller = Annotated[ControllerComponent, Of("controller")]

# What happens inside the controller, from a corner on for ever.
_DEATHS = ("raises", "answers_nan")


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

    def around(self, controller: ControllerComponent, seed: int) -> ControllerComponent:
        """The controller with this fault; a supervisor has it inside if it is one of its inner."""
        if self.kind not in _DEATHS:
            return Faulty(inner=controller, fault=self, seed=seed)
        if isinstance(controller, Supervisor):
            return controller.model_copy(
                update={"inner": Dying(inner=controller.inner, fault=self)}
            )
        return Dying(inner=controller, fault=self)


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

    inner: _Controller = required("-", "Who drives until then.")
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
        """The controller is told."""
        return state._replace(inner=self.inner.executed(state.inner, steer))


class _Nan(ControllerComponent):
    """Every controller of this package answers like this one if it arrives at NaN."""

    def init(self, vehicle: Vehicle, dt: float) -> None:
        """Nothing to keep."""

    def decide(self, state: None, observation: Observation) -> tuple[float, Status, None]:
        """NaN, which ``step`` turns into the present steering, marked as a fallback."""
        return math.nan, Status.SOLVED, None


class FaultyState(NamedTuple):
    """The controller's own state, and what it and the actuator got last."""

    inner: Any
    dt: float
    seen: Observation | None = None
    steer: float = 0.0


class Faulty(Wrapper):
    """A controller that sees and steers through what is broken."""

    family: ClassVar[str] = "controller"
    kind: ClassVar[str] = "faulty"

    inner: _Controller = required("-", "Who drives.")
    fault: Fault = required("-", "What is broken.")
    seed: int = param(0, "-", "Of which samples are dropped.", ge=0)

    def init(self, vehicle: Vehicle, dt: float) -> FaultyState:
        """State before the first step."""
        return FaultyState(self.inner.init(vehicle, dt), dt)

    def step(self, state: FaultyState, observation: Observation) -> tuple[Decision, FaultyState]:
        """What arrives at the actuator; the controller is not told."""
        active = self.fault.active(observation.time)
        seen = self._sensed(state, observation) if active else observation
        decision, inner = self.inner.step(state.inner, seen)
        steer = self._acted(state, decision.steer) if active else decision.steer
        return decision._replace(steer=steer), FaultyState(inner, state.dt, _kept(seen), steer)

    def executed(self, state: FaultyState, steer: float) -> FaultyState:
        """The controller is told of others, not of its actuator."""
        return state._replace(inner=self.inner.executed(state.inner, steer))

    def _sensed(self, state: FaultyState, o: Observation) -> Observation:
        kind, last = self.fault.kind, state.seen
        if kind == "nan":
            nothing = dict.fromkeys(Observation._fields[1:8], math.nan)
            return o._replace(**nothing, preview=np.full_like(o.preview, math.nan))
        if last is None:
            return o
        if kind == "frozen":
            return last._replace(time=o.time)
        if kind == "dropped" and self._drawn(round(o.time / state.dt)) < self.fault.share:
            return last
        return o

    def _acted(self, state: FaultyState, steer: float) -> float:
        if self.fault.kind == "stuck":
            return state.steer
        most = self.fault.limit if self.fault.kind == "saturated" else 1.0
        return min(max(steer, -most), most)

    def _drawn(self, step: int) -> float:
        return float(np.random.default_rng([self.seed, step]).random())


def _kept(o: Observation) -> Observation:
    return o._replace(preview=o.preview.copy())
