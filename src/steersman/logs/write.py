"""An episode as an MCAP file that ROS 2's tools, Foxglove and ``rosbags`` read; docs/logs.md."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from steersman.episode import Episode
from steersman.errors import DataError
from steersman.files import replacing
from steersman.kernels import vehicle as car
from steersman.kernels.vehicle import VehicleTable
from steersman.logs import schemas
from steersman.protocols import Path
from steersman.types import FloatArray

if TYPE_CHECKING:
    from mcap.writer import Writer
    from rosbags.typesys.store import Typestore

PATH_SPACING = 1.0
"""Distance between the poses of the path topic, at most [m]."""
_NS = 1_000_000_000
_LONGEST, _LARGEST = 1e8, 255.0
# Width of a marker's line [m], and its colour: red, green, blue, opacity.
_LINE, _COLOUR = 0.1, (0.1, 0.5, 0.9, 1.0)


class _Sent(NamedTuple):
    topic: str
    time: int
    """[ns] of Unix time."""
    content: Any


def require() -> None:
    """Check before a drive that its recording can be written.

    Raises:
        ModuleNotFoundError: the extra ``logs`` is not installed.
    """
    import mcap.writer  # noqa: F401
    import rosbags.typesys  # noqa: F401


def write_episode(
    file: FilePath,
    episode: Episode,
    vehicle: VehicleTable,
    path: Path | None = None,
    body: tuple[float, float] | None = None,
) -> None:
    """Write an episode, replacing the file only when complete.

    The same episode gives the same bytes. Odometry holds position and velocity of the centre of
    mass, Lateral the commanded wheel angle (single-track, left positive) in single precision, the
    diagnostics every other column. ``fine`` is not written. For viewers there are the transform
    from map to base_link, and markers of the path and of the car's outline.

    Args:
        file: the file to write, usually ``*.mcap``.
        episode: the run.
        vehicle: the vehicle that was driven; it says which wheel angle a steering command means.
        path: what was followed; None: the points beside the car, as far as they were driven.
        body: length and width of the car's outline [m]; None: guessed from its axles.

    Raises:
        DataError: the file cannot be written, or the episode holds what no run makes.
        ModuleNotFoundError: the extra ``logs`` is not installed.
    """
    from mcap.writer import Writer

    _check(file, episode)
    store = schemas.typestore()
    road = _beside(episode) if path is None else sampled(path)
    with replacing(file) as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library=f"steersman {version('steersman')}")
        channels = {topic: _channel(writer, store, topic) for topic in schemas.TYPES}
        sequence = dict.fromkeys(schemas.TYPES, 0)
        outline = _outline(vehicle, body)
        for sent in _messages(store, episode, wheel_angles(episode, vehicle), road, outline):
            data = bytes(store.serialize_cdr(sent.content, schemas.TYPES[sent.topic]))
            writer.add_message(
                channels[sent.topic], sent.time, data, sent.time, sequence[sent.topic]
            )
            sequence[sent.topic] += 1
        writer.add_metadata(schemas.METADATA, _metadata(episode))
        writer.finish()  # type: ignore[no-untyped-call]


def _check(file: FilePath, episode: Episode) -> None:
    """Refuse what messages cannot hold: times and states that are not finite."""
    time = episode["time"]
    if not (np.all(np.isfinite(time)) and np.all(np.abs(time) < _LONGEST)):
        raise DataError(f"{file}: cannot be written, the episode's times are not finite")
    for name in schemas.ENUMS:
        numbers = episode[name]
        if not np.all((numbers >= 0.0) & (numbers <= _LARGEST) & (numbers == np.floor(numbers))):
            raise DataError(f"{file}: cannot be written, the episode's {name} is no whole number")


def sampled(path: Path) -> FloatArray:
    """Points of a path x, y [m], psi [rad] and z [m], (n, 4); a closed one ends where it begins."""
    count, surface = max(math.ceil(path.length / PATH_SPACING), 8), path.surface()
    places = [path.length * i / count for i in range(count)]
    places.append(0.0 if path.closed else path.length)
    heights = [0.0 if surface is None else surface.at(s)[0] for s in places]
    return np.array([(*path.at(s)[:3], z) for s, z in zip(places, heights, strict=True)])


def _beside(episode: Episode) -> FloatArray:
    psi = episode["psi"] - episode["heading_error"]
    return np.stack((episode["path_x"], episode["path_y"], psi), axis=1)


def wheel_angles(episode: Episode, vehicle: VehicleTable) -> FloatArray:
    """The single-track wheel angle [rad] that each steering command means, at the speed it had.

    A misalignment of the steering is a fault of the vehicle, not part of what was commanded.
    """
    bias = float(vehicle.rows[0, car.STEER_BIAS])
    pairs = zip(episode["steer_command"].tolist(), episode["v_x"].tolist(), strict=True)
    return np.array(
        [math.atan(car.wheel_tangents(vehicle, 0, u - bias, abs(v))[2]) for u, v in pairs]
    )


def _outline(vehicle: VehicleTable, body: tuple[float, float] | None) -> FloatArray:
    """Corners of the car's outline in the frame of its centre of mass [m], (5, 2)."""
    l_f, l_r, track = (float(vehicle.rows[0, i]) for i in (car.L_F, car.L_R, car.TRACK))
    length, width = (1.5 * (l_f + l_r), 1.25 * track) if body is None else body
    signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)])
    middle = np.array([0.5 * (l_f - l_r), 0.0])
    corners: FloatArray = signs * np.array([0.5 * length, 0.5 * width]) + middle
    return corners


def nanoseconds(time: float) -> int:
    """Unix time [ns] of a simulated time [s]."""
    return schemas.EPOCH * _NS + round(time * _NS)


def _channel(writer: Writer, store: Typestore, topic: str) -> int:
    name = schemas.TYPES[topic]
    text = schemas.schema_text(store, name).encode()
    schema = writer.register_schema(name, "ros2msg", text)
    return int(writer.register_channel(topic, "cdr", schema))


def _metadata(episode: Episode) -> dict[str, str]:
    head = {name: getattr(episode, name) for name in schemas.HEAD} | {"meta": dict(episode.meta)}
    return {
        "format": "1",
        "base_link": "centre of mass",
        "time_zero": "2000-01-01T00:00:00Z",
        "episode": json.dumps(head),
    }


def _messages(
    store: Typestore, episode: Episode, angles: FloatArray, road: FloatArray, outline: FloatArray
) -> Iterator[_Sent]:
    """All messages in the order of time."""
    make = _Maker(store)
    times = [nanoseconds(t) for t in episode["time"].tolist()] or [nanoseconds(0.0)]
    yield _Sent(schemas.PATH, times[0], make.path(times[0], road))
    yield _Sent(schemas.MARKERS, times[0], make.markers(times[0], road[:, :2], outline))
    motion = [episode[name].tolist() for name in ("x", "y", "psi", "v_x", "v_y", "yaw_rate")]
    columns = {name: episode[name].tolist() for name in schemas.DIAGNOSTIC_FIELDS}
    for k in range(len(episode)):
        now = times[k]
        yield _Sent(schemas.ODOMETRY, now, make.odometry(now, *(row[k] for row in motion)))
        yield _Sent(schemas.TF, now, make.transform(now, *(row[k] for row in motion[:3])))
        yield _Sent(schemas.LATERAL, now, make.lateral(now, float(angles[k])))
        values = {name: column[k] for name, column in columns.items()}
        yield _Sent(schemas.DIAGNOSTICS, now, make.diagnostics(now, values))


class _Maker:
    """Messages from numbers."""

    def __init__(self, store: Typestore) -> None:
        self._types = store.types
        self._unknown = np.zeros(36)

    def _new(self, kind: str, *fields: Any) -> Any:
        return self._types[kind](*fields)

    def _time(self, ns: int) -> Any:
        return self._new("builtin_interfaces/msg/Time", ns // _NS, ns % _NS)

    def _header(self, ns: int) -> Any:
        return self._new("std_msgs/msg/Header", self._time(ns), schemas.MAP)

    def _pose(self, x: float, y: float, psi: float, z: float = 0.0) -> Any:
        turn = self._new(
            "geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(0.5 * psi), math.cos(0.5 * psi)
        )
        place = self._new("geometry_msgs/msg/Point", x, y, z)
        return self._new("geometry_msgs/msg/Pose", place, turn)

    def _vector(self, x: float, y: float, z: float) -> Any:
        return self._new("geometry_msgs/msg/Vector3", x, y, z)

    def path(self, ns: int, points: FloatArray) -> Any:
        header = self._header(ns)
        poses = [
            self._new("geometry_msgs/msg/PoseStamped", header, self._pose(*point))
            for point in points.tolist()
        ]
        return self._new(schemas.PATH_TYPE, header, poses)

    def odometry(
        self, ns: int, x: float, y: float, psi: float, v_x: float, v_y: float, yaw_rate: float
    ) -> Any:
        twist = self._new(
            "geometry_msgs/msg/Twist", self._vector(v_x, v_y, 0.0), self._vector(0.0, 0.0, yaw_rate)
        )
        return self._new(
            schemas.ODOMETRY_TYPE,
            self._header(ns),
            schemas.BASE_LINK,
            self._new("geometry_msgs/msg/PoseWithCovariance", self._pose(x, y, psi), self._unknown),
            self._new("geometry_msgs/msg/TwistWithCovariance", twist, self._unknown),
        )

    def transform(self, ns: int, x: float, y: float, psi: float) -> Any:
        """From map to base_link."""
        turn = self._pose(x, y, psi).orientation
        moved = self._new("geometry_msgs/msg/Transform", self._vector(x, y, 0.0), turn)
        kind = "geometry_msgs/msg/TransformStamped"
        return self._new(
            schemas.TYPES[schemas.TF],
            [self._new(kind, self._header(ns), schemas.BASE_LINK, moved)],
        )

    def markers(self, ns: int, road: FloatArray, outline: FloatArray) -> Any:
        """The path in map, and the outline, which moves with base_link."""
        lines = {"path": (schemas.MAP, road), "footprint": (schemas.BASE_LINK, outline)}
        found = []
        for name, (frame, points) in lines.items():
            marker = self._line_marker(ns, points)
            marker.ns, marker.header.frame_id = name, frame
            found.append(marker)
        return self._new(schemas.TYPES[schemas.MARKERS], found)

    def _line_marker(self, ns: int, points: FloatArray) -> Any:
        kind: Any = self._types["visualization_msgs/msg/Marker"]
        mesh = self._new("visualization_msgs/msg/MeshFile", "", np.zeros(0, np.uint8))
        image = self._new(
            "sensor_msgs/msg/CompressedImage", self._header(ns), "", np.zeros(0, np.uint8)
        )
        return kind(
            header=self._header(ns),
            ns="",
            id=0,
            type=kind.LINE_STRIP,
            action=kind.ADD,
            pose=self._pose(0.0, 0.0, 0.0),
            scale=self._vector(_LINE, 0.0, 0.0),
            color=self._new("std_msgs/msg/ColorRGBA", *_COLOUR),
            lifetime=self._new("builtin_interfaces/msg/Duration", 0, 0),  # for ever
            frame_locked=True,
            points=[self._new("geometry_msgs/msg/Point", x, y, 0.0) for x, y in points.tolist()],
            colors=[],
            texture_resource="",
            texture=image,
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=mesh,
            mesh_use_embedded_materials=False,
        )

    def lateral(self, ns: int, angle: float) -> Any:
        time = self._time(ns)
        return self._new(schemas.LATERAL_TYPE, time, time, angle, 0.0, False)

    def diagnostics(self, ns: int, values: dict[str, float]) -> Any:
        fields = {name: int(v) if name in schemas.ENUMS else v for name, v in values.items()}
        return self._types[schemas.DIAGNOSTICS_TYPE](header=self._header(ns), **fields)
