"""Cameras, lidars and the radar through the real client: they see nothing; all else is right."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from .serving import PATIENCE, at, spawn
from .test_sensors import Listener

carla = pytest.importorskip("carla", reason="the wheel 'carla' is not installed")


@pytest.mark.parametrize(
    ("kind", "pixel"),
    [
        ("rgb", (0, 0, 0, 255)),
        ("depth", (255, 255, 255, 255)),
        ("normals", (0, 0, 0, 255)),
        ("semantic_segmentation", (0, 0, 0, 255)),
        ("instance_segmentation", (0, 0, 0, 255)),
        ("cosmos_visualization", (0, 0, 0, 255)),
    ],
)
def test_an_image_shows_nothing_and_is_of_the_right_size(
    world: Any, kind: str, pixel: tuple[int, ...]
) -> None:
    car = spawn(world, 10.0, -20.0, 90.0)
    size = {"image_size_x": "40", "image_size_y": "30", "fov": "105"}
    listener = Listener(world, car, f"sensor.camera.{kind}", at(1.5, 0.5, 30.0, 2.4), **size)
    car.set_target_velocity(carla.Vector3D(y=10.0))
    frame = world.tick()
    image = listener.at_frame(frame)
    assert (image.width, image.height, image.fov) == (40, 30, 105.0)
    assert image.timestamp == pytest.approx(world.get_snapshot().timestamp.elapsed_seconds)
    pixels = np.frombuffer(image.raw_data, np.uint8).reshape(30, 40, 4)
    assert (pixels == pixel).all()
    # Its place is that on the car of this frame: ahead is y, right is -x.
    where, base = image.transform, world.get_snapshot().find(car.id).get_transform().location
    assert (where.location.x, where.location.y) == pytest.approx((base.x - 0.5, base.y + 1.5))
    assert (where.location.z, where.rotation.yaw) == pytest.approx((2.4, 120.0))
    assert "frames" in listener.sensor.attributes["stand_in"]
    image.convert(carla.ColorConverter.Depth if kind == "depth" else carla.ColorConverter.Raw)


def test_a_camera_sends_full_frames_at_its_period(world: Any) -> None:
    """As large as users have them, and from the very first tick after ``listen``."""
    listener = Listener(
        world, None, "sensor.camera.rgb", at(0.0), image_size_x="1920", image_size_y="1080",
        sensor_tick="0.1",
    )  # fmt: skip
    seen = []
    for _ in range(3):
        world.tick()
        seen.append(listener.data.get(timeout=PATIENCE))
        world.tick()
    assert [image.frame - seen[0].frame for image in seen] == [0, 2, 4]
    assert {len(image.raw_data) for image in seen} == {1920 * 1080 * 4}
    assert listener.data.empty()


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        ("camera.rgb", {"image_size_x": "0"}, "image_size_x 0"),
        ("camera.rgb", {"image_size_x": "4096", "image_size_y": "4096"}, "4096 x 4096"),
        ("camera.depth", {"fov": "nan"}, "fov"),
        ("lidar.ray_cast", {"channels": "100000"}, "channels"),
    ],
)
def test_an_impossible_view_is_refused(
    world: Any, kind: str, changes: dict[str, str], message: str
) -> None:
    with pytest.raises(RuntimeError, match=rf"stand-in: .*{message}"):
        Listener(world, None, f"sensor.{kind}", at(0.0), **changes)


@pytest.mark.parametrize("kind", ["ray_cast", "ray_cast_semantic"])
def test_a_lidar_turns_and_finds_no_points(world: Any, kind: str) -> None:
    car = spawn(world)
    turning = {"channels": "16", "rotation_frequency": "4"}
    listener = Listener(world, car, f"sensor.lidar.{kind}", at(0.0, z=2.0), **turning)
    angles = []
    for _ in range(8):
        found = listener.at_frame(world.tick())
        assert (found.channels, len(found), len(found.raw_data)) == (16, 0, 0)
        assert [found.get_point_count(i) for i in range(16)] == [0] * 16
        angles.append(found.horizontal_angle)
    assert np.unwrap(angles) - angles[0] == pytest.approx(
        4 * math.tau * 0.05 * np.arange(8), abs=1e-4
    )
    assert listener.sensor.attributes["stand_in"] == "no points"


@pytest.mark.parametrize("kind", ["camera.dvs", "camera.optical_flow", "other.radar"])
def test_what_else_sees_nothing(world: Any, kind: str) -> None:
    listener = Listener(world, spawn(world), f"sensor.{kind}", at(0.0))
    found = listener.at_frame(world.tick())
    if kind == "camera.optical_flow":
        assert (np.frombuffer(found.raw_data, np.float32) == 0.0).all()
    else:
        assert len(found) == 0


def test_no_image_is_made_that_is_not_listened_to(world: Any) -> None:
    listener = Listener(world, None, "sensor.camera.rgb", at(0.0))
    listener.at_frame(world.tick())
    listener.sensor.stop()
    for _ in range(20):
        world.tick()
    assert listener.data.empty()
