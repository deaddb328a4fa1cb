"""Props and pedestrians through the real client."""

from __future__ import annotations

import math
from typing import Any

import pytest

from .serving import PATIENCE, at, spawn
from .test_sensors import Listener

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")


def put(world: Any, name: str, where: Any) -> Any:
    return world.spawn_actor(world.get_blueprint_library().filter(name)[0], where)


def test_a_prop_stands_in_the_way(world: Any) -> None:
    """Of cars that are spawned, and of one that drives into it, which the sensor reports."""
    prop = put(world, "static.prop.streetbarrier", at(20.0, -20.0))
    car = spawn(world, 10.0, -20.0)
    listener = Listener(world, car, "sensor.other.collision", at(0.0))
    world.tick()
    assert [a.id for a in world.get_actors().filter("static.*")] == [prop.id]
    box = prop.bounding_box
    assert (box.extent.y, box.location.z) == pytest.approx((0.6, box.extent.z))
    with pytest.raises(RuntimeError, match=rf"collision with actor {prop.id}"):
        spawn(world, 18.5, -20.0)
    above = put(world, "static.prop.box01", at(20.0, -20.0, z=50.0))
    car.set_target_velocity(carla.Vector3D(x=10.0))
    for _ in range(20):
        world.tick()
    assert above.is_alive  # the client has nothing to tell of an actor before the next tick
    hit = listener.data.get(timeout=PATIENCE)
    assert (hit.actor.id, hit.other_actor.id) == (car.id, prop.id)
    # What would stop the whole car.
    mass = car.get_physics_control().mass
    assert -10.0 * mass < hit.normal_impulse.x < -5.0 * mass
    assert prop.get_transform().location.x == pytest.approx(20.0)
    assert prop.destroy()


def test_a_pedestrian_walks_as_it_is_told(world: Any, client: Any) -> None:
    walker = put(world, "walker.pedestrian.*", at(5.0, 30.0, z=1.0))
    world.tick()
    assert walker.get_transform().location.z == pytest.approx(walker.bounding_box.extent.z)
    walker.apply_control(carla.WalkerControl(carla.Vector3D(x=3.0, y=4.0), 1.5))
    for _ in range(41):
        world.tick()
    where = walker.get_transform()
    assert (where.location.x - 5.0, where.location.y - 30.0) == pytest.approx(
        (0.6 * 1.5 * 2.05, 0.8 * 1.5 * 2.05), abs=1e-4
    )
    assert where.rotation.yaw == pytest.approx(math.degrees(math.atan2(4.0, 3.0)), abs=1e-3)
    assert walker.get_velocity().y == pytest.approx(1.2, abs=1e-6)
    assert walker.get_control().speed == pytest.approx(1.5)
    client.apply_batch_sync([carla.command.ApplyWalkerControl(walker.id, carla.WalkerControl())])
    world.tick()
    stood = walker.get_transform().location
    world.tick()
    assert walker.get_transform().location == stood
    answer = client.apply_batch_sync(
        [carla.command.ApplyWalkerControl(spawn(world).id, carla.WalkerControl())]
    )
    assert "no walker" in answer[0].error
    ai = world.get_blueprint_library().find("controller.ai.walker")
    with pytest.raises(RuntimeError, match=r"stand-in: .*no navigation here"):
        world.spawn_actor(ai, carla.Transform(), attach_to=walker)


def test_a_car_that_runs_into_a_pedestrian_is_told(world: Any) -> None:
    car = spawn(world, 0.0, -20.0)
    walker = put(world, "walker.pedestrian.0002", at(9.0, -26.0, z=1.0))
    listener = Listener(world, car, "sensor.other.collision", at(0.0))
    camera = Listener(world, walker, "sensor.camera.rgb", at(0.0), image_size_x="8")
    walker.apply_control(carla.WalkerControl(carla.Vector3D(y=1.0), 8.0))
    car.set_target_velocity(carla.Vector3D(x=10.0))
    for _ in range(16):
        world.tick()
    hit = listener.data.get(timeout=PATIENCE)
    assert hit.other_actor.type_id == "walker.pedestrian.0002"
    assert 0.0 > hit.normal_impulse.x > -70.0 * 12.0
    image = camera.data.get(timeout=PATIENCE)
    assert image.transform.location.x == pytest.approx(9.0)
