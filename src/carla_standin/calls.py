"""Which calls are answered, and how: a registry of functions, each named as its call.

The first argument of an answer is the :class:`Dispatcher`, the others are what the client sent.
Calls about the server, the episode, its settings and its map are here, those about actors in
``actor_calls``.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import Any, TypeAlias

from carla_standin.maps import GENERATED, MapLibrary, read_map
from carla_standin.settings import EpisodeSettings
from carla_standin.streams import Streams
from carla_standin.wire import VERSION, Refused, Reply, failure, result, token, warn_once
from carla_standin.world import SNAPSHOTS, StandinWorld

Answer: TypeAlias = Callable[..., Any]

# Calls that exist, are not answered here, and whose errors the client reads as "nothing or error".
_NOTHING_ELSEWHERE = frozenset(
    {
        "apply_color_texture_to_objects",
        "apply_float_color_texture_to_objects",
        "load_map_layer",
        "unload_map_layer",
    }
)
# Calls that change nothing that a client could ask for: street and traffic lights, of which there
# are none, and what is only looked at, doors, drawings and how pictures are made.
_WITHOUT_EFFECT = frozenset(
    {
        "clear_debug_shape",
        "clear_debug_string",
        "close_vehicle_door",
        "draw_debug_shape",
        "freeze_all_traffic_lights",
        "open_vehicle_door",
        "reset_all_traffic_lights",
        "set_annotations_traverse_translucency",
        "show_vehicle_debug_telemetry",
        "update_day_night_cycle",
        "update_lights_state",
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


class Dispatcher:
    """Answers calls on one world; ``streams`` get what a tick produces."""

    def __init__(
        self, world: StandinWorld, atlas: MapLibrary, stream_port: int, streams: Streams
    ) -> None:
        """``stream_port`` is what tokens of streams point to."""
        self.world = world
        self.atlas = atlas
        self._port = stream_port
        self.streams = streams
        self.untold = ""
        """What of the last call is not implemented, and in no answer that the client reads."""
        self._awaited = True

    def answer(
        self, name: str, arguments: list[Any], owed: str = "", *, awaited: bool = True
    ) -> Any:
        """The result of a call; whatever is wrong with it becomes the error that is answered.

        ``owed`` is an earlier error of the client, which it gets instead: the call is not made.
        ``awaited``: the client reads the answer.
        """
        known = _answers.get(name)
        self.untold, self._awaited = "" if awaited else self.unanswered(name), awaited
        if known is not None and owed:
            return failure(owed, known[0])
        if known is None:
            text = self.unanswered(name)
            warn_once(text or f"stand-in: {name} has no effect")
            reply = (
                Reply.NOTHING if name in {*_NOTHING_ELSEWHERE, *_WITHOUT_EFFECT} else Reply.VALUE
            )
            return failure(text, reply) if text else result(None, Reply.NOTHING)
        reply, function = known
        try:
            return result(function(self, *arguments), reply)
        except Refused as error:
            text = told(name, str(error))
        except _WRONG_ARGUMENTS as error:
            text = told(name, f"wrong arguments ({error})")
        warn_once(text)
        return failure(text, reply)

    @staticmethod
    def unanswered(name: str) -> str:
        """What a client is told of a call that is not implemented; nothing of others."""
        if name in _answers or name in _WITHOUT_EFFECT:
            return ""
        return f"stand-in: {name!r} is not implemented; docs/carla_standin.md lists what is"

    def left_out(self, what: str, *, answered: bool) -> str:
        """The error of a part of a call; ``answered``: the call's answer has it."""
        text = f"stand-in: {what} is not implemented"
        if not (answered and self._awaited):
            self.untold = self.untold or text
        return text

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
        for message in self.world.tick(time.monotonic(), self.streams.heard):
            self.streams.publish(message)
        return self.world.frame


@answers(Reply.VALUE)
def version(_: Dispatcher) -> str:
    """What the server says it is."""
    return VERSION


@answers(Reply.VALUE)
def get_episode_info(calls: Dispatcher) -> list[Any]:
    """Number of the episode, and where its snapshots are to be had."""
    return [calls.world.episode, [calls.token(SNAPSHOTS)]]


@answers(Reply.VALUE)
def get_sensor_token(calls: Dispatcher, stream: int) -> list[Any]:
    """Where a stream is to be had; the client is going to listen to it."""
    token = calls.token(stream)
    calls.streams.expect(stream)
    return [token]


@answers(Reply.VALUE)
def get_episode_settings(calls: Dispatcher) -> list[Any]:
    """The settings that hold."""
    return calls.world.settings.wire()


@answers(Reply.VALUE)
def set_episode_settings(calls: Dispatcher, values: Any) -> int:
    """Take other settings; the frame."""
    calls.world.settings = EpisodeSettings.read(values)
    return calls.world.frame


@answers(Reply.VALUE)
def tick_cue(calls: Dispatcher) -> int:
    """Tick, in synchronous mode; the frame."""
    return calls.tick() if calls.world.settings.synchronous else calls.world.frame


@answers(Reply.VALUE)
def get_map_info(calls: Dispatcher) -> list[Any]:
    """Name of the map and its spawn points."""
    return [calls.world.map.path, [where.wire() for where in calls.world.map.spawn_points]]


@answers(Reply.VALUE)
def get_map_data(calls: Dispatcher) -> str:
    """The map's OpenDRIVE text."""
    return calls.world.map.opendrive


@answers(Reply.VALUE)
def get_available_maps(calls: Dispatcher) -> list[str]:
    """Maps that can be loaded by name."""
    return calls.atlas.names()


@answers(Reply.VALUE)
def get_required_files(_: Dispatcher, *__: Any) -> list[str]:
    """Files that a map needs beside its text: none."""
    return []


@answers(Reply.VALUE)
def query_lights_state(_: Dispatcher, *__: Any) -> list[Any]:
    """Street lights: none."""
    return []


@answers(Reply.NOTHING)
def copy_opendrive_to_file(calls: Dispatcher, text: str, *_: Any) -> None:
    """Keep the text of a world that is going to be loaded; how its mesh is made is of no effect."""
    calls.world.opendrive = read_map(GENERATED, text)


@answers(Reply.NOTHING)
def load_new_episode(calls: Dispatcher, name: str, reset_settings: bool = True, *_: Any) -> None:
    """Load a map by name, the world that was sent before, or (no name) the current one again."""
    if not name:
        calls.world.load(calls.world.map, reset_settings)
    elif name.rpartition("/")[2] != GENERATED:
        calls.world.load(calls.atlas.load(name), reset_settings)
    elif calls.world.opendrive is not None:
        calls.world.load(calls.world.opendrive, reset_settings)
    else:
        raise Refused("no OpenDRIVE world has been generated yet")


@answers(Reply.VALUE)
def get_weather_parameters(calls: Dispatcher) -> list[Any]:
    """The weather that was set last."""
    return calls.world.weather


@answers(Reply.NOTHING)
def set_weather_parameters(calls: Dispatcher, values: list[Any]) -> None:
    """Keep the weather; it has no effect."""
    if len(values) != len(calls.world.weather):
        raise Refused(f"weather has {len(calls.world.weather)} values")
    calls.world.weather = [float(value) for value in values]
