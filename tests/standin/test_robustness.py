"""What goes wrong on a socket: garbage, huge lengths, silence, death. Others are served on."""

from __future__ import annotations

import contextlib
import random
import signal
import socket
import struct
import sys
import time
from collections.abc import Iterator
from typing import Any

import msgpack
import pytest

from carla_standin.connections import MAX_FROM_ONE
from carla_standin.streams import MAX_WAITING
from carla_standin.wire import MAX_REQUEST

from .serving import PATIENCE, Serving, at, connect, serving, spawn, synchronous

HOST = "127.0.0.1"


def request(name: str, *arguments: Any, number: int = 1) -> bytes:
    """A call, packed."""
    return bytes(msgpack.packb([0, number, name, [[False], *arguments]]))


class Raw:
    """A client of our own, which can be as rude as need be."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection((HOST, port), timeout=PATIENCE)
        self._unpacker = msgpack.Unpacker()
        self._number = 0

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def close(self) -> None:
        self.socket.close()

    def receive(self) -> Any:
        while True:
            for message in self._unpacker:
                return message
            data = self.socket.recv(65536)
            assert data, "the server has hung up"
            self._unpacker.feed(data)

    def call(self, name: str, *arguments: Any) -> Any:
        """The result of a call."""
        self._number += 1
        self.send(request(name, *arguments, number=self._number))
        kind, number, nothing, result = self.receive()
        assert (kind, number, nothing) == (1, self._number, None)
        return result

    def hung_up(self) -> bool:
        """Whether the server closes the connection."""
        try:
            while self.socket.recv(65536):
                pass
        except ConnectionError:
            return True
        except TimeoutError:
            return False
        return True


@pytest.fixture
def raw(server: Serving) -> Iterator[Raw]:
    raw = Raw(server.port)
    yield raw
    raw.close()


def well(server: Serving) -> bool:
    """Whether the server still answers others, if need be when it has noticed who has gone."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        other = Raw(server.port)
        try:
            return bool(other.call("version") == [[1, "0.9.16-stand-in"]])
        except (AssertionError, ConnectionError):
            time.sleep(0.05)
        finally:
            other.close()
    return False


GARBAGE = {
    "text": b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
    "number": b"\x07",
    "wrong kind": msgpack.packb([1, 1, "version", [[False]]]),
    "no metadata": msgpack.packb([0, 1, "version", []]),
    "wrong metadata": msgpack.packb([0, 1, "version", [["no"]]]),
    "name": msgpack.packb([0, 1, "v" * 100, [[False]]]),
    "negative": msgpack.packb([0, -1, "version", [[False]]]),
    "map": msgpack.packb({"jsonrpc": "2.0"}),
    "reserved byte": b"\xc1",
    "list of four billion": b"\xdd\xff\xff\xff\xff",
    "more text than is allowed": b"\x94\x00\x01\xdb\xff\xff\xff\xff" + bytes(MAX_REQUEST + 2**20),
    "a call nested": b"\x94\x00\x01\xa7version\x92\x91\xc2" + b"\x91" * 99 + b"\x00",
    "nested for ever": b"\x94\x00\x01" + b"\x91" * 100_000,
    "nested lists": b"\x94\x00\x01" + b"\xdc\x1f\xff" * 5000,
    "more lists than a batch": b"\x94\x00\x01\xdd\x00\x00\x20\x01" + b"\x90" * 8195,
    "a million lists": b"\x94\x00\x01\xdc\x00\x40" + (b"\xdc\x80\x00" + b"\x90" * 2**15) * 65,
}


@pytest.mark.parametrize("what", GARBAGE)
def test_garbage_ends_the_connection_and_nothing_else(server: Serving, raw: Raw, what: str) -> None:
    with contextlib.suppress(ConnectionError):  # it may hang up before the end
        raw.send(GARBAGE[what])
    assert raw.hung_up()
    assert well(server)


def test_random_bytes_harm_nobody(server: Serving) -> None:
    rng = random.Random(5)
    for port in (server.port, server.stream_port):
        for _ in range(60):
            raw = Raw(port)
            raw.send(rng.randbytes(rng.choice([1, 3, 4, 5, 20, 3000])))
            raw.close()
    assert well(server)


def test_damaged_requests_get_an_error_or_the_door(server: Serving) -> None:
    rng = random.Random(6)
    settings = [True, False, [True, 0.05], True, 0.01, 10, 0.0, True, 1.0, 1.0, True]
    good = [
        request("spawn_actor", [4, "vehicle.tesla.model3", []], [[0, 0, 0], [0, 0, 0]]),
        request("set_episode_settings", settings),
        request("apply_batch", [[[1, [77]]]], True),
    ]
    for _ in range(150):
        data = bytearray(rng.choice(good))
        for _ in range(rng.choice([1, 2, 5])):
            data[rng.randrange(len(data))] = rng.randrange(256)
        other = Raw(server.port)
        other.send(bytes(data))
        other.close()
    assert well(server)


WRONG = [
    ("spawn_actor",),
    ("spawn_actor", 1, 2),
    ("spawn_actor", [1, "vehicle.tesla.model3", []], [[0, 0, float("nan")], [0, 0, 0]]),
    ("spawn_actor", [1, "vehicle.tesla.model3", [["a", 4]]], [[0, 0, 0], [0, 0, 0]]),
    ("spawn_actor", [1, "vehicle.tesla.model3", []], [[1e300, 0, 0], [0, 0, 0]]),
    ("spawn_actor", [1, "walker.dog.0001", []], [[0, 0, 0], [0, 0, 0]]),
    ("spawn_actor_with_parent", [1, "sensor.other.imu", []], [[0, 0, 0], [0, 0, 0]], 99999),
    ("set_episode_settings", [True]),
    ("set_episode_settings", [True, False, [True, "x"], True, 0.01, 10, 0.0, True, 0.0, 0.0, True]),
    ("set_episode_settings", [True, False, [True, 0.05], True, 0.0, 10, 0.0, True, 0.0, 0.0, True]),
    ("get_actors_by_id", 5),
    ("get_actors_by_id", [[]]),
    ("get_sensor_token", "x"),
    ("get_physics_control", 1),
    ("get_wheel_steer_angle", {}, 0),
    ("no_such_call",),
    ("version", "too", "much"),
]


@pytest.mark.parametrize("call", WRONG, ids=lambda call: f"{call[0]}-{len(call)}")
def test_wrong_arguments_get_an_error(raw: Raw, call: tuple[Any, ...]) -> None:
    (answer,) = raw.call(*call)
    assert answer[0] == 0
    assert answer[1][0].startswith("stand-in: ")
    assert raw.call("version") == [[1, "0.9.16-stand-in"]]


@pytest.mark.parametrize(
    "call",
    [
        ("load_new_episode", "Town99", True, 65535),
        ("copy_opendrive_to_file", 5, []),
        ("set_actor_transform", 1, [[0, 0, 0]]),
        ("apply_physics_control", 1, []),
        ("apply_control_to_vehicle", 1, []),
        ("set_weather_parameters", [1.0]),
        ("load_map_layer", 1),
    ],
)
def test_errors_of_calls_without_a_value(raw: Raw, call: tuple[Any, ...]) -> None:
    (answer,) = raw.call(*call)
    assert answer[0] is True
    assert answer[1][0].startswith("stand-in: ")


def test_a_wrong_batch_says_what_is_wrong_with_each(raw: Raw) -> None:
    answers = raw.call("apply_batch", [5, [[0, []]], [[1, [99999]]], [[77, [1]]], [[2, [1, 2]]]])
    assert [answer[0][0] for answer in answers] == [0, 0, 1, 0, 0]
    assert raw.call("apply_batch", 5) == []


def test_a_client_that_vanishes_in_a_call(server: Serving, raw: Raw) -> None:
    raw.send(request("copy_opendrive_to_file", "x" * 5_000_000, [])[:-100])
    raw.close()
    stream = Raw(server.stream_port)
    stream.send(b"\x01\x00")
    stream.close()
    assert well(server)


def test_a_client_that_reads_no_replies_does_not_fill_the_memory(server: Serving) -> None:
    deaf = Raw(server.port)
    deaf.socket.settimeout(1.0)
    plenty = request("get_actor_definitions") * 1000
    before, sent = memory(server), 0
    with contextlib.suppress(TimeoutError):
        while sent < 100 * 2**20:
            sent += deaf.socket.send(plenty)
    assert sent < 100 * 2**20
    assert well(server)
    assert memory(server) < before + 50.0
    deaf.close()
    assert well(server)


def memory(server: Serving) -> float:
    """Resident memory of the server [MB]; 0 where that cannot be told."""
    try:
        with open(f"/proc/{server.process.pid}/status", encoding="ascii") as file:
            lines = dict(line.split(":", 1) for line in file)
    except OSError:
        return 0.0
    return float(lines["VmRSS"].split()[0]) / 1024.0


def frames(stream: Raw) -> list[int]:
    """Frames of the whole snapshots that a stream's client gets until nothing comes for a while."""
    data = bytearray()
    with contextlib.suppress(TimeoutError):
        while True:
            data += stream.socket.recv(2**20)
    found, at = [], 0
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        kind, frame = struct.unpack_from("<QQ", data, at + 4)
        assert kind == 17
        assert (length - 48 - 36) % 119 == 0
        found.append(frame)
        at += 4 + length
    assert at == len(data)
    return found


def test_a_client_that_does_not_read_its_stream_loses_snapshots(
    server: Serving, client: Any
) -> None:
    world = synchronous(client.get_world())
    blueprint = world.get_blueprint_library().find("sensor.other.collision")
    car = spawn(world)
    sensors = [blueprint] * 800  # so that a snapshot is large: 95 kB
    import carla

    go = carla.command
    client.apply_batch_sync([go.SpawnActor(sensor, at(0.0), car.id) for sensor in sensors])
    slow = Raw(server.stream_port)
    slow.send(struct.pack("<I", 1))
    before = memory(server)
    last = world.tick()
    assert len(world.get_snapshot()) > 800
    for _ in range(12 * MAX_WAITING // 95_000):
        last = world.tick()  # which would time out if the server waited for the slow one
    assert memory(server) < before + 50.0
    slow.socket.settimeout(1.0)
    seen = frames(slow)
    assert seen == sorted(set(seen))
    assert seen[-1] < last
    fresh = world.tick()
    assert frames(slow) == [fresh]
    slow.close()


def test_a_stream_that_does_not_exist_stays_silent(server: Serving) -> None:
    stream = Raw(server.stream_port)
    stream.send(struct.pack("<I", 4_000_000_000))
    stream.socket.settimeout(0.2)
    with pytest.raises(TimeoutError):
        stream.socket.recv(1)
    stream.send(b"more")
    stream.socket.settimeout(PATIENCE)
    assert stream.hung_up()
    stream.close()


def test_there_is_a_limit_to_connections(server: Serving) -> None:
    many = [Raw(server.stream_port) for _ in range(MAX_FROM_ONE + 2)]
    refused = [raw for raw in many[-2:] if raw.hung_up()]
    assert refused
    for raw in many:
        raw.close()
    assert well(server)


@pytest.mark.skipif(sys.platform != "linux", reason="needs a second address of the loopback")
def test_one_address_leaves_room_for_others() -> None:
    with serving() as server:
        raws = [Raw(server.port) for _ in range(MAX_FROM_ONE)]
        assert [raw.call("version")[0][0] for raw in raws] == [1] * MAX_FROM_ONE
        more = Raw(server.port)
        assert more.hung_up()
        with socket.create_connection(
            ("127.0.0.1", server.port), PATIENCE, ("127.0.0.2", 0)
        ) as other:
            other.sendall(msgpack.packb([0, 1, "version", [[False]]]))
            assert b"stand-in" in other.recv(100)
        assert raws[0].call("version")[0][0] == 1
        for raw in (*raws, more):
            raw.close()
        _, _, told = server.stop(signal.SIGINT)
    assert told == (
        f"stand-in: more than {MAX_FROM_ONE} connections from 127.0.0.1; one was refused\n"
    )


def test_connections_that_say_nothing_make_room_for_others(server: Serving) -> None:
    mute = [Raw(server.port) for _ in range(MAX_FROM_ONE)]
    assert well(server)
    for raw in mute:
        raw.close()


def test_questions_for_streams_and_a_map_of_little_cost_little(server: Serving, raw: Raw) -> None:
    before = memory(server)
    for _ in range(300):
        raw.call("get_sensor_token", 1)
    time.sleep(0.5)  # 25 snapshots, of which each question would keep its own
    assert memory(server) < before + 10.0
    text = "<OpenDRIVE>" + "<road/>" * 60_000 + "</OpenDRIVE>"
    (answer,) = raw.call("copy_opendrive_to_file", text, [2.0, 50.0, 1.0, 0.6, True, True])
    assert "more than 50000 elements" in answer[1][0]


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_an_interrupted_server_stops_cleanly() -> None:
    with serving() as server:
        raw, stream = Raw(server.port), Raw(server.stream_port)
        assert raw.call("version") == [[1, "0.9.16-stand-in"]]
        assert server.stop(signal.SIGINT) == (0, "stand-in: stopped\n", "")
        assert raw.hung_up()
        assert stream.hung_up()
        raw.close()
        stream.close()


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_the_client_notices_that_the_server_was_killed() -> None:
    with serving() as server:
        client = connect(server)
        world = synchronous(client.get_world())
        car = spawn(world)
        world.tick()
        client.set_timeout(1.0)
        server.stop(signal.SIGKILL)
        begun = time.monotonic()
        with pytest.raises(RuntimeError, match="time-out"):
            world.tick()
        assert time.monotonic() - begun < PATIENCE
        assert car.is_alive  # as far as the client knows
