"""What ``fuzz.py`` reads: every reader of other people's files and bytes, each with a corpus."""

from __future__ import annotations

import importlib.util
import io
import json
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

import steersman as sm
from carla_standin import actor_calls, wire
from carla_standin.calls import Dispatcher
from carla_standin.catalogue import default_models
from carla_standin.maps import MapLibrary
from carla_standin.streams import Streams
from carla_standin.world import StandinWorld
from steersman.bench.results import BenchResult
from steersman.bench.suite import Suite
from steersman.config import build, read_yaml, resolve
from steersman.delivery.controller_package import read_table
from steersman.episode import load_episode
from steersman.learning import checkpoint, snapshot
from steersman.learning.sb3_file import read_actor
from steersman.logs.restore import read_episode
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.xodr.check import faults
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.paths.xodr.write import opendrive
from steersman.policy_file import locate
from steersman.report.runs import load_runs
from steersman.vehicles import CarlaModel3

_STEP = 0.05
MOST_BYTES = 2_000_000
_YAML = b"a: &a {b: 1}\nc: [*a, *a]\nd: {<<: *a}\n"
_TURN = [(48.1 + 1e-4 * k, 11.5 + 1e-5 * k * k) for k in range(20)]
_POINTS = "".join(f'<trkpt lat="{lat}" lon="{lon}"></trkpt>' for lat, lon in _TURN)
_GPX = f'<?xml version="1.0"?><gpx><trk><trkseg>{_POINTS}</trkseg></trk></gpx>'.encode()
_LINE = {"type": "LineString", "coordinates": [[lon, lat] for lat, lon in _TURN]}
_GEOJSON = json.dumps({"type": "Feature", "geometry": _LINE}).encode()
_WAYPOINTS = json.dumps(
    {"map": {"wpnts": [{"x_m": 3.0 * k, "y_m": 0.1 * k * k, "vx_mps": 5} for k in range(20)]}}
).encode()
_TUM = json.dumps(
    {
        "pos_x": [3.0 * k for k in range(20)],
        "pos_y": [0.1 * k * k for k in range(20)],
        "ref_v": [5.0] * 20,
    }
).encode()
_CAR = b"base: carla_model3\nmass: 2100\nsteer_curve_speed: [0, 20, 40, 60]\n"
_SUITE = b"""courses:
  one:
    path: circle
    speeds: {slow: {kind: constant_speed, speed: 8}}
    duration: 5
disturbances: {clean: {}, soft: {c_f: 0.7}}
vehicles: {carla_model3: carla_model3}
"""
_POSE = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
_SETTINGS = [True, False, [True, 0.05], True, 0.01, 10, 0.0, True, 1.0, 1.0, True]
_CALLS = (
    ("spawn_actor", [[4, "vehicle.tesla.model3", []], _POSE]),
    (
        "set_episode_settings",
        [[True, False, [True, 0.05], True, 0.01, 10, 0.0, True, 1.0, 1.0, True]],
    ),
    ("apply_batch", [[[1, [77]], [3, [77, [0.5, 0.1, 0.0, False, False, False, 0]]]], True]),
    (
        "copy_opendrive_to_file",
        ["<OpenDRIVE><road/></OpenDRIVE>", [2.0, 50.0, 1.0, 0.6, True, True]],
    ),
    ("get_actors_by_id", [[1, 2]]),
    ("tick_cue", []),
)


class Target(NamedTuple):
    """A reader, and files that it reads."""

    suffix: str
    corpus: list[bytes]
    read: Callable[[Path], object]


def targets(place: Path) -> dict[str, Target]:
    """Every reader with its corpus."""
    episode = sm.drive("pid", path="circle", duration=1.0)
    episode.save(place / "a.npz")
    with (place / "state.npz").open("wb") as stream:
        state = {"format": checkpoint._FORMAT, "random": None, "b": {"c": [1, "x", None]}}
        snapshot.write({**state, "a": np.arange(9.0)}, stream)
    circle = resolve("path", "circle")
    rows = "".join(f"{3.0 * k},{0.1 * k * k}\n" for k in range(20))
    numbered = "".join(f"{k},{3.0 * k},{0.1 * k * k}\n" for k in range(20))
    config = json.dumps(dict(episode.meta["config"]))
    card, network = (locate("precision").with_suffix(end) for end in (".json", ".onnx"))
    shipped = Path("results/your_car/results.json")
    found = {
        "yaml": Target(".yaml", [config.encode(), _YAML], read_yaml),
        "csv": Target(".csv", [f"x,y\n{rows}".encode(), rows.encode()], _path("csv")),
        "log": Target(".csv", [f"time,x,y\n{numbered}".encode()], _path("log")),
        "speed": Target(".csv", [f"time_s,speed_m_s\n{rows}".encode()], _speed),
        "gpx": Target(".gpx", [_GPX], _path("gpx")),
        "geojson": Target(".geojson", [_GEOJSON], _path("geojson")),
        "tum_reference": Target(".json", [_TUM], _path("tum_reference")),
        "json": Target(".json", [_TUM, _WAYPOINTS], _path("json")),
        "vehicle": Target(".yaml", [_CAR], _car),
        "suite": Target(".yaml", [_SUITE], lambda f: build(Suite, read_yaml(f))),
        "parameters": Target(".csv", [b"name,value,unit\nk_p,0.1,1/m\nk_i,2e-3,-\n"], read_table),
        "sb3": Target(".zip", [_model()], lambda f: read_actor(f.read_bytes(), f.name)),
        "opendrive": Target(".xodr", [opendrive(circle, "circle").encode()], _xodr),
        "episode": Target(".npz", [(place / "a.npz").read_bytes()], load_episode),
        "checkpoint": Target(".npz", [(place / "state.npz").read_bytes()], _checkpoint),
        "card": Target(".json", [card.read_bytes()], lambda f: _policy(f, network, card=True)),
        "network": Target(".onnx", [network.read_bytes()], lambda f: _policy(f, card, card=False)),
        "metrics": Target(".json", [b'{"a": 1.5, "b": [1, {"c": null}]}'], _metrics),
        "wire": Target(".bin", [_request(), _request("apply_batch", [[1, [2, None]]] * 3)], _wire),
    }
    if importlib.util.find_spec("lanelet2") is not None:
        found["lanelet2"] = Target(".osm", [_lanelets(local) for local in (False, True)], _osm)
    found["calls"] = Target(".bin", [_request(*each) for each in _CALLS], _calls)
    found["results"] = Target(".json", [shipped.read_bytes()], BenchResult.read)
    try:
        from steersman.logs.write import write_episode
    except ImportError:
        return found
    write_episode(place / "a.mcap", episode, CarlaModel3().table)
    recording = (place / "a.mcap").read_bytes()
    found["recording"] = Target(".mcap", [recording], read_episode)
    found["line"] = Target(".mcap", [recording], _path("mcap"))
    found["sqlite"] = Target(".db3", [_sqlite(recording, place)], _path("mcap"))
    return found


def _sqlite(recording: bytes, place: Path) -> bytes:
    """The Odometry of a recording, in an SQLite file."""
    from mcap.reader import make_reader
    from rosbags.rosbag2 import StoragePlugin, Writer

    from steersman.logs import schemas

    folder = place / "bag"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        kind = schemas.ODOMETRY_TYPE
        connection = writer.add_connection("/odometry", kind, typestore=schemas.typestore())
        for schema, _, message in make_reader(io.BytesIO(recording)).iter_messages():
            if schema is not None and schema.name == kind:
                writer.write(connection, message.log_time, message.data)
    [file] = folder.glob("*.db3")
    return file.read_bytes()


def _path(kind: str) -> Callable[[Path], object]:
    return lambda file: resolve("path", {"kind": kind, "file": str(file)}).length


def _lanelets(local: bool) -> bytes:
    """A map of two lanelets, one behind the other."""
    nodes, ways, relations = "", "", ""
    for k in range(6):
        for side in range(2):
            x, y = 10.0 * k, 3.0 * side
            tags = f'<tag k="local_x" v="{x}"/><tag k="local_y" v="{y}"/>' * local
            place = f'lat="{48.1 + y / 111e3:.8f}" lon="{11.5 + x / 74e3:.8f}"'
            nodes += f'<node id="{10 + 2 * k + side}" {place}>{tags}</node>'
    for way, (side, first) in enumerate((side, first) for first in (0, 3) for side in (0, 1)):
        refs = "".join(
            f'<nd ref="{10 + 2 * k + side}"/>' for k in range(first, first + 3 + (not first))
        )
        ways += f'<way id="{100 + way}">{refs}<tag k="type" v="line_thin"/></way>'
    for name, (right, left) in {11: (100, 101), 12: (102, 103)}.items():
        sides = "".join(
            f'<member type="way" ref="{way}" role="{role}"/>'
            for way, role in ((left, "left"), (right, "right"))
        )
        kinds = {"type": "lanelet", "subtype": "road", "location": "urban", "one_way": "yes"}
        tags = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in kinds.items())
        relations += f'<relation id="{name}">{sides}{tags}</relation>'
    return f'<?xml version="1.0"?><osm version="0.6">{nodes}{ways}{relations}</osm>'.encode()


def _osm(file: Path) -> object:
    return resolve("path", {"kind": "lanelet2", "file": str(file), "route": [11, 12]}).length


def _speed(file: Path) -> object:
    return resolve("speed", {"kind": "csv", "file": str(file)}).profile()


def _car(file: Path) -> object:
    return resolve("vehicle", {"kind": "file", "file": str(file)}).table


def _model() -> bytes:
    """A model as Stable-Baselines3 writes it, with one layer."""
    import torch

    weights, out = io.BytesIO(), io.BytesIO()
    tensors = {"action_net.weight": torch.ones((1, 3)), "action_net.bias": torch.zeros(1)}
    torch.save(tensors, weights)
    box = {":type:": "<class 'gymnasium.spaces.box.Box'>", "low": "[-1.]", "high": "[1.]"}
    policy = {"policy_class": {"__module__": "stable_baselines3.common.policies"}}
    about = {**policy, "observation_space": box, "action_space": box, "policy_kwargs": {}}
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("data", json.dumps(about))
        archive.writestr("policy.pth", weights.getvalue())
        archive.writestr("_stable_baselines3_version", "2.3.2")
    return out.getvalue()


def _xodr(file: Path) -> object:
    ways = Ways(read_network(file))
    found = faults(ways)
    for name in list(ways.network.roads)[:2]:
        _ = OpenDrivePath(file=file, road=name).table
    return found


def _checkpoint(file: Path) -> object:
    folder = file.parent / "training"
    (folder / checkpoint.FOLDER).mkdir(parents=True, exist_ok=True)
    (folder / checkpoint.FOLDER / "step_000000001.npz").write_bytes(file.read_bytes())
    with file.open("rb") as stream:
        snapshot.read(stream)
    return checkpoint.load(folder)


def _policy(file: Path, other: Path, *, card: bool) -> object:
    """The damaged half of a policy beside the whole one, whose digest is not asked for."""
    from steersman.network_file import PolicyNetwork

    if not card:
        features = len(json.loads(other.read_text())["scale"])
        return PolicyNetwork(file.read_bytes(), file.name, features)
    file.with_suffix(".onnx").write_bytes(other.read_bytes())
    return resolve("controller", {"kind": "policy", "file": str(file.with_suffix(".onnx"))}).init(
        CarlaModel3(), _STEP
    )


def _metrics(file: Path) -> object:
    folder = file.parent / "run"
    folder.mkdir(exist_ok=True)
    (folder / "metrics.json").write_bytes(file.read_bytes())
    return load_runs([folder])


def _request(name: str = "version", words: list[object] | None = None) -> bytes:
    import msgpack

    return bytes(msgpack.packb([0, 7, name, [[False], *(words or [])]]))


def _wire(file: Path) -> list[wire.Request]:
    incoming = wire.Incoming()
    try:
        incoming.feed(file.read_bytes())
        messages = list(iter(incoming.message, None))
    except Exception as error:  # noqa: BLE001 - the server ends a connection for any of them
        raise wire.NotARequest(str(error).partition("\n")[0]) from None
    return [wire.request(message) for message in messages]


@cache
def _dispatcher() -> Dispatcher:
    """A stand-in's world without its ports."""
    assert actor_calls
    return Dispatcher(StandinWorld(default_models()), MapLibrary(), 2001, Streams())


def _calls(file: Path) -> object:
    """The answers to what the requests are."""
    return [_dispatcher().answer(each.name, each.arguments) for each in _wire(file)]
