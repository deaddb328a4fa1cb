"""Worker processes on this machine.

A worker imports modules from where its parent does, and from nowhere else: Python starts with
``-P``, which keeps the working directory out of ``sys.path``, and then takes over the parent's.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeAlias

from steersman.engine import fork_server
from steersman.engine.work import Listener, Outcome, Piece
from steersman.errors import one_line

# Every library that might start its own threads for linear algebra.
_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.stdin.buffer.readline());"
    "from steersman.engine.work import serve; serve()"
)
# Time for a process to end, also on an overloaded machine [s].
_PATIENCE = 60.0
_Messages: TypeAlias = "SimpleQueue[tuple[_Worker, Any]]"


class LocalProcesses:
    """Up to ``at_once`` processes; with ``apart`` each piece has a process of its own."""

    def __init__(self, at_once: int, *, apart: bool, threads: int, needs: Sequence[str]) -> None:
        """No process starts before there is work for it."""
        self.at_once, self._apart = at_once, apart
        self._threads, self._needs = threads, needs
        self._idle: list[_Worker] = []
        self._busy: dict[_Worker, Piece] = {}
        self._messages: _Messages = SimpleQueue()

    def outcomes(self, pieces: Sequence[Piece], listener: Listener) -> Iterator[list[Outcome]]:
        """The outcomes of each piece, in the order in which they end."""
        waiting = list(reversed(pieces))
        try:
            while waiting or self._busy:
                while waiting and len(self._busy) < self.at_once:
                    worker = self._idle.pop() if self._idle else self._started()
                    self._busy[worker] = waiting.pop()
                    worker.send(self._busy[worker].data)
                worker, message = self._messages.get()
                if worker not in self._busy:  # one that was killed
                    continue
                if message is None:
                    yield self._busy.pop(worker).lost(worker.fault())
                elif message[0] is not None:
                    listener(*message)
                else:
                    del self._busy[worker]
                    if self._apart:
                        worker.close()
                    else:
                        self._idle.append(worker)
                    yield message[1]
        finally:
            self._end(self._busy)
            self._busy.clear()

    def close(self) -> None:
        """End all processes."""
        self._end(self._idle)
        self._idle.clear()

    def _started(self) -> _Worker:
        return _Worker(self._threads, self._needs, self._messages)

    def _end(self, workers: Any) -> None:
        for worker in workers:
            worker.process.kill()
        for worker in workers:
            worker.close()


class _Worker:
    """A process, and the thread that receives its messages; None is the last of them."""

    def __init__(self, threads: int, needs: Sequence[str], messages: _Messages) -> None:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        settings = dict.fromkeys(_THREADS, str(threads))
        self.process: fork_server.Forked | subprocess.Popen[bytes]
        if fork_server.AVAILABLE:
            self.process = fork_server.Forked(settings, needs, self._errors)
        else:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | settings,
            )
            self._write(json.dumps(sys.path).encode() + b"\n")
        self._listener = threading.Thread(target=self._listen, args=(messages,), daemon=True)
        self._listener.start()

    def send(self, data: bytes) -> None:
        """Hand over a piece."""
        self._write(pickle.dumps(data))

    def _write(self, data: bytes) -> None:
        assert self.process.stdin is not None
        with suppress(BrokenPipeError):  # the process ended, which its last message says
            self.process.stdin.write(data)
            self.process.stdin.flush()

    def _listen(self, messages: _Messages) -> None:
        assert self.process.stdout is not None
        with suppress(EOFError, pickle.UnpicklingError, ValueError, OSError):  # cut by its end
            while True:
                messages.put((self, pickle.load(self.process.stdout)))
        messages.put((self, None))

    def close(self) -> tuple[int, str]:
        """Let the process end; its exit code, and what it wrote to its standard error."""
        stdin, stdout = self.process.stdin, self.process.stdout
        assert stdin is not None
        assert stdout is not None
        with suppress(OSError):
            stdin.close()
        try:
            code = self.process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self._listener.join(_PATIENCE)
        stdout.close()
        with self._errors as errors:
            errors.seek(0)
            return code, errors.read().decode("utf-8", "replace").strip()

    def fault(self) -> str:
        """Signal, last line of its errors, or exit code of a process that ended before its work."""
        code, text = self.close()
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return one_line(text.rpartition("\n")[2]) or f"exit code {code}"
