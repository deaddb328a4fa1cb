"""Which connections get which stream: subscriptions, and those that are under way."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from carla_standin.wire import framed
from carla_standin.world import StreamMessage

# What may wait for a client that does not read [bytes]; beyond, a stream's messages are dropped,
# and large ones where so much waits for all of them.
MAX_WAITING = 2**20
_MOST_IN_ALL = 2**26
# How long a client may take from asking where a stream is to listening to it [s].
_UNDER_WAY = 10.0
# Subscriptions under way at once, for each of which so much is kept.
_MOST_UNDER_WAY = 32


class Listener(Protocol):
    """A connection that a stream is sent to."""

    def send(self, data: bytes) -> None:
        """Send, or drop."""
        ...

    def waiting(self) -> int:
        """What has not been read [bytes]."""
        ...


class _Expected:
    """A subscription under way, and what was sent meanwhile."""

    def __init__(self, until: float, asker: object) -> None:
        self.until, self.asker = until, asker
        self.missed: list[bytes] = []

    @property
    def size(self) -> int:
        """Of what was sent meanwhile [bytes]."""
        return sum(map(len, self.missed))


class Streams:
    """Subscriptions by stream.

    The client asks where a stream is, goes on, and connects in the background; a tick here is over
    long before. So a subscription counts from the question: what was sent since is sent late.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Without listeners; ``clock`` gives the time [s]."""
        self._clock = clock
        self.asker: object = None
        """The connection whose call is answered at present."""
        self._listeners: dict[int, set[Listener]] = {}
        self._expected: dict[int, list[_Expected]] = {}

    def expect(self, stream: int) -> None:
        """A client has asked where a stream is."""
        self._forget_the_late()
        if sum(map(len, self._expected.values())) >= _MOST_UNDER_WAY:
            return  # what it misses until it listens is lost
        self._expected.setdefault(stream, []).append(
            _Expected(self._clock() + _UNDER_WAY, self.asker)
        )

    def forget(self, asker: object) -> None:
        """A client is gone: what it has not listened to yet is for no other one."""
        for waiting in self._expected.values():
            waiting[:] = [one for one in waiting if one.asker is not asker]

    def join(self, stream: int, listener: Listener) -> None:
        """A client listens to a stream."""
        self._forget_the_late()
        waiting = self._expected.get(stream)
        if waiting:
            missed = waiting.pop(0).missed
            if missed:
                listener.send(b"".join(missed))
        self._listeners.setdefault(stream, set()).add(listener)

    def leave(self, stream: int, listener: Listener) -> None:
        """A client listens no more."""
        listeners = self._listeners.get(stream, set())
        listeners.discard(listener)
        if not listeners:
            self._listeners.pop(stream, None)

    def heard(self, stream: int) -> bool:
        """Whether a stream has listeners, or is going to have one."""
        return stream in self._listeners or stream in self._expected

    def publish(self, message: StreamMessage) -> None:
        """Send to all listeners, and keep for subscriptions that are under way.

        For each of these one message is kept, however large, or so many as are no longer together
        than is allowed.
        """
        listeners = self._listeners.get(message.stream, ())
        waiting = self._expected.get(message.stream, ())
        if not listeners and not waiting:
            return
        data = framed(message.payload)
        if len(data) > MAX_WAITING and self._full():
            return
        for listener in listeners:
            listener.send(data)
        for one in waiting:
            if not one.missed or one.size + len(data) <= MAX_WAITING:
                one.missed.append(data)

    def _full(self) -> bool:
        """Whether too much waits for a large message to be added."""
        late = (one.size for waiting in self._expected.values() for one in waiting)
        unread = (each.waiting() for those in self._listeners.values() for each in those)
        return sum(late) + sum(unread) > _MOST_IN_ALL

    def _forget_the_late(self) -> None:
        now = self._clock()
        for stream, waiting in list(self._expected.items()):
            waiting[:] = [one for one in waiting if one.until > now]
            if not waiting:
                del self._expected[stream]
