"""How messages of CARLA 0.9.16 look on the wire: calls and replies, stream tokens, limits.

Calls are msgpack: a request is ``[0, id, name, [[ignore_reply], *arguments]]``, its reply
``[1, id, nil, result]``. Messages of a stream are a little-endian length and that many bytes.
"""

from __future__ import annotations

import struct
from enum import Enum
from typing import Any, NamedTuple

from steersman.errors import SteersmanError

# What the server says it is. The client compares it with "0.9.16", warns, and goes on.
VERSION = "0.9.16-stand-in"

# Largest request [bytes]; an OpenDRIVE map is the longest thing that a client sends.
MAX_REQUEST = 32 * 2**20
# Longest array within a request: a list is allocated before its elements have arrived.
MAX_ARRAY = 8192
# Longest name of a call and longest text in an answer about it [characters].
MAX_NAME = 64

_REQUEST = 0
_RESPONSE = 1
_TOKEN = struct.Struct("<IHBB16s")
_TCP = 1
_NO_ADDRESS = 0
_LENGTH = struct.Struct("<I")


class Refused(SteersmanError, RuntimeError):
    """A call cannot be answered; the message travels to the client."""


class NotARequest(SteersmanError, ValueError):
    """What arrived is not msgpack-rpc; there is no way to answer it."""


class Reply(Enum):
    """How the client reads the result of a call."""

    VALUE = "value or error"
    NOTHING = "nothing or error"
    BARE = "as it is"


class Request(NamedTuple):
    """One call of a client."""

    number: int
    name: str
    arguments: list[Any]
    ignores_reply: bool


def unpacker() -> Any:
    """A msgpack reader with limits, so that no message of a few bytes takes much memory."""
    import msgpack

    return msgpack.Unpacker(
        max_buffer_size=MAX_REQUEST,
        max_array_len=MAX_ARRAY,
        max_map_len=MAX_ARRAY,
        unicode_errors="replace",
    )


def request(message: Any) -> Request:
    """Check the shape of what was unpacked.

    Raises:
        NotARequest: it is no request.
    """
    match message:
        case [kind, int() as number, str() as name, [[bool(ignored)], *arguments]] if (
            kind == _REQUEST and 0 <= number < 2**32 and len(name) <= MAX_NAME
        ):
            return Request(number, name, arguments, ignored)
    raise NotARequest(f"not a request of CARLA's protocol: {str(message)[:MAX_NAME]!r}")


def result(value: Any, reply: Reply) -> Any:
    """The result of a call that went well."""
    if reply is Reply.VALUE:
        return [[1, value]]
    return [[False]] if reply is Reply.NOTHING else value


def failure(text: str, reply: Reply) -> Any:
    """The result of a call that did not."""
    if reply is Reply.BARE:
        return []
    return [[reply is Reply.NOTHING, [text]]] if reply is Reply.NOTHING else [[0, [text]]]


def response(number: int, outcome: Any) -> list[Any]:
    """The reply to request ``number``, to be packed."""
    return [_RESPONSE, number, None, outcome]


def shaped(value: Any, like: Any) -> Any:
    """``value``, if it has the shape of ``like``: what is kept for a client must be what it reads.

    ``like`` is an example: a bool, int, float or str stands for itself, a tuple for a list of that
    length, a list for a list of any length whose elements are all like its first.

    >>> shaped([1, [[2.5, 3]]], (0.0, [(0.0, 0)]))
    [1.0, [[2.5, 3]]]

    Raises:
        Refused: it has another shape.
    """
    if isinstance(like, list | tuple):
        if not isinstance(value, list) or (isinstance(like, tuple) and len(value) != len(like)):
            raise Refused(f"a list was expected, not {value!r:.40}")
        examples = like if isinstance(like, tuple) else [like[0]] * len(value)
        return [shaped(v, example) for v, example in zip(value, examples, strict=True)]
    kind = type(like)
    if kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind or (kind is int and not -(2**31) <= value < 2**31):
        raise Refused(f"a value of type {kind.__name__} was expected, not {value!r:.40}")
    return value


def optional(value: Any) -> list[Any]:
    """How a value that may be missing travels."""
    return [False] if value is None else [True, value]


def token(stream: int, port: int) -> bytes:
    """What a client needs to find a stream; without an address it takes the server's own."""
    return _TOKEN.pack(stream, port, _TCP, _NO_ADDRESS, bytes(16))


def framed(payload: bytes) -> bytes:
    """A message of a stream."""
    return _LENGTH.pack(len(payload)) + payload
