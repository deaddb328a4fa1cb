"""The two ports of the stand-in: calls on one, streams on the other; one event loop, one world."""

from __future__ import annotations

import asyncio
import errno
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path as FilePath

import steersman as sm
from carla_standin import actor_calls, lights, traffic  # noqa: F401 - they enter their calls
from carla_standin.calls import Dispatcher
from carla_standin.car import warm_up
from carla_standin.catalogue import VehicleBlueprint, default_models
from carla_standin.connections import CallConnection, Sessions, StreamConnection
from carla_standin.maps import MapLibrary
from carla_standin.streams import Streams
from carla_standin.world import StandinWorld

HOST = "127.0.0.1"
PORT = 2000
# Longest pause of the loop that asynchronous mode makes up for, and longest sleep of its clock [s].
_CATCH_UP, _NAP = 0.2, 0.02


class PortTaken(sm.SteersmanError, OSError):
    """The port cannot be opened."""


class StandinServer:
    """A stand-in on two open ports; ``async with`` opens and closes it."""

    def __init__(
        self,
        host: str = HOST,
        port: int = PORT,
        vehicles: dict[str, VehicleBlueprint] | None = None,
        maps: FilePath | None = None,
    ) -> None:
        """Prepare; ``port`` 0 lets the system choose both ports, else streams are on the next."""
        self.host = host
        self.port = port
        self.stream_port = port + 1 if port else 0
        self.world = StandinWorld(vehicles or default_models())
        self._atlas = MapLibrary(maps)
        self.streams = Streams()
        self._sessions = Sessions(self.streams)
        self._open: list[asyncio.Server] = []
        self._clock: asyncio.Task[None] | None = None

    async def __aenter__(self) -> StandinServer:
        """Open the ports.

        Raises:
            PortTaken: one is taken, or may not be opened.
        """
        self.stream_port = await self._listen(
            lambda: StreamConnection(self._sessions), self.stream_port
        )
        calls = Dispatcher(self.world, self._atlas, self.stream_port, self.streams)
        try:
            self.port = await self._listen(lambda: CallConnection(self._sessions, calls), self.port)
        except PortTaken:
            await self.__aexit__()
            raise
        self._clock = asyncio.create_task(self._run(calls))
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the ports and every connection."""
        if self._clock is not None:
            self._clock.cancel()
            await asyncio.gather(self._clock, return_exceptions=True)
        for server in self._open:
            server.close()
        self._sessions.end()
        for server in self._open:
            await server.wait_closed()

    async def until(self, stop: asyncio.Event) -> None:
        """Serve until ``stop``; a fault in the clock of asynchronous mode ends it before."""
        assert self._clock is not None
        stopped = asyncio.create_task(stop.wait())
        await asyncio.wait({stopped, self._clock}, return_when=asyncio.FIRST_COMPLETED)
        if self._clock.done():
            self._clock.result()
        stopped.cancel()

    async def _listen(self, factory: Callable[[], asyncio.Protocol], port: int) -> int:
        loop = asyncio.get_running_loop()
        try:
            server = await loop.create_server(factory, self.host, port)
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            taken = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
            raise PortTaken(
                f"port {port} on {self.host} "
                + (
                    "is taken; is a server running already? Choose another with --port"
                    if taken
                    else f"cannot be opened ({reason})"
                )
            ) from None
        self._open.append(server)
        return int(server.sockets[0].getsockname()[1])

    async def _run(self, calls: Dispatcher) -> None:
        """In asynchronous mode, tick in real time; the settings may change at any moment."""
        loop = asyncio.get_running_loop()
        last = loop.time()
        while True:
            await asyncio.sleep(
                min(max(last + self.world.settings.period - loop.time(), 0.0), _NAP)
            )
            period, now = self.world.settings.period, loop.time()
            if self.world.settings.synchronous:
                last = now
            elif now >= last + period:
                last = max(last + period, now - _CATCH_UP)
                calls.tick()


def serve(server: StandinServer, ready: Callable[[StandinServer], None]) -> None:
    """Run a server until SIGINT or SIGTERM.

    Raises:
        PortTaken: see :class:`StandinServer`.
    """
    warm_up()

    async def forever() -> None:
        stop = asyncio.Event()
        with suppress(NotImplementedError):  # Windows has neither
            for number in (signal.SIGINT, signal.SIGTERM):
                asyncio.get_running_loop().add_signal_handler(number, stop.set)
        async with server:
            ready(server)
            await server.until(stop)

    with suppress(KeyboardInterrupt):
        asyncio.run(forever())
