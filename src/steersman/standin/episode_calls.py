"""Calls about the server, the episode, its settings and its map."""

from __future__ import annotations

from typing import Any

from steersman.standin.calls import Desk, answers
from steersman.standin.maps import GENERATED, read_map
from steersman.standin.settings import Settings
from steersman.standin.wire import VERSION, Refused, Reply
from steersman.standin.world import SNAPSHOTS


@answers(Reply.VALUE)
def version(_: Desk) -> str:
    """What the server says it is."""
    return VERSION


@answers(Reply.VALUE)
def get_episode_info(desk: Desk) -> list[Any]:
    """Number of the episode, and where its snapshots are to be had."""
    return [desk.world.episode, [desk.token(SNAPSHOTS)]]


@answers(Reply.VALUE)
def get_sensor_token(desk: Desk, stream: int) -> list[Any]:
    """Where a stream is to be had; the client is going to listen to it."""
    token = desk.token(stream)
    desk.streams.expect(stream)
    return [token]


@answers(Reply.VALUE)
def get_episode_settings(desk: Desk) -> list[Any]:
    """The settings that hold."""
    return desk.world.settings.wire()


@answers(Reply.VALUE)
def set_episode_settings(desk: Desk, values: Any) -> int:
    """Take other settings; the frame."""
    desk.world.settings = Settings.read(values)
    return desk.world.frame


@answers(Reply.VALUE)
def tick_cue(desk: Desk) -> int:
    """Tick, in synchronous mode; the frame."""
    return desk.tick() if desk.world.settings.synchronous else desk.world.frame


@answers(Reply.VALUE)
def get_map_info(desk: Desk) -> list[Any]:
    """Name of the map and its spawn points."""
    return [desk.world.map.path, [where.wire() for where in desk.world.map.spawn_points]]


@answers(Reply.VALUE)
def get_map_data(desk: Desk) -> str:
    """The map's OpenDRIVE text."""
    return desk.world.map.opendrive


@answers(Reply.VALUE)
def get_available_maps(desk: Desk) -> list[str]:
    """Maps that can be loaded by name."""
    return desk.atlas.names()


@answers(Reply.VALUE)
def get_required_files(_: Desk, *__: Any) -> list[str]:
    """Files that a map needs beside its text: none."""
    return []


@answers(Reply.VALUE)
def query_lights_state(_: Desk, *__: Any) -> list[Any]:
    """Street lights: none."""
    return []


@answers(Reply.NOTHING)
def copy_opendrive_to_file(desk: Desk, text: str, *_: Any) -> None:
    """Keep the text of a world that is going to be loaded; how its mesh is made is of no effect."""
    desk.world.opendrive = read_map(GENERATED, text)


@answers(Reply.NOTHING)
def load_new_episode(desk: Desk, name: str, reset_settings: bool = True, *_: Any) -> None:
    """Load a map by name, the world that was sent before, or (no name) the current one again."""
    if not name:
        desk.world.load(desk.world.map, reset_settings)
    elif name.rpartition("/")[2] != GENERATED:
        desk.world.load(desk.atlas.load(name), reset_settings)
    elif desk.world.opendrive is not None:
        desk.world.load(desk.world.opendrive, reset_settings)
    else:
        raise Refused("no OpenDRIVE world has been generated yet")


@answers(Reply.VALUE)
def get_weather_parameters(desk: Desk) -> list[Any]:
    """The weather that was set last."""
    return desk.world.weather


@answers(Reply.NOTHING)
def set_weather_parameters(desk: Desk, values: list[Any]) -> None:
    """Keep the weather; it has no effect."""
    if len(values) != len(desk.world.weather):
        raise Refused(f"weather has {len(desk.world.weather)} values")
    desk.world.weather = [float(value) for value in values]
