"""The sensors' streams through the real client."""

from __future__ import annotations

import math
import queue
from itertools import pairwise
from typing import Any

import pytest

from .serving import PATIENCE, ROAD, Serving, another_world, at, spawn, synchronous

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")


class Listener:
    """A sensor on a car and its data; the client forgets a sensor that nobody holds."""

    def __init__(self, world: Any, car: Any, kind: str, where: Any, **attributes: str) -> None:
        blueprint = world.get_blueprint_library().find(kind)
        for name, value in attributes.items():
            blueprint.set_attribute(name, value)
        self.sensor = world.spawn_actor(blueprint, where, attach_to=car)
        self.data: queue.Queue[Any] = queue.Queue()
        self.sensor.listen(self.data.put)

    def at_frame(self, frame: int) -> Any:
        """The measurement of that frame."""
        while True:
            found = self.data.get(timeout=PATIENCE)
            if found.frame >= frame:
                assert found.frame == frame
                return found


def test_the_imu_feels_what_the_car_does(world: Any) -> None:
    car = spawn(world, 0.0, 0.0, 90.0)
    sensors = [
        Listener(world, car, "sensor.other.imu", where)
        for where in (at(0.45), at(-0.55), at(0.45, yaw=90.0))
    ]
    car.apply_control(carla.VehicleControl(throttle=0.7, steer=0.3))
    for _ in range(40):
        world.tick()
    frame = world.tick()
    felt = [sensor.at_frame(frame) for sensor in sensors]
    snapshot = world.get_snapshot().find(car.id)
    yaw = math.radians(snapshot.get_transform().rotation.yaw)
    a = snapshot.get_acceleration()
    forward = math.cos(yaw) * a.x + math.sin(yaw) * a.y
    right = math.cos(yaw) * a.y - math.sin(yaw) * a.x
    rate = math.radians(snapshot.get_angular_velocity().z)
    force = felt[0].accelerometer
    assert (force.x, force.y, force.z) == pytest.approx((forward, right, 9.81), abs=1e-3)
    assert right > 1.0
    assert felt[0].gyroscope.z == pytest.approx(rate, abs=1e-4)
    assert felt[0].compass == pytest.approx((yaw + 0.5 * math.pi) % math.tau, abs=1e-4)
    # One metre behind, the centripetal acceleration pulls forward.
    assert felt[1].accelerometer.x - force.x == pytest.approx(rate * rate, abs=1e-3)
    assert (felt[2].accelerometer.x, felt[2].accelerometer.y) == pytest.approx(
        (right, -forward), abs=1e-3
    )


def test_the_imu_has_the_noise_and_the_period_of_its_blueprint(world: Any) -> None:
    car = spawn(world)
    listener = Listener(
        world,
        car,
        "sensor.other.imu",
        at(0.45),
        sensor_tick="0.1",
        noise_accel_stddev_z="0.5",
        noise_gyro_bias_x="0.25",
        noise_seed="3",
    )
    for _ in range(100):
        world.tick()
    felt = [listener.data.get(timeout=PATIENCE) for _ in range(50)]
    assert {b.frame - a.frame for a, b in pairwise(felt)} == {2}
    heave = [found.accelerometer.z - 9.81 for found in felt]
    assert 0.3 < math.sqrt(sum(h * h for h in heave) / len(heave)) < 0.7
    assert all(found.gyroscope.x == pytest.approx(0.25) for found in felt)


def test_a_collision_is_reported_to_both(world: Any) -> None:
    one, other = spawn(world, 0.0, 0.0), spawn(world, 10.0, 0.0, 180.0)
    first = Listener(world, one, "sensor.other.collision", at(0.0))
    second = Listener(world, other, "sensor.other.collision", at(0.0))
    world.tick()
    assert first.data.empty()
    one.set_target_velocity(carla.Vector3D(x=10.0))
    for _ in range(20):
        world.tick()
    hit, back = (listener.data.get(timeout=PATIENCE) for listener in (first, second))
    assert (hit.actor.id, hit.other_actor.id) == (one.id, other.id)
    assert (back.actor.id, back.other_actor.id) == (other.id, one.id)
    # Half of the mass at six to ten metres per second, against the motion.
    assert -0.5 * 1845 * 10.5 < hit.normal_impulse.x < -0.5 * 1845 * 6.0
    assert back.normal_impulse.x > 0.0


def test_a_sensor_that_stops_listening_hears_no_more(world: Any) -> None:
    car = spawn(world)
    listener = Listener(world, car, "sensor.other.imu", at(0.0))
    listener.at_frame(world.tick())
    listener.sensor.stop()
    other = Listener(world, car, "sensor.other.imu", at(0.0))
    other.at_frame(world.tick())
    assert listener.data.empty()


def test_a_sensor_outlives_its_car(world: Any) -> None:
    car = spawn(world, 7.0)
    listener = Listener(world, car, "sensor.other.imu", at(1.0))
    world.tick()
    assert listener.sensor.parent.id == car.id
    assert car.destroy()
    world.tick()
    assert world.get_snapshot().has_actor(listener.sensor.id)
    assert listener.sensor.get_transform().location.x == pytest.approx(8.0)
    assert listener.sensor.destroy()


@pytest.mark.parametrize("value", ["nan", "-1"])
def test_a_sensor_with_an_impossible_period_is_refused(world: Any, value: str) -> None:
    car = spawn(world)
    with pytest.raises(RuntimeError, match=r"stand-in: .*sensor_tick"):
        Listener(world, car, "sensor.other.imu", at(0.0), sensor_tick=value)


@pytest.mark.parametrize(
    "reference", ["", "+proj=tmerc +lat_0=49 +lon_0=-8.5", "+proj=utm +zone=32 +lat_0=-35.25"]
)
def test_gnss_says_what_the_client_makes_of_the_map(
    server: Serving, client: Any, reference: str
) -> None:
    header = f'<header revMajor="1" revMinor="4"><geoReference>{reference}</geoReference></header>'
    text = ROAD.replace('<header revMajor="1" revMinor="4"/>', header)
    another_world(server, text)
    world = synchronous(client.get_world())
    car = spawn(world, 1000.0, -2000.0, 90.0)
    on_car = Listener(world, car, "sensor.other.gnss", at(1.5, z=2.0))
    alone = Listener(world, None, "sensor.other.gnss", at(-300.0, 40.0, z=7.0))
    frame = world.tick()
    for listener, where in ((on_car, (1000.0, -1998.5, 2.0)), (alone, (-300.0, 40.0, 7.0))):
        found = listener.at_frame(frame)
        true = world.get_map().transform_to_geolocation(carla.Location(*where))
        assert (found.latitude, found.longitude) == pytest.approx(
            (true.latitude, true.longitude), abs=2e-9
        )
        assert found.altitude == pytest.approx(where[2])


def test_gnss_has_the_noise_of_its_blueprint(world: Any) -> None:
    bias = {"noise_lat_bias": "0.5", "noise_alt_bias": "-3", "noise_lon_stddev": "0.1"}
    listener = Listener(world, None, "sensor.other.gnss", at(0.0), **bias)
    for _ in range(40):
        world.tick()
    seen = [listener.data.get(timeout=PATIENCE) for _ in range(40)]
    assert all((m.latitude, m.altitude) == pytest.approx((42.5, -3.0)) for m in seen)
    spread = math.sqrt(sum((m.longitude - 2.0) ** 2 for m in seen) / len(seen))
    assert 0.05 < spread < 0.2


def test_an_imu_by_itself_is_at_rest(world: Any) -> None:
    listener = Listener(world, None, "sensor.other.imu", at(5.0, 5.0, 30.0))
    felt = listener.at_frame(world.tick())
    force, turning = felt.accelerometer, felt.gyroscope
    assert (force.x, force.y, force.z) == pytest.approx((0.0, 0.0, 9.81), abs=1e-5)
    assert (turning.x, turning.y, turning.z) == (0.0, 0.0, 0.0)
    assert felt.compass == pytest.approx(math.radians(120.0), abs=1e-5)


@pytest.mark.parametrize("kind", ["collision", "lane_invasion"])
def test_what_is_about_a_car_needs_one(world: Any, kind: str) -> None:
    with pytest.raises(RuntimeError, match="has to be attached to a vehicle"):
        Listener(world, None, f"sensor.other.{kind}", at(0.0))


def test_a_car_that_leaves_its_lane_is_told(world: Any) -> None:
    car = spawn(world, 20.0, 1.75, -20.0)
    listener = Listener(world, car, "sensor.other.lane_invasion", at(0.0))
    car.set_target_velocity(carla.Vector3D(x=9.4, y=-3.4))
    for _ in range(14):
        world.tick()
    event = listener.data.get(timeout=PATIENCE)
    assert [str(mark.type) for mark in event.crossed_lane_markings] == ["Broken"]
    assert listener.sensor.destroy()


def test_lane_invasions_need_marks(server: Serving, client: Any) -> None:
    """The client's program would end where a lane has none."""
    another_world(server, ROAD)
    world = synchronous(client.get_world())
    car = spawn(world)
    with pytest.raises(RuntimeError, match="needs a roadMark at the beginning of every lane"):
        Listener(world, car, "sensor.other.lane_invasion", at(0.0))
