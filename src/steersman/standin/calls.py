"""Which calls are answered, and how: a registry of functions, each named as its call.

The functions stand in ``episode_calls`` and ``actor_calls``. Their first argument is the
:class:`Desk`, the others are what the client sent.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import Any, TypeAlias

from steersman.standin.log import warn_once
from steersman.standin.maps import Atlas
from steersman.standin.streams import Streams
from steersman.standin.wire import Refused, Reply, failure, result, token
from steersman.standin.world import World

Answer: TypeAlias = Callable[..., Any]

# Calls that exist, are not answered here, and whose errors the client reads as "nothing or error".
_NOTHING_ELSEWHERE = frozenset(
    {
        "apply_color_texture_to_objects",
        "apply_float_color_texture_to_objects",
        "load_map_layer",
        "reset_all_traffic_lights",
        "unload_map_layer",
    }
)
# Calls by which the client drives cars itself; their names would not tell a user what was refused.
_AUTOPILOT = frozenset(
    {
        "add_traffic_manager_running",
        "destroy_traffic_manager",
        "get_traffic_manager_running",
        "is_traffic_manager_running",
        "set_actor_autopilot",
    }
)
# What a malformed argument can raise deep inside; all of it is the client's to mend.
_WRONG_ARGUMENTS = (
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    AttributeError,
    OverflowError,
    struct.error,
)

# Longest text of an error [characters].
_LONGEST = 300

_answers: dict[str, tuple[Reply, Answer]] = {}


def answers(reply: Reply) -> Callable[[Answer], Answer]:
    """Enter a function as the answer to the call of its name."""

    def enter(function: Answer) -> Answer:
        _answers[function.__name__] = (reply, function)
        return function

    return enter


def answered() -> list[str]:
    """Names of all calls that are answered."""
    return sorted(_answers)


def told(name: str, what: str) -> str:
    """The error of a call, no longer than people read: it may quote what the client sent."""
    return f"stand-in: {name}: {what:.{_LONGEST}}"


class Desk:
    """Answers calls on one world; ``streams`` get what a tick produces."""

    def __init__(self, world: World, atlas: Atlas, stream_port: int, streams: Streams) -> None:
        """``stream_port`` is what tokens of streams point to."""
        self.world = world
        self.atlas = atlas
        self._port = stream_port
        self.streams = streams

    def answer(self, name: str, arguments: list[Any]) -> Any:
        """The result of a call; whatever is wrong with it becomes the error that is answered."""
        if name not in _answers:
            what = "autopilot (the traffic manager)" if name in _AUTOPILOT else repr(name)
            text = f"stand-in: {what} is not implemented; docs/carla_standin.md lists what is"
            warn_once(text)
            return failure(text, Reply.NOTHING if name in _NOTHING_ELSEWHERE else Reply.VALUE)
        reply, function = _answers[name]
        try:
            return result(function(self, *arguments), reply)
        except Refused as error:
            text = told(name, str(error))
        except _WRONG_ARGUMENTS as error:
            text = told(name, f"wrong arguments ({error})")
        warn_once(text)
        return failure(text, reply)

    def execute(self, name: str, arguments: list[Any]) -> str:
        """Make a call as part of a batch; what went wrong, or nothing."""
        try:
            _answers[name][1](self, *arguments)
        except Refused as error:
            return told(name, str(error))
        except _WRONG_ARGUMENTS as error:
            return told(name, f"wrong arguments ({error})")
        return ""

    def token(self, stream: int) -> bytes:
        """Where a client finds a stream."""
        return token(stream, self._port)

    def tick(self) -> int:
        """Advance the world and send what came of it; the new frame."""
        for message in self.world.tick(time.monotonic()):
            self.streams.publish(message)
        return self.world.frame
