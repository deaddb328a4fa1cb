"""A stand-in in its own process, for tests with the real client."""

from __future__ import annotations

import re
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

COMMAND = (sys.executable, "-c", "from steersman.cli import main; main()", "carla", "serve")
# How long a server may take until it listens, kernels included, and until it has stopped [s].
STARTS_IN = 120.0
STOPS_IN = 20.0
# What a client waits for an answer [s]; generous, since machines are busy.
PATIENCE = 20.0
DT = 0.05
MODEL3 = "vehicle.tesla.model3"
# A lane of 4 m, right of a straight line that starts at (5, 6) m with a heading of 0.5 rad.
ROAD = """<?xml version="1.0"?>
<OpenDRIVE><header revMajor="1" revMinor="4"/>
<road name="" length="80.0" id="7" junction="-1"><planView>
<geometry s="0.0" x="5.0" y="6.0" hdg="0.5" length="80.0"><line/></geometry></planView>
<lanes><laneSection s="0.0"><center><lane id="0" type="none"/></center><right>
<lane id="-1" type="driving"><width sOffset="0.0" a="4.0" b="0" c="0" d="0"/></lane>
</right></laneSection></lanes></road></OpenDRIVE>"""


class Serving:
    """A running ``steersman carla serve``."""

    def __init__(self, *options: str) -> None:
        """Start it on ports that the system chooses, and wait until it listens."""
        # A pipe could fill up; `stop` closes this.
        self._faults = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115
        self.process = subprocess.Popen(
            [*COMMAND, "--port", "0", *options],
            stdout=subprocess.PIPE,
            stderr=self._faults,
            text=True,
        )
        assert self.process.stdout is not None
        begun = time.monotonic()
        ready, _, _ = select.select([self.process.stdout], [], [], STARTS_IN)
        assert ready, f"nothing on stdout within {time.monotonic() - begun:.0f} s"
        self.greeting = self.process.stdout.readline()
        ports = re.search(r":(\d+), streams on (\d+)", self.greeting)
        if ports is None:
            _, _, faults = self.stop(signal.SIGTERM)
            raise AssertionError(self.greeting + faults)
        self.port, self.stream_port = int(ports[1]), int(ports[2])

    def stop(self, number: int = signal.SIGINT) -> tuple[int, str, str]:
        """End it by that signal: exit code, what was left on stdout, all of stderr."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            out, _ = self.process.communicate(timeout=STOPS_IN)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        self._faults.seek(0)
        faults = self._faults.read()
        self._faults.close()
        return self.process.returncode, out, faults


@contextmanager
def serving(*options: str) -> Iterator[Serving]:
    """A server for the duration of a ``with``."""
    server = Serving(*options)
    try:
        yield server
    finally:
        if server.process.poll() is None:
            server.stop()


def connect(server: Serving, patience: float = PATIENCE) -> Any:
    """A client of a server; the test is skipped where there is no wheel."""
    carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")
    client = carla.Client("127.0.0.1", server.port)
    client.set_timeout(patience)
    return client


_ELSEWHERE = """import sys, carla
client = carla.Client("127.0.0.1", int(sys.argv[1]))
client.set_timeout(60.0)
text = sys.stdin.read()
client.generate_opendrive_world(text) if text else client.load_world("StandInStraight")
"""


def another_world(server: Serving, map_text: str = "") -> None:
    """Another episode, on an OpenDRIVE map or on the straight road, asked for by another process.

    The client dies of another episode now and then, where it is the one that asks for it: it ends
    the old one's threads while they run. The server has gone on by then.
    """
    words = [sys.executable, "-c", _ELSEWHERE, str(server.port)]
    subprocess.run(
        words, input=map_text, text=True, check=False, capture_output=True, timeout=120.0
    )


def synchronous(world: Any, dt: float = DT, substep: float = 0.01, most: int = 10) -> Any:
    """Switch a world to synchronous mode."""
    settings = world.get_settings()
    settings.synchronous_mode = True
    settings.fixed_delta_seconds = dt
    settings.substepping = True
    settings.max_substep_delta_time, settings.max_substeps = substep, most
    world.apply_settings(settings)
    return world


def at(x: float, y: float = 0.0, yaw: float = 0.0, z: float = 0.0) -> Any:
    """A transform of the client's."""
    import carla

    return carla.Transform(carla.Location(x=x, y=y, z=z), carla.Rotation(yaw=yaw))


def spawn(world: Any, x: float = 10.0, y: float = -20.0, yaw: float = 0.0) -> Any:
    """A Model 3, there from the next tick on."""
    return world.spawn_actor(world.get_blueprint_library().find(MODEL3), at(x, y, yaw, 0.5))
