"""Worlds, settings and time through the real client; several clients; sessions left behind."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from typing import Any

import pytest

from carla_standin.wire import VERSION

from .serving import MODEL3, PATIENCE, ROAD, Serving, at, connect, spawn, synchronous

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")


def test_the_server_says_that_it_is_a_stand_in(server: Serving, client: Any) -> None:
    assert client.get_client_version() == "0.9.16"
    assert client.get_server_version() == VERSION == "0.9.16-stand-in"
    assert server.greeting.startswith("stand-in for a CARLA server: 127.0.0.1:")


def test_settings_are_kept(client: Any) -> None:
    world = synchronous(client.get_world(), 0.02, 0.004, 7)
    settings = client.get_world().get_settings()
    assert (settings.synchronous_mode, settings.fixed_delta_seconds) == (True, 0.02)
    assert (settings.max_substep_delta_time, settings.max_substeps) == (0.004, 7)
    assert not settings.no_rendering_mode
    before = world.get_snapshot() if world.tick() else None
    world.tick()
    after = world.get_snapshot()
    assert after.frame == before.frame + 1
    assert after.delta_seconds == pytest.approx(0.02)
    assert after.elapsed_seconds - before.elapsed_seconds == pytest.approx(0.02)


def test_impossible_settings_are_refused(client: Any) -> None:
    world = client.get_world()
    with pytest.raises(RuntimeError, match=r"stand-in: .*fixed_delta_seconds"):
        synchronous(world, 1e9)
    with pytest.raises(RuntimeError, match=r"stand-in: .*max_substep"):
        synchronous(world, 0.05, 0.01, 0)
    assert not world.get_settings().synchronous_mode


def test_nothing_moves_between_ticks(world: Any) -> None:
    car = spawn(world)
    car.apply_control(carla.VehicleControl(throttle=1.0))
    frame = world.tick()
    time.sleep(0.15)
    assert world.get_snapshot().frame == frame
    assert world.tick() == frame + 1


def test_asynchronous_mode_ticks_in_real_time(client: Any) -> None:
    world = client.get_world()
    settings = world.get_settings()
    settings.synchronous_mode, settings.fixed_delta_seconds = False, 0.05
    world.apply_settings(settings)
    first, begun = world.wait_for_tick(PATIENCE), time.monotonic()
    while time.monotonic() - begun < 0.5:
        last = world.wait_for_tick(PATIENCE)
    simulated = last.elapsed_seconds - first.elapsed_seconds
    # A busy machine may lose time; none may be gained but what a pause was made up for.
    assert 0.1 < simulated < time.monotonic() - begun + 0.3
    car = spawn(world)
    car.apply_control(carla.VehicleControl(throttle=1.0))
    end = time.monotonic() + PATIENCE
    while car.get_velocity().x < 1.0 and time.monotonic() < end:
        world.wait_for_tick(PATIENCE)
    assert car.get_velocity().x >= 1.0


def test_on_tick_is_called_for_every_tick(world: Any) -> None:
    seen: list[int] = []
    last = threading.Event()
    number = world.on_tick(lambda snapshot: seen.append(snapshot.frame))
    frames = [world.tick() for _ in range(5)]
    end = time.monotonic() + PATIENCE
    while len(seen) < 5 and not last.wait(0.01) and time.monotonic() < end:
        pass
    assert seen == frames
    world.remove_on_tick(number)
    world.tick()
    assert len(seen) == 5


def test_a_world_is_made_from_opendrive(client: Any) -> None:
    old = synchronous(client.get_world())
    car = spawn(old)
    old.tick()
    world = client.generate_opendrive_world(ROAD)
    assert world.id != old.id or world.get_map().name == "Carla/Maps/OpenDriveMap"
    assert not world.get_settings().synchronous_mode
    assert not [a for a in world.get_actors() if a.id == car.id]
    where = world.get_map().get_waypoint(carla.Location(x=20.0, y=-12.0))
    assert (where.road_id, where.lane_id) == (7, -1)
    # 15 m and 6 m from the start at 0.5 rad: 2 m right of the reference line, in CARLA's axes.
    assert where.transform.rotation.yaw == pytest.approx(-28.648, abs=1e-2)
    world = client.generate_opendrive_world(ROAD, reset_settings=False)
    assert not world.get_settings().synchronous_mode
    synchronous(world)
    world = client.generate_opendrive_world(ROAD, reset_settings=False)
    assert world.get_settings().synchronous_mode


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no xml",
        "<OpenDRIVE/>",
        "<road/>",
        ROAD[:200],
        '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY x "y">]><OpenDRIVE><road/></OpenDRIVE>',
    ],
)
def test_what_is_no_opendrive_is_refused(client: Any, text: str) -> None:
    with pytest.raises(RuntimeError, match=r"stand-in: copy_opendrive_to_file: OpenDRIVE: "):
        client.generate_opendrive_world(text)
    assert client.get_world().get_map().name == "Carla/Maps/StandInStraight"


def test_the_empty_server_has_a_road_to_drive_on(client: Any) -> None:
    world = client.get_world()
    road = world.get_map()
    first, *_ = road.get_spawn_points()
    where = road.get_waypoint(first.location)
    assert where.transform.location.distance(first.location) < 0.1
    assert where.transform.rotation.yaw == pytest.approx(first.rotation.yaw, abs=0.1)
    assert world.try_spawn_actor(world.get_blueprint_library().find(MODEL3), first) is not None


def test_two_clients_share_one_world(server: Serving, client: Any) -> None:
    mine = synchronous(client.get_world())
    theirs = connect(server).get_world()
    car = spawn(mine)
    theirs.tick()
    same = theirs.get_actor(car.id)
    same.apply_control(carla.VehicleControl(throttle=1.0))
    for _ in range(10):
        assert mine.tick() + 1 == theirs.tick() == theirs.get_snapshot().frame
    assert same.get_velocity().x > 1.0  # the last to tick has the newest snapshot
    mine.tick()
    assert car.get_velocity().x > 1.0
    weather = theirs.get_weather()
    weather.cloudiness = 80.0
    theirs.set_weather(weather)
    theirs.tick()
    assert mine.get_weather().cloudiness == 80.0


LEAVES = """
import os, signal, sys
import carla
client = carla.Client("127.0.0.1", int(sys.argv[1]))
client.set_timeout(20.0)
world = client.get_world()
settings = world.get_settings()
settings.synchronous_mode, settings.fixed_delta_seconds = True, 0.05
world.apply_settings(settings)
model = world.get_blueprint_library().find("vehicle.tesla.model3")
world.spawn_actor(model, carla.Transform(carla.Location(x=3.0)))
world.tick()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_what_a_dead_client_left_can_be_found_and_removed(client: Any, server: Serving) -> None:
    died = subprocess.run(
        [sys.executable, "-c", LEAVES, str(server.port)],
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert died.returncode == -signal.SIGKILL
    late = connect(server)
    world = late.get_world()
    settings = world.get_settings()
    assert settings.synchronous_mode
    with pytest.raises(RuntimeError, match="time-out"):
        world.wait_for_tick(0.3)
    world.tick()
    left = list(world.get_actors().filter("vehicle.*"))
    assert [actor.type_id for actor in left] == ["vehicle.tesla.model3"]
    assert world.try_spawn_actor(world.get_blueprint_library().find(left[0].type_id), at(3)) is None
    assert [actor.destroy() for actor in left] == [True]
    settings.synchronous_mode = False
    world.apply_settings(settings)
    world.wait_for_tick(PATIENCE)
    assert not list(world.get_actors().filter("vehicle.*"))
