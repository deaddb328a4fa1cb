"""What all lateral controllers of this package share: checked input, limited output."""

from __future__ import annotations

import math
import sysconfig
import time
import traceback
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path as FilePath
from typing import Any, ClassVar, final

import numpy as np
from pydantic import ValidationError

from steersman.config import Component
from steersman.controllers.plausible import usable
from steersman.errors import ConfigError, ControllerError, SteersmanError, one_line, shortened
from steersman.types import Decision, Observation, Status
from steersman.vehicles import Vehicle

_STATUSES = frozenset(Status)
_ANSWER = "decide has to return (steer, status, state): return steer, sm.Status.SOLVED, state"
# Steps without effect before the first: a disturbance estimate needs one before it computes.
_WARM_UPS = 3


class ControllerComponent(Component):
    """A lateral controller. Subclasses decide; this class guards input and output.

    ``search`` declares what ``steersman tune`` may change: lowest and highest value of a field
    (dotted for nested ones), and whether to search on a logarithmic scale.
    """

    family: ClassVar[str] = "controller"
    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {}
    gaps: ClassVar[bool] = False
    """Whether ``step`` also takes None, for an observation that did not arrive."""

    @abstractmethod
    def init(self, vehicle: Vehicle, dt: float) -> Any:
        """State before the first step.

        Args:
            vehicle: nominal parameters, for controllers that use a model.
            dt: control period [s].
        """

    def redesign(self, vehicle: Vehicle, dt: float) -> Any:
        """As :meth:`init`, for parameters that hold for some steps only.

        What not every step needs may be left for later; a controller whose ``init`` takes long
        overrides this.
        """
        return self.init(vehicle, dt)

    @abstractmethod
    def decide(self, state: Any, observation: Observation) -> tuple[float, Status, Any]:
        """Normalised steering (may exceed the limits), how it came about, and the new state."""

    def executed(self, state: Any, steer: float) -> Any:
        """The state after the last step, given the executed steering [normalised].

        To be called where a command other than the controller's own may have been executed:
        beside an agent, or under a correction. Controllers that remember their command override
        this; the last call counts, and ``state`` itself is not changed.
        """
        return state

    def speed_limit(self, state: Any) -> float:
        """The largest speed for the next control period [m/s], from the state after a decision.

        NaN: that which is wished. Controllers that drive slower than wished override this.
        """
        return math.nan

    def limits_speed(self) -> bool:
        """Whether it, or a controller in it, reads the wished speeds and allows less."""
        inner = (getattr(self, name) for name in type(self).model_fields)
        return any(isinstance(each, ControllerComponent) and each.limits_speed() for each in inner)

    def follows(self) -> bool:
        """Whether it, or a controller in it, reads the gap to a car ahead."""
        inner = (getattr(self, name) for name in type(self).model_fields)
        return any(isinstance(each, ControllerComponent) and each.follows() for each in inner)

    def step(self, state: Any, observation: Observation) -> tuple[Decision, Any]:
        """Decide the steering for the next control period, in [-1, 1].

        A heading error is taken modulo a whole turn. An observation that is not finite or that no
        car near its road can measure, and one of a car that drives backwards, gets the present
        steering, marked as a fallback, and leaves the state alone; so one outlier costs one step.
        So does a decision that is not finite. Only a :class:`Wrapper` overrides this.
        """
        seen = usable(observation)
        if seen is None:
            return present(observation)._replace(speed_limit=self.speed_limit(state)), state
        steer, status, after = self.decide(state, seen)
        if not math.isfinite(steer):
            return present(observation)._replace(speed_limit=self.speed_limit(state)), state
        if not -1.0 <= steer <= 1.0:
            steer = within_limits(steer)
            status = Status.SATURATED if status == Status.SOLVED else status
        return Decision(steer, status, speed_limit=self.speed_limit(after)), after


class Wrapper(ControllerComponent):
    """A controller around others: it gets every observation, and returns whole decisions."""

    @abstractmethod
    def step(self, state: Any, observation: Observation) -> tuple[Decision, Any]:
        """Decide the steering for the next control period, in [-1, 1]."""

    @final
    def decide(self, state: Any, observation: Observation) -> tuple[float, Status, Any]:
        """Steering and status of the decision, and the new state."""
        decision, after = self.step(state, observation)
        return decision.steer, decision.status, after


def present(observation: Observation) -> Decision:
    """The present steering, marked as a fallback."""
    held = observation.steer if math.isfinite(observation.steer) else 0.0
    return Decision(within_limits(held), Status.FALLBACK)


def within_limits(steer: float) -> float:
    """Steering clipped to [-1, 1]."""
    return min(max(steer, -1.0), 1.0)


def designed(
    controller: ControllerComponent, vehicle: Vehicle, dt: float, *, again: bool = False
) -> Any:
    """The memory of a controller before its first step, at ``dt`` [s].

    Args:
        controller: the controller.
        vehicle: nominal parameters.
        dt: control period [s].
        again: by ``redesign`` in place of ``init``.

    Raises:
        ConfigError: its equations have no solution for this vehicle and these settings, or it
            raised something else.
    """
    try:
        return controller.redesign(vehicle, dt) if again else controller.init(vehicle, dt)
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        what = f"{controller.kind} finds no solution for this vehicle and its settings ({error})"
        raise ConfigError(what, ("controller",)) from None
    except SteersmanError:
        raise
    except Exception as error:  # a user's controller may raise anything
        raise ConfigError(raised(controller, error), ("controller",)) from error


def _name(controller: ControllerComponent) -> str:
    return controller.kind or type(controller).__name__


def check_status(controller: ControllerComponent, decision: Decision) -> None:
    """Refuse a decision whose status is none.

    Raises:
        ControllerError: it is not.
    """
    if type(decision.status) is not Status and decision.status not in _STATUSES:
        given = shortened(repr(decision.status))
        raise ControllerError(f"controller {_name(controller)!r}: the status is {given}; {_ANSWER}")


def raised(controller: ControllerComponent, error: Exception) -> str:
    """What a controller raised, and on which line of its author's file."""
    frame = _authors(traceback.extract_tb(error.__traceback__))
    where = f"{FilePath(frame.filename).name}, line {frame.lineno}"
    what = f"raised {type(error).__name__}: {error}"
    if frame.filename == __file__:  # what decide returned was no answer
        return one_line(f"controller {_name(controller)!r}: {_ANSWER} ({error})")
    first = error.errors()[0] if isinstance(error, ValidationError) else None
    if first is not None and first["type"] == "frozen_instance":
        what = (
            f"sets self.{first['loc'][0]}, but one object drives many cars and is frozen:"
            " what changes from step to step belongs into the state, which init makes and decide"
            " returns"
        )
    return one_line(f"controller {_name(controller)!r} {what} ({where})")


def _authors(frames: Sequence[traceback.FrameSummary]) -> traceback.FrameSummary:
    """The innermost frame that is neither of this package nor of an installed one."""
    libraries = {sysconfig.get_path(name) for name in ("purelib", "platlib", "stdlib")}
    others = [str(FilePath(__file__).parents[1]), *libraries]
    own = [f for f in frames if not any(f.filename.startswith(place) for place in others)]
    return own[-1] if own else frames[-1]


def warm_up(
    controller: ControllerComponent, controller_state: Any, observation: Observation
) -> None:
    """Call the controller without effect, so that no measured time contains compilation.

    Several times, since some of it needs an earlier step. A controller that fails here will fail
    again at a step that counts.
    """
    with suppress(ControllerError):
        for _ in range(_WARM_UPS):
            _, controller_state, _ = timed_step(controller, controller_state, observation)


def timed_step(
    controller: ControllerComponent, controller_state: Any, observation: Observation
) -> tuple[Decision, Any, float]:
    """The controller's decision, its new state, and how long it took [s].

    Raises:
        ControllerError: it raised, or returned what no actuator can take.
        ConfigError: it does not fit into this loop.
    """
    begun = time.perf_counter()
    try:
        decision, controller_state = controller.step(controller_state, observation)
    except (ConfigError, ControllerError):
        raise
    except Exception as error:  # a user's controller may raise anything
        raise ControllerError(raised(controller, error)) from error
    took = time.perf_counter() - begun
    if not abs(decision.steer) <= 1.0:
        raise ControllerError(
            f"controller {_name(controller)!r} returned steering {decision.steer}, where a finite"
            " number in [-1, 1] is expected"
        )
    check_status(controller, decision)
    return decision, controller_state, took
