"""A CARLA server: its address, whether it answers, and its version."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple, TypeVar

from steersman.errors import PlantError, one_line

T = TypeVar("T")

# Versions of the server whose protocol the client's version speaks.
SPOKEN = ("0.9.15", "0.9.16")
# Patience with a dead server while leaving it [s].
_FAREWELL = 1.0
# Longest answer to the question for the version [bytes].
_LONGEST = 4096
# First pause before trying again; each further one is twice as long [s].
_FIRST_PAUSE = 0.3


class Server(NamedTuple):
    """Address, longest time for an answer [s], and number of attempts."""

    host: str
    port: int
    timeout: float
    attempts: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"

    def knock(self) -> str:
        """The version of the server, read without the client.

        The client takes its whole time-out where nothing listens, and ends the process
        where something listens that is no CARLA server.

        Raises:
            PlantError: nothing listens, or no CARLA server.
        """
        try:
            with socket.create_connection(self[:2], timeout=self.timeout) as stream:
                return _version(stream)
        except TimeoutError:
            raise PlantError(
                f"{self}: no answer within {self.timeout:g} s; is plant.host right, and is "
                "plant.port that of a CARLA server?"
            ) from None
        except _NotSpoken:
            raise PlantError(
                f"{self}: something answers, but not as a CARLA server does; give its plant.port"
            ) from None
        except OSError as error:
            why = (error.strerror or str(error)).lower()
            raise PlantError(
                f"{self}: no CARLA server ({why}); start it (./CarlaUE4.sh, or 'steersman "
                "carla serve' for the stand-in) or give plant.host and plant.port"
            ) from None

    def alive(self) -> bool:
        """Whether something still listens there."""
        try:
            with socket.create_connection(self[:2], timeout=_FAREWELL):
                return True
        except OSError:
            return False

    @contextmanager
    def answers(self, what: str) -> Iterator[None]:
        """Turn the client's RuntimeErrors into one line.

        Raises:
            PlantError: the client raised one while it did ``what``.
        """
        try:
            yield
        except PlantError:
            raise
        except RuntimeError as error:
            text = one_line(str(error))
            if "time-out" in text and not self.alive():
                text = "the server is gone: nothing listens there any more"
            elif "time-out" in text:
                text = (
                    f"no answer within {self.timeout:g} s; it was stopped, hangs, or needs "
                    "longer: plant.timeout"
                )
            raise PlantError(f"{self}: {what}: {text}") from None


class Clock(NamedTuple):
    """Control period [s], longest physics step [s], most of them, and whether frames are drawn."""

    dt: float
    substep: float
    substeps: int
    rendering: bool


def stem(name: str) -> str:
    """A map's name without its folder."""
    return name.rpartition("/")[2]


class _NotSpoken(Exception):
    """What came back is no answer in CARLA's protocol."""


def _version(stream: socket.socket) -> str:
    """Ask for the server's version: ``[0, id, name, arguments]``, and ``[1, id, error, result]``.

    Raises:
        TimeoutError: no answer.
        _NotSpoken: another answer than a CARLA server's.
    """
    import msgpack

    reader = msgpack.Unpacker(max_buffer_size=_LONGEST, unicode_errors="replace")
    stream.sendall(msgpack.packb([0, 1, "version", [[False]]]))
    try:
        while True:
            part = stream.recv(_LONGEST)
            if not part:
                raise _NotSpoken
            reader.feed(part)
            for answer in reader:
                match answer:
                    case [1, 1, None, [[_, str() as version]]]:
                        return version
                raise _NotSpoken
    except (ValueError, ConnectionError, msgpack.UnpackException):
        raise _NotSpoken from None


def retried(attempt: Callable[[], T], attempts: int) -> T:
    """Try so often, with pauses that double; the last error stands."""
    pause = _FIRST_PAUSE
    for _ in range(attempts - 1):
        try:
            return attempt()
        except PlantError:
            time.sleep(pause)
            pause *= 2.0
    return attempt()


def check_version(server: str, client: str) -> None:
    """Whether client and server understand each other; the client itself only warns.

    >>> check_version("0.9.16-stand-in", "0.9.16")
    >>> check_version("0.9.13", "0.9.16")
    Traceback (most recent call last):
    steersman.errors.PlantError: ... pip install carla==0.9.13 ...

    Raises:
        PlantError: they do not.
    """
    theirs, ours = _number(server), _number(client)
    if theirs in SPOKEN and theirs == ours:
        return
    if theirs in SPOKEN:
        cure = f"pip install carla=={theirs}"
    else:
        cure = f"pip install carla=={theirs} is not enough: {' and '.join(SPOKEN)} are supported"
    raise PlantError(f"the server is CARLA {server}, the client {client}; {cure}")


def whose(version: str) -> str:
    """The source of a server's numbers; a stand-in's are never called CARLA's.

    >>> whose("0.9.16"), whose("0.9.16-stand-in")
    ('CARLA 0.9.16', 'stand-in for CARLA 0.9.16')
    """
    kind = "stand-in for CARLA" if "stand-in" in version else "CARLA"
    return f"{kind} {_number(version)}"


def _number(version: str) -> str:
    found = re.match(r"\d+\.\d+\.\d+", version)
    return found.group() if found else version
