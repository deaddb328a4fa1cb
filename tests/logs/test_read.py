"""Recordings of others: their formats, stamps and rates, and what is wrong with them."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path as FilePath
from typing import Any

import mcap.writer
import numpy as np
import pytest

from steersman.errors import DataError
from steersman.files import read_bytes
from steersman.logs import read, schemas

from . import bags

SECOND = 10**9
T0 = 10**18


def refused(file: FilePath, **given: Any) -> str:
    with pytest.raises(DataError) as caught:
        read(file, **given)
    text = str(caught.value)
    assert "\n" not in text
    assert str(file) in text
    return text


@pytest.mark.parametrize("kind", bags.FORMATS)
def test_every_format(tmp_path: FilePath, kind: str) -> None:
    log = read(bags.write(tmp_path, bags.drive(), kind))
    assert list(log.columns) == ["time", "x", "y", "yaw", "v_x", "v_y", "speed", "yaw_rate"]
    assert log["time"] == pytest.approx(0.05 * np.arange(50), abs=1e-9)
    assert log["yaw"] == pytest.approx(0.01 * np.arange(50))
    assert log["x"] == pytest.approx(40.0 * np.sin(0.01 * np.arange(50)))
    assert (log["speed"][0], log["yaw_rate"][0]) == (8.0, 0.2)
    assert (dict(log.topics), log.start) == ({"odometry": "/odom"}, T0)
    assert "angle" not in log


def test_yaw_goes_on_beyond_a_half_turn(tmp_path: FilePath) -> None:
    log = read(bags.write(tmp_path, bags.drive(700, speed=40.0)))
    assert log["yaw"] == pytest.approx(0.05 * np.arange(700))


def test_the_rear_axle_moved_to_the_centre_of_mass(tmp_path: FilePath) -> None:
    file = bags.write(tmp_path, bags.drive())
    rear, ahead = read(file), read(file, ahead=1.5)
    # On the tangent of the rear axle's circle, and carried around with it.
    assert np.hypot(ahead["x"], ahead["y"] - 40.0) == pytest.approx(
        np.full(50, math.hypot(40, 1.5))
    )
    assert ahead["v_y"] == pytest.approx(rear["v_y"] + 1.5 * 0.2)
    assert ahead["speed"] == pytest.approx(np.full(50, 0.2 * math.hypot(40, 1.5)))
    assert ahead["yaw"] == pytest.approx(rear["yaw"])


def command(name: str, ns: int, angle: float) -> bags.Sent:
    if name == schemas.LATERAL_TYPE:
        return ("/cmd", name, ns, bags.lateral(ns, angle))
    return ("/cmd", name, ns, bags.control(ns, angle))


@pytest.mark.parametrize("name", [schemas.LATERAL_TYPE, schemas.CONTROL_TYPE])
def test_commands_are_held_and_angles_interpolated(tmp_path: FilePath, name: str) -> None:
    messages = bags.drive(9)  # 0 to 0.4 s
    messages += [command(name, T0 + at, u) for at, u in ((SECOND // 10, 0.1), (SECOND // 4, -0.2))]
    kind = schemas.STEERING_REPORT_TYPE
    messages += [
        ("/wheel", kind, T0, bags.report(T0, 0.0)),
        ("/wheel", kind, T0 + 2 * SECOND // 5, bags.report(T0 + 2 * SECOND // 5, 0.4)),
    ]
    log = read(bags.write(tmp_path, messages))
    commands = [math.nan, math.nan, 0.1, 0.1, 0.1, -0.2, -0.2, -0.2, -0.2]
    assert log["angle_command"] == pytest.approx(commands, nan_ok=True)
    assert log["angle"] == pytest.approx(0.05 * np.arange(9), abs=1e-6)
    assert dict(log.topics) == {"odometry": "/odom", "command": "/cmd", "angle": "/wheel"}


def test_without_stamps_the_time_of_logging_counts(tmp_path: FilePath) -> None:
    log = read(bags.write(tmp_path, bags.drive()))
    messages = [
        (topic, kind, ns, bags.odometry(0, *_place(told))) for topic, kind, ns, told in bags.drive()
    ]
    (tmp_path / "plain").mkdir()
    plain = read(bags.write(tmp_path / "plain", messages))
    assert plain["time"] == pytest.approx(log["time"], abs=1e-9)
    assert plain.start == T0 + 1_000_000


def _place(told: Any) -> tuple[float, float, float, float]:
    p, q = told.pose.pose.position, told.pose.pose.orientation
    return p.x, p.y, 2.0 * math.atan2(q.z, q.w), told.twist.twist.linear.x


def test_messages_out_of_order_and_twice(tmp_path: FilePath) -> None:
    messages = bags.drive(20)
    log = read(bags.write(tmp_path, [*messages[10:], *messages[:12]]))
    assert log["time"] == pytest.approx(0.05 * np.arange(20), abs=1e-9)
    assert log["yaw"] == pytest.approx(0.01 * np.arange(20))


def test_of_several_topics_one_is_named(tmp_path: FilePath) -> None:
    other = [("/gps", kind, ns, told) for _, kind, ns, told in bags.drive(5)]
    file = bags.write(tmp_path, bags.drive() + other)
    assert len(read(file, odometry="/gps")) == 5
    assert "several topics hold nav_msgs/msg/Odometry: /gps, /odom; name one" in refused(file)
    assert "no topic '/gsp'; did you mean '/gps'?" in refused(file, odometry="/gsp")
    assert "; its topics: /gps (nav_msgs/msg/Odometry), /odom (" in refused(file, odometry="/x")
    wrong = refused(file, odometry="/gps", command="/odom")
    assert "topic /odom holds nav_msgs/msg/Odometry, expected autoware_control_msgs" in wrong


def test_a_topic_without_messages_is_none(tmp_path: FilePath) -> None:
    with bags.Writer(tmp_path / "bag", version=9, storage_plugin=bags.StoragePlugin.MCAP) as writer:
        odometry = writer.add_connection("/odom", schemas.ODOMETRY_TYPE, typestore=bags.STORE)
        writer.add_connection("/cmd", schemas.LATERAL_TYPE, typestore=bags.STORE)
        for _, kind, ns, told in bags.drive(5):
            writer.write(odometry, ns, bags.STORE.serialize_cdr(told, kind))
    log = read(tmp_path / "bag")
    assert dict(log.topics) == {"odometry": "/odom"}
    assert "angle_command" not in log


def test_a_recording_of_something_else(tmp_path: FilePath) -> None:
    path = ("/plan", schemas.PATH_TYPE, T0, bags.path(T0, [(0.0, 0.0), (1.0, 0.0)]))
    assert "holds no nav_msgs/msg/Odometry; its topics: /plan (nav_msgs/msg/Path)" in refused(
        bags.write(tmp_path, [path])
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"x": math.nan}, "/odom: message 3 holds numbers that no car has"),
        ({"x": 1e9}, "/odom: message 3 holds numbers that no car has"),
        ({"speed": math.inf}, "/odom: message 3 holds numbers that no car has"),
        ({"scale": 0.0}, "/odom: message 3 has the orientation [0. 0. 0. 0.], which is no unit"),
        ({"scale": 2.0}, "which is no unit quaternion"),
    ],
)
def test_numbers_that_no_car_has(tmp_path: FilePath, change: Any, words: str) -> None:
    messages = bags.drive(5)
    fields = {"x": 0.0, "y": 0.0, "yaw": 0.0, "speed": 1.0} | change
    messages[2] = (*messages[2][:3], bags.odometry(T0 + 2 * 50_000_000, **fields))
    assert words in refused(bags.write(tmp_path, messages))


def test_files_that_are_no_recordings(tmp_path: FilePath) -> None:
    (tmp_path / "run.csv").write_text("x,y\n")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "text.mcap").write_text("no recording")
    (tmp_path / "text.db3").write_text("no recording")
    assert "No such file" in refused(tmp_path / "nowhere.mcap")
    assert "a folder without metadata.yaml" in refused(tmp_path)
    assert "run.csv: is no recording; expected an .mcap or .db3 file" in refused(
        tmp_path / "run.csv"
    )
    for name in ("empty.mcap", "text.mcap", "text.db3"):
        assert "it may be damaged (" in refused(tmp_path / name)
    with pytest.raises(DataError, match="is not the name of a file"):
        read(FilePath("a\0b.mcap"))


def test_recordings_of_ros_1_and_pointers_are_called_that(tmp_path: FilePath) -> None:
    (tmp_path / "one.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(64))
    with (tmp_path / "one.mcap").open("wb") as stream:
        writer = mcap.writer.Writer(stream)
        writer.start(profile="ros1", library="x")
        writer.finish()  # type: ignore[no-untyped-call]
    for name in ("one.bag", "one.mcap"):
        assert "is a recording of ROS 1; 'rosbags-convert --src" in refused(tmp_path / name)
    for name in ("far.mcap", "far.csv", "far.onnx"):
        file = tmp_path / name
        file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1234\n")
        with pytest.raises(DataError, match="is a pointer of Git LFS; 'git lfs pull' fetches"):
            read(file)
        with pytest.raises(DataError, match="is a pointer of Git LFS"):
            read_bytes(file, "", 1000)


@pytest.mark.parametrize("kind", ["folder-mcap", "folder-db3"])
def test_damaged_bag_folders(tmp_path: FilePath, kind: str) -> None:
    folder = bags.write(tmp_path, bags.drive(5), kind)
    text = (folder / "metadata.yaml").read_text()
    for change in ("", "{", "- 1", re.sub("version: 9", "version: 99", text), text[:150]):
        (folder / "metadata.yaml").write_text(change)
        assert "it may be damaged (" in refused(folder)
    (folder / "metadata.yaml").write_text(text)
    next(path for path in folder.iterdir() if path.suffix in {".mcap", ".db3"}).unlink()
    assert "it may be damaged (Some database files are missing" in refused(folder)
    shutil.rmtree(folder)
    assert "No such file" in refused(folder)
