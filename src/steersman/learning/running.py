"""A running training in its folder: how far it is, and what it is asked to do.

It writes ``state.json`` about twice a second and looks for the file ``request`` beside it, which
holds the word ``pause`` or ``stop``; without that file it goes on. :mod:`steersman.live` shows the
one and writes the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from steersman.errors import DataError, TrainingStopped, one_line
from steersman.files import write_text

STATE, REQUEST = "state.json", "request"
DRIVE = "validation.npz"
"""The worst drive of the newest validation, an episode."""
PERIOD = 0.5
"""Between two looks [s]."""
Request = Literal["pause", "stop"]


class TrainingState(BaseModel):
    """How far a training is."""

    model_config = ConfigDict(frozen=True)

    state: Literal["running", "paused", "stopped", "failed", "ended"]
    steps: int
    """Environment steps done."""
    total: int
    """Environment steps of the whole training."""
    alarms: tuple[str, ...] = ()
    """What the last validation gave reason to doubt."""
    why: str = ""
    """Why it failed or was stopped."""


def read_state(folder: FilePath) -> TrainingState | None:
    """The state of the training in a folder; None where none is recorded.

    Raises:
        DataError: the record is malformed.
    """
    try:
        text = (folder / STATE).read_bytes()
    except OSError:
        return None
    try:
        return TrainingState.model_validate_json(text)
    except ValidationError:
        raise DataError(f"{folder / STATE}: is not the state of a training") from None


def ask(folder: FilePath, request: Request | None) -> None:
    """Ask the training in a folder to pause or to stop; None: to go on.

    Raises:
        DataError: the folder cannot be written.
    """
    if request is None:
        (folder / REQUEST).unlink(missing_ok=True)
    else:
        write_text(folder / REQUEST, request)


class RunningTraining:
    """What a training tells and is asked, in its folder."""

    def __init__(
        self, folder: FilePath, steps: int, total: int, tick: Callable[[int], None] | None
    ) -> None:
        """Begin, at ``steps`` of ``total`` environment steps; earlier requests are void."""
        self._folder, self._total, self._tick = folder, total, tick
        self._steps, self._next = steps, 0.0
        self.alarms: tuple[str, ...] = ()
        ask(folder, None)
        self.tell("running")

    def look(self, steps: int) -> None:
        """Tell how far it is, in the folder and to ``tick``, if that is due."""
        self._steps = steps
        if time.monotonic() >= self._next:
            self.tell("running")
            if self._tick is not None:
                self._tick(steps)

    def tell(
        self, state: Literal["running", "paused", "stopped", "failed", "ended"], why: str = ""
    ) -> None:
        """Write the state now."""
        self._next = time.monotonic() + PERIOD
        told = TrainingState(
            state=state, steps=self._steps, total=self._total, alarms=self.alarms, why=why
        )
        write_text(self._folder / STATE, told.model_dump_json())

    def stops(self, steps: int) -> bool:
        """Whether it is to stop now; returns only when a pause is over."""
        self._steps = steps
        while (asked := self._asked()) == "pause":
            self.tell("paused")
            time.sleep(PERIOD)
        return asked == "stop"

    def _asked(self) -> str:
        try:
            return (self._folder / REQUEST).read_text(encoding="utf-8")
        except OSError:
            return ""


@contextmanager
def told(
    folder: FilePath, steps: int, total: int, tick: Callable[[int], None] | None = None
) -> Iterator[RunningTraining]:
    """A training in a folder, whose end is recorded too, however it comes."""
    running = RunningTraining(folder, steps, total, tick)
    try:
        yield running
    except (TrainingStopped, KeyboardInterrupt) as stopped:
        running.tell("stopped", str(stopped) or "interrupted")
        raise
    except Exception as error:
        running.tell("failed", one_line(str(error)) or type(error).__name__)
        raise
    running.tell("ended")
