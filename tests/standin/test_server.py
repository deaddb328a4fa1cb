"""The server within the process of the test, without the wheel."""

from __future__ import annotations

import asyncio
import os
import signal
import struct
import sys
from typing import Any

import msgpack
import pytest

from carla_standin.server import PortTaken, StandinServer, serve
from carla_standin.settings import EpisodeSettings
from carla_standin.wire import VERSION

PATIENCE = 20.0


class Client:
    """A connection to the port of the calls."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self.writer = reader, writer
        self._unpacker = msgpack.Unpacker()
        self._number = 0

    @classmethod
    async def to(cls, server: StandinServer) -> Client:
        return cls(*await asyncio.open_connection(server.host, server.port))

    async def call(self, name: str, *arguments: Any, ignored: bool = False) -> Any:
        """The result, unless nobody waits for it."""
        self._number += 1
        self.writer.write(msgpack.packb([0, self._number, name, [[ignored], *arguments]]))
        while not ignored:
            for message in self._unpacker:
                if message[1] == self._number:
                    return message[3]
            data = await asyncio.wait_for(self._reader.read(65536), PATIENCE)
            assert data
            self._unpacker.feed(data)
        return None


def test_calls_and_snapshots() -> None:
    async def session() -> list[int]:
        async with StandinServer(port=0) as server:
            client = await Client.to(server)
            assert await client.call("version") == [[1, VERSION]]
            settings = [True, False, [True, 0.05], True, 0.01, 10, 0.0, True, 1.0, 1.0, True]
            await client.call("set_episode_settings", settings)
            ((_, (episode, (token,))),) = await client.call("get_episode_info")
            stream, port = struct.unpack_from("<IH", token)
            assert (episode, port) == (1, server.stream_port)
            await client.call("get_sensor_token", stream)
            ticked = [(await client.call("tick_cue"))[0][1] for _ in range(3)]
            # Connected after the ticks, but announced before.
            reader, writer = await asyncio.open_connection(server.host, port)
            writer.write(struct.pack("<I", stream))
            seen = []
            for _ in range(3):
                (length,) = struct.unpack("<I", await reader.readexactly(4))
                _, frame = struct.unpack_from("<QQ", await reader.readexactly(length))
                seen.append(frame)
            assert seen == ticked
            # Replies that nobody waits for come with the next, none is left out.
            for _ in range(300):
                await client.call("set_actor_location", 1, [0, 0, 0], ignored=True)
            await client.call("version")
            client.writer.close()
            writer.close()
            return seen

    assert asyncio.run(session()) == [2, 3, 4]


def test_asynchronous_mode_ticks_by_itself() -> None:
    async def session() -> int:
        async with StandinServer(port=0) as server:
            # A long period that holds for a moment delays nothing.
            server.world.settings = EpisodeSettings(synchronous=True, fixed_delta=10.0)
            await asyncio.sleep(0.05)
            begun = server.world.frame
            assert begun == 1
            server.world.settings = EpisodeSettings()
            for _ in range(300):
                await asyncio.sleep(0.01)
                if server.world.frame > begun + 3:
                    break
            return server.world.frame - begun

    assert asyncio.run(session()) > 3


def test_a_taken_port_leaves_nothing_open() -> None:
    async def session() -> None:
        async with StandinServer(port=0) as first:
            second = StandinServer(port=first.port)
            with pytest.raises(PortTaken, match=r"is taken; is a server running already\?"):
                await second.__aenter__()
            third = StandinServer(port=first.port)
            third.stream_port = 0
            with pytest.raises(PortTaken, match=f"port {first.port} .*is taken"):
                await third.__aenter__()
            with pytest.raises(OSError, match=r"refused|Connect call failed"):
                await asyncio.open_connection(third.host, third.stream_port)

    asyncio.run(session())


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_serving_ends_with_a_signal() -> None:
    ports = []

    def ready(server: StandinServer) -> None:
        ports.append(server.port)
        os.kill(os.getpid(), signal.SIGTERM)

    serve(StandinServer(port=0), ready)
    assert ports[0] > 0


def test_a_fault_of_the_clock_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    server = StandinServer(port=0)

    def broken(*_: object) -> Any:
        raise RuntimeError("broken world")

    monkeypatch.setattr(server.world, "tick", broken)
    with pytest.raises(RuntimeError, match="broken world"):
        serve(server, lambda _: None)
