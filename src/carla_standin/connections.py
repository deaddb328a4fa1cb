"""Connections of clients: calls on the one port, subscriptions to streams on the other."""

from __future__ import annotations

import asyncio
import math
import struct
import time

from carla_standin.calls import Dispatcher
from carla_standin.streams import MAX_WAITING, Streams
from carla_standin.wire import Incoming, request, response, warn_once

# Connections at once, of each port: in all, and from one address.
MAX_CLIENTS, MAX_FROM_ONE = 64, 32
# Silence after which a connection makes room for another if there are so many [s]: one that has
# said nothing yet, and one that has called. One that listens to a stream stays.
_MUTE, _SILENT = 1.0, 60.0
# Replies to calls that ignore them are sent when there are so many [bytes].
_REPLIES = 4096
_STREAM_ID = struct.Struct("<I")


class Sessions:
    """The connections of both ports, and the streams that they listen to."""

    def __init__(self, streams: Streams) -> None:
        """None so far."""
        self.streams = streams
        self._all: set[ClientConnection] = set()

    def admit(self, session: ClientConnection) -> bool:
        """Whether there is room for one more connection; counts it if so.

        One that has been silent for too long makes room: of the same address, if there are too
        many of that.
        """
        alike = [other for other in self._all if type(other) is type(session)]
        near = [other for other in alike if other.address == session.address]
        for many, most, whose in (
            (near, MAX_FROM_ONE, f" from {session.address}"),
            (alike, MAX_CLIENTS, ""),
        ):
            if len(many) < most:
                continue
            least = max(many, key=lambda other: other.spent)
            if least.spent < 0.0:
                warn_once(f"stand-in: more than {most} connections{whose}; one was refused")
                return False
            least.reject(f"silent, and there are more than {most} connections{whose}")
            self._all.discard(least)
            if least in alike:
                alike.remove(least)
        self._all.add(session)
        return True

    def forget(self, session: ClientConnection) -> None:
        """A connection is gone, and what it asked for."""
        self._all.discard(session)
        self.streams.forget(session)

    def end(self) -> None:
        """Close every connection."""
        for session in list(self._all):
            session.connection.abort()


class ClientConnection(asyncio.Protocol):
    """A connection of either kind."""

    connection: asyncio.Transport
    patience = _SILENT

    def __init__(self, sessions: Sessions) -> None:
        """One of those."""
        self.sessions, self.address = sessions, ""
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
        peer = transport.get_extra_info("peername")
        self.address = str(peer[0]) if peer else ""
        if not self.sessions.admit(self):
            transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """A client has disconnected."""
        self.sessions.forget(self)

    def reject(self, why: str) -> None:
        """Close the connection: what came is not the protocol."""
        warn_once(f"stand-in: connection closed: {why:.200}")
        self.connection.abort()


class CallConnection(ClientConnection):
    """A client's calls."""

    def __init__(self, sessions: Sessions, calls: Dispatcher) -> None:
        """Answered by ``calls``."""
        super().__init__(sessions)
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
        pressing = False
        while not self._paused:
            message = self.incoming.message()
            if message is None:
                break
            call = request(message)
            awaited = not call.ignores_reply
            owed, self._owed = (self._owed, "") if awaited else ("", self._owed)
            self.sessions.streams.asker = self
            outcome = self._calls.answer(call.name, call.arguments, owed, awaited=awaited)
            self._owed = self._owed or self._calls.untold
            self._replies += self._pack(response(call.number, outcome))
            pressing = pressing or awaited
            if len(self._replies) > _REPLIES:
                self._flush()
        if pressing:
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

    def __init__(self, sessions: Sessions) -> None:
        """To a stream that it has yet to name."""
        super().__init__(sessions)
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
            self.sessions.streams.join(self._stream, self)

    def send(self, data: bytes) -> None:
        """Send a message, or drop it if the client has not read what was sent before."""
        if self.waiting() <= MAX_WAITING:
            self.connection.write(data)

    def waiting(self) -> int:
        """What the client has not read [bytes]."""
        return self.connection.get_write_buffer_size()

    def connection_lost(self, exc: Exception | None) -> None:
        """The client has disconnected or stopped listening."""
        super().connection_lost(exc)
        if self._stream is not None:
            self.sessions.streams.leave(self._stream, self)
