"""A controller outside: a program that reads observations and writes steering, line by line."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from steersman.config import param, register, required
from steersman.controllers.base import ControllerComponent
from steersman.controllers.exchange import Question, to_json
from steersman.controllers.outside import OutsideProgram, running
from steersman.errors import shortened
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle


class ProcessState(NamedTuple):
    """The program, and which drive it is asked about."""

    program: OutsideProgram
    dt: float
    drive: int | None = None
    executed: float | None = None
    """The steering executed last; None: nothing yet, or the program's own."""


@register("controller", "process")
class Process(ControllerComponent):
    """A program outside, in any language: a person at a game pad, a language model, other code.

    It reads a line of JSON from its standard input for each step and writes one to its standard
    output, ``{"steer": 0.1}`` in [-1, 1], left positive, without keeping it in a buffer; or
    ``{"steer": null}``, which holds the present steering, and demonstrates nothing. The line
    has all that a controller gets, with the number of the ``drive`` (several may be under way),
    the control period ``dt`` [s] and the steering that was ``executed`` in the step before. At
    the end of its input it has to end. A configuration that names it runs the program; ``python``
    is the interpreter that runs Steersman.
    """

    command: tuple[str, ...] = required("-", "Program and its arguments.", min_length=1)
    timeout: float = param(10.0, "s", "Longest time for an answer, the first included.", gt=0)

    def init(self, vehicle: Vehicle, dt: float) -> ProcessState:
        """Start the program, unless it runs already.

        Raises:
            ConfigError: it cannot be started.
        """
        return ProcessState(running(self.command, self.timeout), dt)

    def decide(
        self, state: ProcessState, observation: Observation
    ) -> tuple[float, Status, ProcessState]:
        """Ask the program.

        Raises:
            ControllerError: it gives no steering.
        """
        program, drive = state.program, state.drive
        if drive is None:
            drive = program.drives
        program.drives = max(program.drives, drive + 1)
        question = Question(observation, drive, None, state.dt, state.executed)
        answer = program.ask(to_json(question))
        steer: Any = answer.get("steer", "") if isinstance(answer, dict) else ""
        after = state._replace(drive=drive, executed=None)
        if steer is None:
            return observation.steer, Status.ABSENT, after
        if type(steer) not in {int, float} or not math.isfinite(steer):
            program.fail(
                f'answered {shortened(str(answer))!r}; a line like {{"steer": 0.1}} is expected, '
                "in [-1, 1], left positive"
            )
        return float(steer), Status.SOLVED, after

    def executed(self, state: ProcessState, steer: float) -> ProcessState:
        """The executed command is a part of the next question."""
        return state._replace(executed=steer)
