"""A controller under a supervisor: the command of every step is checked against rules."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from steersman.controllers.base import ControllerComponent
from steersman.errors import ConfigError
from steersman.types import Observation, Reason, Status

# Limits are exceeded by more than rounding.
_ROUNDING = 1e-9


class Rules(NamedTuple):
    """Limits of a candidate's commands."""

    dt: float
    """Control period [s]."""
    step: float
    """Largest change of the command in a period [-]."""
    hasty_time: float
    """How long commands may change faster than that [s]."""
    deadline: float | None
    """Longest computing time of a step [s]; None: not checked."""


class Candidate(NamedTuple):
    """A controller's state and last command, and the record of its faults."""

    state: Any
    fresh: Any
    """Its state before the first step."""
    steer: float | None = None
    """Its last command [normalised]; None if it gave none."""
    status: Status = Status.SOLVED
    fault: Reason = Reason.NONE
    healthy: float = math.inf
    """Time since its last fault [s]."""
    hasty: float = 0.0
    """Time for which its commands have changed too fast [s]."""
    speed_limit: float = math.nan
    """The largest speed of its last decision [m/s]; NaN: that which is wished."""

    def failed(self, fault: Reason, *, restart: bool = False) -> Candidate:
        """The same after a fault; ``restart`` if its state may be damaged."""
        if restart:
            return Candidate(
                self.fresh, self.fresh, fault=fault, healthy=0.0, speed_limit=self.speed_limit
            )
        return self._replace(fault=fault, healthy=0.0)


def checked_step(
    controller: ControllerComponent,
    before: Candidate,
    observation: Observation,
    last: float,
    rules: Rules,
    clock: Callable[[], float],
    *,
    first: bool,
) -> Candidate:
    """Compute a command and check it.

    Args:
        controller: the controller.
        before: its record until now.
        observation: a usable observation.
        last: the steering executed last [normalised].
        rules: limits of its commands.
        clock: the time [s]; read only where there is a deadline.
        first: whether this is the first step.

    Raises:
        ConfigError: at the first step, if the controller does not fit into this loop.
    """
    own = observation._replace(preview=observation.preview.copy())  # it may write into it
    begun = clock() if rules.deadline is not None else 0.0
    try:
        decision, state = controller.step(before.state, own)
        steer: Any = decision.steer  # of another package's controller it may be anything
        status: Any = decision.status
        speed: Any = decision.speed_limit
    except Exception as error:  # of any kind: a failing controller must not end the supervisor
        if first and isinstance(error, ConfigError):
            raise
        return before.failed(Reason.EXCEPTION, restart=True)
    took = clock() - begun if rules.deadline is not None else 0.0
    if not _is_number(steer):
        return before.failed(Reason.COMMAND, restart=True)
    after = _judged(before, float(steer), last, rules)
    after = after._replace(state=state, status=_status(status))
    after = after._replace(speed_limit=float(speed) if _is_number(speed) else math.nan)
    fault = _fault(after, took, rules)
    if fault is not Reason.NONE:
        return after.failed(fault)
    return after._replace(fault=fault, healthy=after.healthy + rules.dt)


def executed(controller: ControllerComponent, candidate: Candidate, steer: float) -> Candidate:
    """The candidate after ``steer`` [normalised] was executed."""
    try:
        return candidate._replace(state=controller.executed(candidate.state, steer))
    except Exception:  # noqa: BLE001 - as above
        return candidate.failed(Reason.EXCEPTION, restart=True)


def _is_number(value: Any) -> bool:
    """Whether it is a finite number; booleans, texts and lists are none."""
    if isinstance(value, bool):
        return False
    return isinstance(value, int | float | np.number) and math.isfinite(value)


def _status(status: Any) -> Status:
    """The status; an unknown one counts as a fallback."""
    try:
        return Status(status)
    except ValueError:
        return Status.FALLBACK


def _judged(before: Candidate, steer: float, last: float, rules: Rules) -> Candidate:
    """The candidate with this command."""
    own = last if before.steer is None else before.steer
    # After another controller steered, some continue from its command and some from their own.
    change = min(abs(steer - own), abs(steer - last))
    hasty = before.hasty + rules.dt if change > rules.step + _ROUNDING else 0.0
    return before._replace(steer=steer, hasty=hasty)


def _fault(candidate: Candidate, took: float, rules: Rules) -> Reason:
    assert candidate.steer is not None
    if rules.deadline is not None and took > rules.deadline:
        return Reason.DEADLINE
    if abs(candidate.steer) > 1.0 + _ROUNDING:
        return Reason.COMMAND_LIMIT
    if candidate.status is Status.FALLBACK:
        return Reason.UNSOLVED
    return Reason.COMMAND_RATE if candidate.hasty > rules.hasty_time else Reason.NONE
