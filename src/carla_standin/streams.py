"""Which connections get which stream: subscriptions, and those that are under way."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from carla_standin.wire import framed
from carla_standin.world import StreamMessage

# What may wait for a client that does not read [bytes]; beyond, a stream's messages are dropped.
MAX_WAITING = 2**20
# How long a client may take from asking where a stream is to listening to it [s].
_UNDER_WAY = 10.0
# Subscriptions under way at once, for each of which so much is kept.
_MOST_UNDER_WAY = 32


class Listener(Protocol):
    """A connection that a stream is sent to."""

    def send(self, data: bytes) -> None:
        """Send, or drop."""
        ...


class _Expected:
    """A subscription under way, and what was sent meanwhile."""

    def __init__(self, until: float, asker: object) -> None:
        self.until, self.asker = until, asker
        self.missed = bytearray()


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
                listener.send(bytes(missed))
        self._listeners.setdefault(stream, set()).add(listener)

    def leave(self, stream: int, listener: Listener) -> None:
        """A client listens no more."""
        listeners = self._listeners.get(stream, set())
        listeners.discard(listener)
        if not listeners:
            self._listeners.pop(stream, None)

    def publish(self, message: StreamMessage) -> None:
        """Send to all listeners, and keep for subscriptions that are under way."""
        listeners = self._listeners.get(message.stream, ())
        waiting = self._expected.get(message.stream, ())
        if not listeners and not waiting:
            return
        data = framed(message.payload)
        for listener in listeners:
            listener.send(data)
        for one in waiting:
            if len(one.missed) + len(data) <= MAX_WAITING:
                one.missed += data

    def _forget_the_late(self) -> None:
        now = self._clock()
        for stream, waiting in list(self._expected.items()):
            waiting[:] = [one for one in waiting if one.until > now]
            if not waiting:
                del self._expected[stream]
