"""A process that has imported what workers need and forks them: a start takes milliseconds.

Imports take seconds of processor time, which each worker would spend anew. The server imports once
for each ``sys.path`` and number of threads, keeps to one thread, draws no random numbers, and ends
with the process that started it. Each worker is the child of a copy of the server that waits for
it alone and reports how it ended.
"""

from __future__ import annotations

import atexit
import json
import os
import select
import signal
import socket
import subprocess
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from typing import IO, Any

AVAILABLE = sys.platform == "linux"
"""Elsewhere libraries of the system cannot be counted on after a fork."""

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]);"
    "from steersman.engine.fork_server import serve_forks; serve_forks()"
)
# The longest order: a path, an environment, names of modules.
_LONGEST = 1 << 20
_servers: dict[tuple[str, ...], _Server] = {}


class Forked:
    """A worker, with as much of the interface of ``subprocess.Popen`` as its owner needs."""

    def __init__(self, threads: dict[str, str], needs: Sequence[str], errors: IO[bytes]) -> None:
        """Start it.

        Args:
            threads: settings of the environment that libraries read when they are imported.
            needs: modules to import before the fork; one that fails is left to the worker.
            errors: the file that gets what the worker writes to its standard error.
        """
        takes, self._gives = os.pipe()
        gets, sends = os.pipe()
        self._reports, status = os.pipe()
        fds = (takes, sends, errors.fileno(), status)
        try:
            _server(threads).order(threads, needs, fds)
        finally:
            for fd in (takes, sends, status):
                os.close(fd)
        self.stdin, self.stdout = os.fdopen(self._gives, "wb"), os.fdopen(gets, "rb")
        self.returncode: int | None = None
        self.pid = int(self._line() or 0)

    def _line(self) -> bytes:
        line = b""
        while not line.endswith(b"\n") and (part := os.read(self._reports, 1)):
            line += part
        return line

    def kill(self) -> None:
        """End it at once; nothing happens if it has ended."""
        if self.pid and not select.select([self._reports], [], [], 0.0)[0]:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code, or minus the signal that ended it.

        Raises:
            subprocess.TimeoutExpired: it goes on after ``timeout`` [s].
        """
        if self.returncode is None:
            if not select.select([self._reports], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired("a worker", timeout or 0.0)
            self.returncode = int(self._line() or -signal.SIGKILL)
            os.close(self._reports)
        return self.returncode


class _Server:
    """The server, as its owner sees it."""

    def __init__(self, path: Sequence[str], threads: dict[str, str]) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _START, json.dumps(path)],
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                env={**os.environ, **threads},
            )

    def order(self, threads: dict[str, str], needs: Sequence[str], fds: Sequence[int]) -> None:
        """Have a worker forked that has these file descriptors."""
        order = {"cwd": os.getcwd(), "env": {**os.environ, **threads}, "needs": needs}
        socket.send_fds(self._socket, [json.dumps(order).encode()], fds)

    def runs(self) -> bool:
        """Whether it has not ended."""
        return self._process.poll() is None

    def close(self) -> None:
        """End it; workers go on."""
        self._socket.close()
        self._process.kill()
        self._process.wait()


def _server(threads: dict[str, str]) -> _Server:
    key = (*sys.path, *threads.values())
    if key in _servers and not _servers[key].runs():
        _servers.pop(key).close()
    if key not in _servers:
        _servers[key] = _Server(sys.path, threads)
        atexit.register(_servers[key].close)
    return _servers[key]


def serve_forks() -> None:
    """The main function of a server: orders come from the socket that is its standard input."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the owner, which decides
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # copies end by themselves
    orders = socket.socket(fileno=os.dup(0))
    while True:
        text, fds, _, _ = socket.recv_fds(orders, _LONGEST, 4)
        if not text:
            return
        order = json.loads(text)
        for name in order["needs"]:
            with suppress(Exception):
                import_module(name)
        if os.fork() == 0:
            orders.close()
            _watch(order, fds)
        for fd in fds:
            os.close(fd)


def _watch(order: dict[str, Any], fds: Sequence[int]) -> None:
    """Fork the worker; report its process id, and in the end its exit code."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    status = fds[3]
    worker = os.fork()
    if worker == 0:
        os.close(status)
        _work(order, fds)
    for fd in (0, *fds[:3]):
        os.close(fd)
    with suppress(OSError):  # the owner has ended
        os.write(status, b"%d\n" % worker)
    _, ended = os.waitpid(worker, 0)
    with suppress(OSError):
        os.write(status, b"%d\n" % os.waitstatus_to_exitcode(ended))
    os._exit(0)


def _work(order: dict[str, Any], fds: Sequence[int]) -> None:
    """Become the worker."""
    from steersman.engine.work import serve

    for fd, to in zip(fds[:3], range(3), strict=True):
        os.dup2(fd, to)
        os.close(fd)
    os.environ.clear()
    os.environ.update(order["env"])
    try:
        os.chdir(order["cwd"])
        serve()
    except BaseException:  # noqa: BLE001 - whatever it is, the copy of the server ends here
        traceback.print_exc()
    os._exit(1)
