"""Episodes as MCAP, read back by ourselves and by others' libraries."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from steersman.episode import COLUMNS, Episode
from steersman.errors import DataError
from steersman.kernels import vehicle as car
from steersman.logs import read, schemas
from steersman.logs.restore import read_episode
from steersman.logs.write import PATH_SPACING, wheel_angles, write_episode
from steersman.types import Driver, Reason, Status

from .conftest import RUN

NS = 10**9


def by_mcap(file: FilePath) -> dict[str, list[tuple[int, Any]]]:
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found: dict[str, list[tuple[int, Any]]] = {}
        for _, channel, message, content in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def by_rosbags(file: FilePath) -> dict[str, list[tuple[int, Any]]]:
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([file]) as reader:
        for connection, ns, raw in reader.messages():
            told = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((ns, told))
    return found


@pytest.mark.parametrize("library", [by_mcap, by_rosbags])
def test_others_read_what_was_driven(episode: Episode, recording: FilePath, library: Any) -> None:
    found = library(recording)
    assert set(found) == set(schemas.TYPES)
    count = len(episode)
    assert [len(found[topic]) for topic in schemas.TYPES] == [1, *[count] * 4, 1]
    for k in (0, 1, 17, count - 1):
        now, told = found[schemas.ODOMETRY][k]
        assert now == schemas.EPOCH * NS + round(float(episode["time"][k]) * 1e9)
        assert told.header.stamp.sec * NS + told.header.stamp.nanosec == now
        assert (told.header.frame_id, told.child_frame_id) == ("map", "base_link")
        place, turn, twist = told.pose.pose.position, told.pose.pose.orientation, told.twist.twist
        assert (place.x, place.y, place.z) == (episode["x"][k], episode["y"][k], 0.0)
        assert math.hypot(turn.z, turn.w) == pytest.approx(1.0, abs=1e-15)
        yaw = 2.0 * math.atan2(turn.z, turn.w)
        assert math.remainder(yaw - episode["psi"][k], math.tau) == pytest.approx(0.0, abs=1e-14)
        assert (twist.linear.x, twist.linear.y) == (episode["v_x"][k], episode["v_y"][k])
        assert twist.angular.z == episode["yaw_rate"][k]
        (there,) = found[schemas.TF][k][1].transforms
        assert (there.header.frame_id, there.child_frame_id) == ("map", "base_link")
        assert (there.transform.translation.x, there.transform.rotation.w) == (place.x, turn.w)
        told = found[schemas.DIAGNOSTICS][k][1]
        for name in schemas.DIAGNOSTIC_FIELDS:
            assert getattr(told, name) == episode[name][k], name


def test_the_constants_of_the_diagnostics_name_the_numbers(recording: FilePath) -> None:
    told = by_rosbags(recording)[schemas.DIAGNOSTICS][0][1]
    assert told.STATUS_FALLBACK == Status.FALLBACK
    assert told.DRIVER_HOLD == Driver.HOLD
    assert told.REASON_OSCILLATION == Reason.OSCILLATION


def test_schemas_name_units(recording: FilePath) -> None:
    with recording.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    told = {schema.name: schema for schema in summary.schemas.values()}
    assert set(told) == set(schemas.TYPES.values())
    assert {schema.encoding for schema in told.values()} == {"ros2msg"}
    assert "float64 a_y  # [m/s^2]" in told[schemas.DIAGNOSTICS_TYPE].data.decode()


def test_the_command_is_a_wheel_angle_to_the_left(episode: Episode, recording: FilePath) -> None:
    told = [m.steering_tire_angle for _, m in by_mcap(recording)[schemas.LATERAL]]
    assert told == pytest.approx(wheel_angles(episode, RUN.vehicle.table), rel=1e-7)
    # A left turn: the angle is about L / R of the single-track model, whatever the misalignment.
    assert np.median(told) == pytest.approx(RUN.vehicle.wheelbase / 50.0, rel=0.4)
    straight = replace(episode, columns={**episode.columns, "steer_command": episode["steer"]})
    offset = np.tan(episode["wheel_angle"]) - np.tan(wheel_angles(straight, RUN.vehicle.table))
    assert offset[5:] == pytest.approx(math.tan(0.01), rel=0.05)  # what the misalignment adds


def test_path_topic_holds_the_path(recording: FilePath) -> None:
    ((_, told),) = by_mcap(recording)[schemas.PATH]
    points = [(p.pose.position.x, p.pose.position.y) for p in told.poses]
    assert points[0] == points[-1]
    gaps = [math.dist(a, b) for a, b in pairwise(points)]
    assert min(gaps) > 0.9 * PATH_SPACING
    assert max(gaps) <= PATH_SPACING
    for x, y in points:
        assert RUN.path.project(x, y)[1] == pytest.approx(0.0, abs=1e-9)


def test_markers_show_the_path_and_the_outline_of_the_car(recording: FilePath) -> None:
    ((_, told),) = by_mcap(recording)[schemas.MARKERS]
    road, outline = told.markers
    ((_, path),) = by_mcap(recording)[schemas.PATH]
    assert [(p.x, p.y) for p in road.points] == [
        (p.pose.position.x, p.pose.position.y) for p in path.poses
    ]
    assert (road.header.frame_id, outline.header.frame_id) == ("map", "base_link")
    assert outline.frame_locked
    assert outline.points[0] == outline.points[-1]
    x, y = ([getattr(p, axis) for p in outline.points] for axis in "xy")
    car = RUN.vehicle
    assert max(y) - min(y) == pytest.approx(car.width)
    assert max(x) - min(x) == pytest.approx(car.body_length)
    assert max(x) + min(x) == pytest.approx(car.l_f - car.l_r)


def test_reading_gives_the_columns_back(episode: Episode, recording: FilePath) -> None:
    log = read(recording)
    pairs = {
        "x": "x",
        "y": "y",
        "v_x": "v_x",
        "v_y": "v_y",
        "yaw_rate": "yaw_rate",
        "angle": "wheel_angle",
        "steer_command": "steer_command",
        "steer": "steer",
        "throttle": "throttle",
        "brake": "brake",
    }
    for ours, theirs in pairs.items():
        assert np.array_equal(log[ours], episode[theirs]), ours
    assert log["time"] == pytest.approx(episode["time"], abs=1e-9)
    turns = (log["yaw"] - episode["psi"]) / math.tau
    assert turns == pytest.approx(np.full(len(log), round(turns[0])), abs=1e-14)
    assert log["speed"] == pytest.approx(np.hypot(episode["v_x"], episode["v_y"]))
    assert log["angle_command"] == pytest.approx(wheel_angles(episode, RUN.vehicle.table), rel=1e-7)
    assert log.start == schemas.EPOCH * NS


def test_an_episode_comes_back(episode: Episode, recording: FilePath) -> None:
    again = read_episode(recording)
    for name in COLUMNS:
        if name != "time":
            assert np.array_equal(again[name], episode[name]), name
    assert again["time"] == pytest.approx(episode["time"], abs=0.5e-9)
    for name in ("end", "distance", "dt", "path_length", "closed", "meta"):
        assert getattr(again, name) == getattr(episode, name)
    # Written again it is the same file.
    other = recording.with_name("again.mcap")
    car = RUN.vehicle
    write_episode(other, again, car.table, RUN.path, (car.body_length, car.width))
    assert other.read_bytes() == recording.read_bytes()


def test_without_a_path_there_are_the_points_beside_the_car(
    episode: Episode, tmp_path: FilePath
) -> None:
    write_episode(tmp_path / "run.mcap", episode, RUN.vehicle.table)
    ((_, told),) = by_mcap(tmp_path / "run.mcap")[schemas.PATH]
    x = [p.pose.position.x for p in told.poses]
    assert x == episode["path_x"].tolist()
    yaw = [2.0 * math.atan2(p.pose.orientation.z, p.pose.orientation.w) for p in told.poses]
    assert np.cos(yaw) == pytest.approx(np.cos(episode["psi"] - episode["heading_error"]))


def test_steering_and_wheel_angle_are_one(episode: Episode) -> None:
    angles = wheel_angles(episode, RUN.vehicle.table)
    speeds = np.abs(episode["v_x"])
    bias = RUN.vehicle.row()[car.STEER_BIAS]
    back = [
        RUN.vehicle.steer_for_wheel_angle(a, v) + bias
        for a, v in zip(angles.tolist(), speeds.tolist(), strict=True)
    ]
    assert back == pytest.approx(episode["steer_command"], abs=1e-12)


@pytest.mark.parametrize("rows", [0, 1])
def test_the_shortest_episodes(episode: Episode, tmp_path: FilePath, rows: int) -> None:
    short = replace(episode, columns={k: v[:rows] for k, v in episode.columns.items()})
    write_episode(tmp_path / "run.mcap", short, RUN.vehicle.table, RUN.path)
    if rows:
        assert len(read_episode(tmp_path / "run.mcap")) == rows
        assert len(read(tmp_path / "run.mcap")) == rows
    else:
        with pytest.raises(DataError, match="topic /steersman/odometry holds no message"):
            read(tmp_path / "run.mcap")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("status", 0.5, "status is no whole number"),
        ("reason", 256.0, "reason is no whole number"),
        ("driver", math.nan, "driver is no whole number"),
        ("time", math.inf, "times are not finite"),
    ],
)
def test_what_no_run_makes_is_not_written(
    episode: Episode, tmp_path: FilePath, name: str, value: float, words: str
) -> None:
    bad = episode[name].copy()
    bad[3] = value
    odd = replace(episode, columns={**episode.columns, name: bad})
    with pytest.raises(DataError, match=words):
        write_episode(tmp_path / "run.mcap", odd, RUN.vehicle.table)
    assert not any(tmp_path.iterdir())
