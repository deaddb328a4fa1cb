"""A stand-in in its own process, for tests with the real client."""

from __future__ import annotations

import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

COMMAND = (sys.executable, "-c", "from steersman.cli import main; main()", "carla", "serve")
# How long a server may take until it listens, kernels included, and until it has stopped [s].
STARTS_IN = 120.0
STOPS_IN = 20.0


class Serving:
    """A running ``steersman carla serve``."""

    def __init__(self, *options: str) -> None:
        """Start it on ports that the system chooses, and wait until it listens."""
        self.process = subprocess.Popen(
            [*COMMAND, "--port", "0", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        begun = time.monotonic()
        ready, _, _ = select.select([self.process.stdout], [], [], STARTS_IN)
        assert ready, f"nothing on stdout within {time.monotonic() - begun:.0f} s"
        self.greeting = self.process.stdout.readline()
        ports = re.search(r":(\d+), streams on (\d+)", self.greeting)
        if ports is None:
            self.process.kill()
            raise AssertionError(self.greeting + self.process.communicate()[1])
        self.port, self.stream_port = int(ports[1]), int(ports[2])

    def stop(self, number: int = signal.SIGINT) -> tuple[int, str, str]:
        """End it by that signal: exit code, what was left on stdout, all of stderr."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            out, error = self.process.communicate(timeout=STOPS_IN)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        return self.process.returncode, out, error


@contextmanager
def serving(*options: str) -> Iterator[Serving]:
    """A server for the duration of a ``with``."""
    server = Serving(*options)
    try:
        yield server
    finally:
        if server.process.poll() is None:
            server.stop()
