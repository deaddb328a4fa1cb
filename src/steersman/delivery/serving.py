"""Where a node's messages come from: standard input, or UDP."""

from __future__ import annotations

import gc
import socket
import time
from contextlib import suppress
from typing import BinaryIO

from steersman.controllers.exchange import (
    ASKED,
    LONGEST,
    QUESTION,
    NoQuestion,
    record_length,
    refusal,
)
from steersman.delivery.node import ControllerNode
from steersman.errors import ConfigError, DataError

_LARGEST_DATAGRAM = 65_535
_PORTS = 65_535


def serve_stream(node: ControllerNode, source: BinaryIO, to: BinaryIO) -> None:
    """Answer lines and records of a stream until it ends.

    Raises:
        DataError: a record is damaged, so that the beginning of the next message is unknown.
    """
    gc.freeze()
    while first := source.read(1):
        if first in b"\r\n":
            continue
        if first == ASKED[:1]:
            head = first + source.read(QUESTION.size - 1)
            try:
                message = head + source.read(record_length(head) - len(head))
            except NoQuestion as error:
                to.write(refusal(str(error), head))
                to.flush()
                raise DataError(f"standard input: {error}; it cannot be read further") from None
        else:
            message = rest = first + source.readline(LONGEST)
            while len(rest) >= LONGEST and not rest.endswith(b"\n"):  # it is no question
                rest = source.readline(LONGEST)
        arrived = time.perf_counter()
        to.write(node.answer(message, None, arrived))
        to.flush()


def serve_udp(node: ControllerNode, socket_: socket.socket, count: int | None = None) -> None:
    """Answer datagrams, each to its sender, until ``count`` are answered or Ctrl-C."""
    gc.freeze()
    answered = 0
    with suppress(KeyboardInterrupt):
        while count is None or answered < count:
            message, sender = socket_.recvfrom(_LARGEST_DATAGRAM)
            arrived = time.perf_counter()
            answer = node.answer(message, sender, arrived)
            with suppress(OSError):  # a sender that is gone
                socket_.sendto(answer, sender)
            answered += 1


def bound(address: str) -> socket.socket:
    """A UDP socket on ``HOST:PORT`` or ``PORT``; the host is this machine if it is not given.

    Raises:
        ConfigError: that is no address, or it cannot be used.
    """
    host, colon, port = address.rpartition(":")
    if not port.isdecimal() or int(port) > _PORTS or (colon and not host):
        raise ConfigError(f"--udp: {address!r} is no address; expected 127.0.0.1:PORT or PORT")
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.bind((host or "127.0.0.1", int(port)))
    except OSError as error:
        made.close()
        raise ConfigError(f"--udp: {address} cannot be used ({error.strerror or error})") from None
    return made
