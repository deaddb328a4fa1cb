"""The sensors' streams through the real client."""

from __future__ import annotations

import math
import queue
from itertools import pairwise
from typing import Any

import pytest

from .serving import PATIENCE, at, spawn

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
