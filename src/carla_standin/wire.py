"""CARLA 0.9.16 on the wire: calls and replies, transforms, stream tokens, limits, and the log.

Calls are msgpack: a request is ``[0, id, name, [[ignore_reply], *arguments]]``, its reply
``[1, id, nil, result]``. Messages of a stream are a little-endian length and that many bytes.
"""

from __future__ import annotations

import itertools
import logging
import math
import struct
from enum import Enum
from typing import Any, NamedTuple

import steersman as sm

log = logging.getLogger("carla_standin")
# Lines that are logged at most: a client that repeats a mistake at every tick must fill neither
# the terminal nor the memory.
_MOST_LINES = 1000
_logged: set[str] = set()

# What the server says it is. The client compares it with "0.9.16", warns, and goes on.
VERSION = "0.9.16-stand-in"

# Largest request [bytes]; an OpenDRIVE map is the longest thing that a client sends.
MAX_REQUEST = 8 * 2**20
# Longest array within a request, as for a batch; and in one of more than so many bytes, which is
# long for its text.
MAX_ARRAY = 8192
# Levels to which a request nests at most.
_DEEPEST = 64
_LONG, _FEW = 2**20, 64
# Farthest from the origin that anything is placed [m].
_FARTHEST = 1e6
# Longest name of a call and longest text in an answer about it [characters].
MAX_NAME = 64

_REQUEST = 0
_RESPONSE = 1
_ARRAY_OF_FOUR = 0x94
_TOKEN = struct.Struct("<IHBB16s")
_TCP = 1
_NO_ADDRESS = 0
_LENGTH = struct.Struct("<I")


def warn_once(text: str) -> None:
    """Log a line, unless it was logged before or there have been too many."""
    if text not in _logged and len(_logged) < _MOST_LINES:
        _logged.add(text)
        log.warning("%.300s", text)


class Refused(sm.SteersmanError, RuntimeError):
    """A call cannot be answered; the message travels to the client."""


class NotARequest(sm.SteersmanError, ValueError):
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


class Transform(NamedTuple):
    """A pose as CARLA says it: location [m] and rotation [deg]."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    roll: float = 0.0

    @classmethod
    def of(cls, pose: sm.Pose, offset: float) -> Transform:
        """That of an actor's origin on the ground, ``offset`` [m] behind the pose's point.

        >>> Transform.of(sm.Pose(10.0, 2.0, 0.0), 0.45)
        Transform(x=9.55, y=-2.0, z=0.0, pitch=0.0, yaw=0.0, roll=0.0)
        """
        x, y, yaw = sm.CarlaFrame(offset).placement(pose)
        return cls(x, y, yaw=yaw)

    def pose(self, offset: float) -> sm.Pose:
        """The inverse of :meth:`of`, for an upright actor."""
        return sm.CarlaFrame(offset).pose(self.x, self.y, self.yaw)

    def wire(self) -> list[list[float]]:
        """As it travels in calls."""
        return [[self.x, self.y, self.z], [self.pitch, self.yaw, self.roll]]

    def placed(self, relative: Transform) -> Transform:
        """In the world, a transform that is given relative to this upright one."""
        c, s = math.cos(math.radians(self.yaw)), math.sin(math.radians(self.yaw))
        return Transform(
            self.x + c * relative.x - s * relative.y,
            self.y + s * relative.x + c * relative.y,
            self.z + relative.z,
            relative.pitch,
            math.remainder(self.yaw + relative.yaw, 360.0),
            relative.roll,
        )


class Incoming:
    """The bytes of a client: a message is unpacked when it is whole, and no larger than its bytes.

    An array is allocated at the length that it claims, so an unpacker that is fed as bytes come
    takes 64 kB for three of them. Here nothing is allocated before all that was claimed is there.
    """

    def __init__(self) -> None:
        """Without any."""
        import msgpack

        self._pending = bytearray()
        self._begun = 0
        self._reader = msgpack.Unpacker(max_buffer_size=MAX_REQUEST)
        self._more, self._full = msgpack.OutOfData, msgpack.BufferFull

    def feed(self, data: bytes) -> None:
        """Take in what has come.

        Raises:
            NotARequest: it is not the beginning of a request, or longer than is allowed.
        """
        try:
            self._reader.feed(data)
        except self._full:
            raise NotARequest(f"a request of more than {MAX_REQUEST} bytes") from None
        self._pending += data
        self._refuse_others()

    def message(self) -> Any:
        """The next message; None if it is not whole.

        Raises:
            ValueError: it is not what msgpack writes, or holds more than is allowed.
        """
        try:
            self._reader.skip()
        except self._more:
            return None
        size = self._reader.tell() - self._begun
        data = bytes(self._pending[:size])
        del self._pending[:size]
        self._begun += size
        self._refuse_others()
        return _unpacked(data)

    def _refuse_others(self) -> None:
        if self._pending and self._pending[0] != _ARRAY_OF_FOUR:
            raise NotARequest(f"not a request of CARLA's protocol: {bytes(self._pending[:9])!r}")


def _unpacked(data: bytes) -> Any:
    """A whole message; a long one may hold a long text, and little else."""
    import msgpack

    if len(data) <= _LONG:
        limits: dict[str, Any] = {"max_array_len": MAX_ARRAY, "max_map_len": MAX_ARRAY}
    else:
        room = iter(range(MAX_ARRAY))

        def counted(values: Any) -> Any:
            if next(room, None) is None:
                raise ValueError(f"a message of {len(data)} bytes has more than {MAX_ARRAY} lists")
            return values

        few = {"max_array_len": _FEW, "max_map_len": _FEW}
        limits = {**few, "list_hook": counted, "object_hook": counted}
    message = msgpack.unpackb(data, unicode_errors="replace", **limits)
    level, depth = [message], 0
    while level:
        inner = [
            v.values() if isinstance(v, dict) else v for v in level if isinstance(v, list | dict)
        ]
        level, depth = list(itertools.chain(*inner)), depth + 1
        if depth > _DEEPEST:
            raise ValueError(f"a message nests deeper than {_DEEPEST} levels")
    return message


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


def read_transform(values: Any) -> Transform:
    """A transform from the wire.

    Raises:
        Refused: it is none, or beyond all bounds.
    """
    match values:
        case [[x, y, z], [pitch, yaw, roll]]:
            found = Transform(*map(float, (x, y, z, pitch, yaw, roll)))
            if all(math.isfinite(v) and abs(v) <= _FARTHEST for v in found):
                return found
    raise Refused(f"not a transform, or one farther than {_FARTHEST:g} m: {values!r:.80}")


def read_vector(values: Any) -> tuple[float, float, float]:
    """A vector from the wire.

    Raises:
        Refused: it is none, or beyond all bounds.
    """
    match values:
        case [x, y, z]:
            found = float(x), float(y), float(z)
            if all(math.isfinite(v) and abs(v) <= _FARTHEST for v in found):
                return found
    raise Refused(f"not a vector of finite numbers: {values!r:.80}")
