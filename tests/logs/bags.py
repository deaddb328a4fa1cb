"""Recordings as other programs make them, written with ``rosbags``."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from steersman.logs import schemas

STORE = schemas.typestore()
FORMATS = ("mcap", "db3", "folder-mcap", "folder-db3")
Sent = tuple[str, str, int, Any]
"""Topic, type, time of logging [ns], message."""


def new(kind: str, *fields: Any) -> Any:
    return STORE.types[kind](*fields)


def stamp(ns: int) -> Any:
    return new("builtin_interfaces/msg/Time", ns // 10**9, ns % 10**9)


def header(ns: int) -> Any:
    return new("std_msgs/msg/Header", stamp(ns), "map")


def pose(x: float, y: float, yaw: float, scale: float = 1.0) -> Any:
    turn = (0.0, 0.0, scale * math.sin(yaw / 2.0), scale * math.cos(yaw / 2.0))
    return new(
        "geometry_msgs/msg/Pose",
        new("geometry_msgs/msg/Point", x, y, 3.0),
        new("geometry_msgs/msg/Quaternion", *turn),
    )


def odometry(
    ns: int, x: float, y: float, yaw: float, speed: float, rate: float = 0.0, scale: float = 1.0
) -> Any:
    twist = new(
        "geometry_msgs/msg/Twist",
        new("geometry_msgs/msg/Vector3", speed, 0.0, 0.0),
        new("geometry_msgs/msg/Vector3", 0.0, 0.0, rate),
    )
    return new(
        schemas.ODOMETRY_TYPE,
        header(ns),
        "base_link",
        new("geometry_msgs/msg/PoseWithCovariance", pose(x, y, yaw, scale), np.zeros(36)),
        new("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
    )


def path(ns: int, points: Iterable[tuple[float, float]]) -> Any:
    poses = [new("geometry_msgs/msg/PoseStamped", header(ns), pose(x, y, 0.0)) for x, y in points]
    return new(schemas.PATH_TYPE, header(ns), poses)


def posed(ns: int, x: float, y: float, *, spread: bool = False) -> Any:
    """A pose alone, with its covariance or without."""
    there = pose(x, y, 0.0)
    if not spread:
        return new(schemas.POSE_TYPES[0], header(ns), there)
    wide = new("geometry_msgs/msg/PoseWithCovariance", there, np.zeros(36))
    return new(schemas.POSE_TYPES[1], header(ns), wide)


def trajectory(ns: int, points: Iterable[tuple[float, float]]) -> Any:
    none = new("builtin_interfaces/msg/Duration", 0, 0)
    kind = "autoware_planning_msgs/msg/TrajectoryPoint"
    rows = [new(kind, none, pose(x, y, 0.0), *[0.0] * 6) for x, y in points]
    return new(schemas.TRAJECTORY_TYPE, header(ns), rows)


def lateral(ns: int, angle: float) -> Any:
    return new(schemas.LATERAL_TYPE, stamp(ns), stamp(ns), angle, 0.0, False)


def control(ns: int, angle: float) -> Any:
    rest = new(
        "autoware_control_msgs/msg/Longitudinal", stamp(ns), stamp(ns), 1.0, 0.0, 0.0, False, False
    )
    return new(schemas.CONTROL_TYPE, stamp(ns), stamp(ns), lateral(ns, angle), rest)


def report(ns: int, angle: float) -> Any:
    return new(schemas.STEERING_REPORT_TYPE, stamp(ns), angle)


def write(folder: FilePath, messages: Iterable[Sent], kind: str = "mcap") -> FilePath:
    """Write a recording; its format is one of ``FORMATS``."""
    plugin = StoragePlugin.MCAP if kind.endswith("mcap") else StoragePlugin.SQLITE3
    place = folder / kind
    with Writer(place, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, name, ns, content in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=STORE)
            writer.write(connections[topic], ns, STORE.serialize_cdr(content, name))
    if kind.startswith("folder"):
        return place
    return next(place.glob(f"*.{kind}"))


def drive(count: int = 50, *, radius: float = 40.0, speed: float = 8.0) -> list[Sent]:
    """The Odometry of a circle to the left at 20 Hz."""
    out = []
    for k in range(count):
        ns, angle = 10**18 + k * 50_000_000, k * 0.05 * speed / radius
        x, y = radius * math.sin(angle), radius * (1.0 - math.cos(angle))
        told = odometry(ns, x, y, angle, speed, speed / radius)
        out.append(("/odom", schemas.ODOMETRY_TYPE, ns + 1_000_000, told))
    return out
