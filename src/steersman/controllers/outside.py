"""A program outside that answers lines: started once, asked many times, ended with its users."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Mapping
from contextlib import suppress
from typing import IO, Any, NoReturn

from steersman.bounds import from_json
from steersman.errors import ConfigError, ControllerError, one_line, shortened

# The longest line that is read [characters], and how long a program has to end by itself [s].
_LONGEST, _PATIENCE = 10_000, 1.0
# Characters of a command that an error shows.
_SHOWN = 200


def running(command: tuple[str, ...], timeout: float) -> OutsideProgram:
    """The program of a command, one for this whole process; started if it does not run.

    Raises:
        ConfigError: it cannot be started.
    """
    found = _RUNNING.get((command, timeout))
    if found is None or not found.end.alive:
        found = _RUNNING[command, timeout] = OutsideProgram(command, timeout)
    return found


class OutsideProgram:
    """A running program; it gets a line of JSON for each question and answers with one.

    It ends when nothing refers to this object any more, or with the interpreter: the end of its
    input comes first, which also comes if the interpreter is killed.
    """

    def __init__(self, command: tuple[str, ...], timeout: float) -> None:
        """Start it.

        Raises:
            ConfigError: it cannot be started.
        """
        self._command, self._timeout = command, timeout
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the program
        try:
            self._process = subprocess.Popen(
                [sys.executable if command[0] == "python" else command[0], *command[1:]],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                encoding="utf-8",
                errors="replace",
            )
        except OSError as error:
            self._errors.close()
            why = error.strerror or str(error)
            raise ConfigError(f"{command[0]!r} cannot be started ({why})", ("command",)) from None
        assert self._process.stdout is not None
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        listening = self._process.stdout, self._answers
        threading.Thread(target=_listen, args=listening, daemon=True).start()
        self.end = weakref.finalize(self, _end, self._process, self._errors)
        self._fault = ""
        self.drives = 0
        """Drives that it has been asked about."""

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy is the same program; elsewhere it is started there."""
        return running, (self._command, self._timeout)

    def ask(self, question: Mapping[str, Any]) -> Any:
        """The program's answer to a line, plain data.

        Raises:
            ControllerError: it ended, gave no answer in time, or one that is not JSON. The program
                is ended, as a late answer would be taken for the next one's, and every later
                question gets the same error.
        """
        if self.end.alive:
            try:
                return self._answer(json.dumps(question) + "\n")
            except queue.Empty:
                self.fail(f"gave no answer within timeout: {self._timeout:g} s")
        raise ControllerError(self._fault)

    def _answer(self, line: str) -> Any:
        assert self._process.stdin is not None
        with suppress(OSError):  # it ended, which the missing answer says
            self._process.stdin.write(line)
            self._process.stdin.flush()
        answer = self._answers.get(timeout=self._timeout)
        if not answer:
            self.fail(f"ended{self._why()}")
        try:
            return from_json(answer)
        except ValueError:
            self.fail(f"answered {shortened(answer.strip())!r}, which is no line of JSON")

    def fail(self, what: str) -> NoReturn:
        """End the program, since it did something that it must not.

        Raises:
            ControllerError: always; ``what`` it did.
        """
        self.end()
        self._fault = f"the program {shortened(' '.join(self._command), _SHOWN)!r} {what}"
        raise ControllerError(self._fault)

    def _why(self) -> str:
        """Exit code and last line of its errors."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_PATIENCE)
        self._errors.seek(0)
        said = self._errors.read().decode("utf-8", "replace").strip().rpartition("\n")[2]
        return f" with exit code {self._process.returncode}" + (f": {one_line(said)}" * bool(said))


_RUNNING: weakref.WeakValueDictionary[tuple[tuple[str, ...], float], OutsideProgram] = (
    weakref.WeakValueDictionary()
)


def _listen(stdout: IO[str], answers: queue.SimpleQueue[str]) -> None:
    """Hand over lines; an empty one is the last."""
    with stdout, suppress(OSError, ValueError):
        while line := stdout.readline(_LONGEST):
            answers.put(line)
    answers.put("")


def _end(process: subprocess.Popen[str], errors: IO[bytes]) -> None:
    """Close its input, and kill it if that does not end it."""
    with suppress(OSError):
        assert process.stdin is not None
        process.stdin.close()
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    errors.close()
