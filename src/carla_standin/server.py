"""The two ports of the stand-in: calls on one, streams on the other; one event loop, one world."""

from __future__ import annotations

import asyncio
import errno
import math
import signal
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path as FilePath

import steersman as sm
from carla_standin import actor_calls, traffic  # noqa: F401 - they enter their calls
from carla_standin.blueprints import VehicleBlueprint, default_models
from carla_standin.calls import Dispatcher
from carla_standin.car import warm_up
from carla_standin.maps import MapLibrary
from carla_standin.streams import MAX_WAITING, Streams
from carla_standin.wire import Incoming, request, response, warn_once
from carla_standin.world import StandinWorld

HOST = "127.0.0.1"
PORT = 2000
# Connections at once, of each port.
MAX_CLIENTS = 32
# Silence after which a connection makes room for another if there are so many [s]: one that has
# said nothing yet, and one that has called. One that listens to a stream stays.
_MUTE, _SILENT = 1.0, 60.0
# Replies to calls that ignore them are sent when there are so many [bytes].
_REPLIES = 4096
_STREAM_ID = struct.Struct("<I")
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
        self.sessions: set[ClientConnection] = set()
        self._open: list[asyncio.Server] = []
        self._clock: asyncio.Task[None] | None = None

    async def __aenter__(self) -> StandinServer:
        """Open the ports.

        Raises:
            PortTaken: one is taken, or may not be opened.
        """
        self.stream_port = await self._listen(lambda: StreamConnection(self), self.stream_port)
        calls = Dispatcher(self.world, self._atlas, self.stream_port, self.streams)
        try:
            self.port = await self._listen(lambda: CallConnection(self, calls), self.port)
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
        for session in list(self.sessions):
            session.connection.abort()
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

    def admit(self, session: ClientConnection) -> bool:
        """Whether there is room for one more connection; counts it if so."""
        alike = [other for other in self.sessions if type(other) is type(session)]
        if len(alike) >= MAX_CLIENTS:
            least = max(alike, key=lambda other: other.spent)
            if least.spent < 0.0:
                warn_once(f"stand-in: more than {MAX_CLIENTS} connections; one was refused")
                return False
            least.reject(f"silent, and there are more than {MAX_CLIENTS} connections")
            self.sessions.discard(least)
        self.sessions.add(session)
        return True


class ClientConnection(asyncio.Protocol):
    """A connection of either kind."""

    connection: asyncio.Transport
    patience = _SILENT

    def __init__(self, server: StandinServer) -> None:
        """Of that server."""
        self.server = server
        self._until = time.monotonic() + _MUTE

    def hear(self) -> None:
        """The client has said something."""
        self._until = time.monotonic() + self.patience

    @property
    def spent(self) -> float:
        """How long it has been silent for too long [s]; negative: it has not."""
        return time.monotonic() - self._until

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        assert isinstance(transport, asyncio.Transport)
        self.connection = transport
        transport.set_write_buffer_limits(high=MAX_WAITING)
        if not self.server.admit(self):
            transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """A client has disconnected."""
        self.server.sessions.discard(self)
        self.server.streams.forget(self)

    def reject(self, why: str) -> None:
        """Close the connection: what came is not the protocol."""
        warn_once(f"stand-in: connection closed: {why:.200}")
        self.connection.abort()


class CallConnection(ClientConnection):
    """A client's calls."""

    def __init__(self, server: StandinServer, calls: Dispatcher) -> None:
        """Answered by ``calls``."""
        super().__init__(server)
        import msgpack

        self._calls, self.incoming = calls, Incoming()
        self._pack = msgpack.Packer().pack
        # Last the error of a call that waited for no answer.
        self._replies, self._paused, self._owed = bytearray(), False, ""

    def data_received(self, data: bytes) -> None:
        """Answer every call that is complete, in the order in which they came."""
        self.hear()
        try:
            self.incoming.feed(data)
            self._work()
        except Exception as error:  # noqa: BLE001 - whatever garbage causes, the others go on
            self.reject(str(error) or type(error).__name__)

    def _work(self) -> None:
        """Answer until there is no more to answer, or the client does not take the answers.

        Replies that are not waited for travel with the next one that is.
        """
        awaited = False
        while not self._paused:
            message = self.incoming.message()
            if message is None:
                break
            call = request(message)
            owed, self._owed = self._owed, ""
            if call.ignores_reply:
                owed, self._owed = "", owed or self._calls.unanswered(call.name)
            self.server.streams.asker = self
            outcome = self._calls.answer(call.name, call.arguments, owed)
            self._replies += self._pack(response(call.number, outcome))
            awaited = awaited or not call.ignores_reply
            if len(self._replies) > _REPLIES:
                self._flush()
        if awaited:
            self._flush()

    def _flush(self) -> None:
        replies, self._replies = self._replies, bytearray()
        if replies:
            self.connection.write(replies)

    def pause_writing(self) -> None:
        """The client does not read its replies: answer no more of its calls, and read none."""
        self._paused = True
        self.connection.pause_reading()

    def resume_writing(self) -> None:
        """It reads again."""
        self._paused = False
        self.connection.resume_reading()
        self.data_received(b"")


class StreamConnection(ClientConnection):
    """A client's subscription to one stream."""

    patience = math.inf

    def __init__(self, server: StandinServer) -> None:
        """To a stream that it has yet to name."""
        super().__init__(server)
        self._head = b""
        self._stream: int | None = None

    def data_received(self, data: bytes) -> None:
        """The number of the stream; nothing may follow."""
        self.hear()
        self._head += data[: _STREAM_ID.size + 1]
        if len(self._head) > _STREAM_ID.size:
            self.reject("a stream's client has nothing more to say than the stream's number")
        elif len(self._head) == _STREAM_ID.size and self._stream is None:
            (self._stream,) = _STREAM_ID.unpack(self._head)
            self.server.streams.join(self._stream, self)

    def send(self, data: bytes) -> None:
        """Send a message, or drop it if the client has not read what was sent before."""
        if self.connection.get_write_buffer_size() <= MAX_WAITING:
            self.connection.write(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has disconnected or stopped listening."""
        super().connection_lost(exc)
        if self._stream is not None:
            self.server.streams.leave(self._stream, self)


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
