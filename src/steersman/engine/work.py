"""Jobs, and what a worker process does with them."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from queue import SimpleQueue
from typing import Any, NamedTuple, TypeAlias

from steersman.errors import SteersmanError

# A function (payload, tell) -> result; what it gives to ``tell`` reaches the caller at once.
Tell: TypeAlias = Callable[[Any], None]
Work: TypeAlias = Callable[[Any, Tell], Any]
# The same with the job's key in front.
Listener: TypeAlias = Callable[[str, Any], None]

# Exit code of a worker whose parent has ended or has closed the worker's input.
_CLOSED = 130


class Job(NamedTuple):
    """One unit of work."""

    key: str
    """Unique among the jobs; results are found by it, also in a journal."""
    payload: Any
    """Input of the work: data that can be pickled."""
    size: float = 1.0
    """Estimated length in any unit, the same for all jobs."""


class Outcome(NamedTuple):
    """The result or the error of a job."""

    key: str
    result: Any = None
    error: Exception | None = None


class WorkerDied(SteersmanError, RuntimeError):
    """The process of a job ended before the job did."""


class Piece(NamedTuple):
    """Several jobs that one worker does one after the other, pickled with their work."""

    keys: tuple[str, ...]
    data: bytes

    def lost(self, why: str) -> list[Outcome]:
        """The outcomes of its jobs if its worker ended."""
        return [Outcome(key, error=WorkerDied(why)) for key in self.keys]


def packed(work: Work, jobs: Sequence[Job]) -> Piece:
    """A piece of work; classes and functions of a script or a notebook travel by value."""
    import cloudpickle

    plain = [(job.key, job.payload) for job in jobs]
    return Piece(tuple(job.key for job in jobs), cloudpickle.dumps((work, plain)))


def perform(data: bytes, listener: Listener) -> list[Outcome]:
    """Do the jobs of a piece up to the first that fails."""
    work, jobs = pickle.loads(data)
    outcomes: list[Outcome] = []
    for key, payload in jobs:
        try:
            outcomes.append(Outcome(key, work(payload, partial(listener, key))))
        except Exception as error:  # noqa: BLE001 - the caller gets it
            outcomes.append(Outcome(key, error=_portable(error)))
            break
    return outcomes


def _portable(error: Exception) -> Exception:
    """The error, or one like it that can be pickled; a traceback is added as a note."""
    text = "".join(traceback.format_exception(error))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # noqa: BLE001 - whatever its own reduction raises
        known = isinstance(error, SteersmanError)
        error = SteersmanError(str(error)) if known else RuntimeError(repr(error))
    if not isinstance(error, SteersmanError):
        error.add_note(text)
    return error


def serve() -> None:
    """The main function of a local worker: pieces come from stdin, messages go to stdout.

    A message is ``(key, event)``, or ``(None, outcomes)`` at the end of a piece. The process ends
    when its input does: with the process that started it, however that ended.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent, which decides
    # Whatever else is printed must not mix with the messages.
    channel = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    pieces: SimpleQueue[bytes] = SimpleQueue()
    lock = threading.Lock()

    def receive() -> None:
        try:
            while True:
                pieces.put(pickle.load(sys.stdin.buffer))
        finally:
            os._exit(_CLOSED)

    def send(key: str | None, content: Any) -> None:
        with lock:
            channel.write(pickle.dumps((key, content)))
            channel.flush()

    threading.Thread(target=receive, daemon=True).start()
    while True:
        send(None, perform(pieces.get(), send))
