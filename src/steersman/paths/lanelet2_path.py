"""Lanelets of Lanelet2 maps as paths, read by Lanelet2's own library (the extra ``lanelet2``)."""

from __future__ import annotations

import heapq
import importlib.util
import itertools
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from pydantic import model_validator

from steersman.bounds import from_json
from steersman.config import param, register, required
from steersman.errors import ConfigError, DataError, how_to_install, shortened, suggestion
from steersman.paths.point_path import SMOOTHING, PointPath, Smoothing
from steersman.paths.points import Points

if TYPE_CHECKING:
    from steersman.paths.xodr.xml import Node

_CURE = "give a Lanelet2 map (*.osm)"
# Ends of lanelets that follow each other are nearer than this [m].
_SAME = 0.05
# How long the library may take [s], and its process, which imports from where this one does.
_PATIENCE = 300
_READER = """
import json, sys
sys.path[:] = json.loads(sys.argv.pop(1))
from steersman.paths.lanelet2_reader import main
main()
"""
_LOCAL = ("local_x", "local_y")
# Metres of a degree at 0 N, 0 E, and the farthest from there [deg].
_DEGREE, _MOST = 111_000.0, 80.0
# Characters of a message's list of ids.
_NAMED = 100


class Lanelet(NamedTuple):
    """A lanelet of a map."""

    line: list[tuple[float, float]]
    """Its centre in driving direction [m]."""
    subtype: str
    leads_to: list[str]
    """Ids of those that follow it, for cars."""

    @property
    def length(self) -> float:
        """Length of its centre [m]."""
        return sum(itertools.starmap(math.dist, itertools.pairwise(self.line)))


class LaneletMap(NamedTuple):
    """A map as it is driven."""

    lanelets: dict[str, Lanelet]
    """By id."""
    note: str
    """What its coordinates are."""


@register("path", "lanelet2")
class Lanelet2Path(PointPath):
    """The centre line of lanelets of a Lanelet2 map (*.osm), one or a shortest route.

    Positions are metres east and north of the map's first node, in the plane that touches the
    earth there; local_x and local_y, which Autoware's maps have, where every node has them.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".osm",)

    file: FilePath = required("-", "Lanelet2 map, *.osm")
    route: tuple[int, ...] | None = param(
        None,
        "-",
        "ids [lanelet] or [from, ..., to]: the shortest way without a change of lane",
        min_length=1,
        max_length=100,
    )
    smoothing: Smoothing = param("auto", "m", SMOOTHING)

    @model_validator(mode="after")
    def _check(self) -> Lanelet2Path:
        if self.route is None:
            raise ConfigError(
                f"give route, the ids of lanelets; 'steersman path roads {self.file}' lists them"
            )
        return self

    def recorded(self, *, speeds: bool = False) -> Points:
        """The points of the lanelets' centre lines.

        Raises:
            DataError: the file cannot be read, or holds no such lanelets or way.
        """
        found = read_lanelets(self.file)
        places: list[tuple[float, float]] = []
        for name in self._way(found.lanelets):
            line = found.lanelets[name].line
            again = bool(places) and math.dist(places[-1], line[0]) < _SAME
            places += line[1:] if again else line
        x, y = np.array(places, dtype=np.float64).T
        lines = list(range(1, x.size + 1))
        return Points(self.file, x, y, lines, None, "point", notes=(found.note,))

    def _way(self, lanelets: dict[str, Lanelet]) -> list[str]:
        ids = [str(name) for name in self.route or ()]
        for name in ids:
            if name not in lanelets:
                near = suggestion(name, lanelets)
                some = near if len(near) < _NAMED else ""
                raise DataError(f"{self.file}: unknown lanelet {name}{some}")
        way = ids[:1]
        for name in ids[1:]:
            part = _shortest(lanelets, way[-1], name)
            if part is None:
                raise DataError(
                    f"{self.file}: no lanelets lead from {way[-1]} to {name} without a change of"
                    f" lane; 'steersman path roads {self.file}' lists what they lead to"
                )
            way += part[1:]
        return way


def _shortest(lanelets: dict[str, Lanelet], start: str, end: str) -> list[str] | None:
    """The shortest way from one lanelet to another (Dijkstra), a lap if they are the same."""
    heap = [(0.0, [start])]
    done = set[str]()
    while heap:
        driven, way = heapq.heappop(heap)
        if way[-1] == end and len(way) > 1:
            return way
        if way[-1] in done and len(way) > 1:
            continue
        done.add(way[-1])
        for name in lanelets[way[-1]].leads_to:
            if name in lanelets and (name not in done or name == end):
                heapq.heappush(heap, (driven + lanelets[name].length, [*way, name]))
    return None


def read_lanelets(file: FilePath) -> LaneletMap:
    """The lanelets of a map.

    The file is looked into before the library gets it: no entities, no more than the bounds.

    Raises:
        DataError: it cannot be read, or holds no lanelets.
        ConfigError: the library is not installed.
    """
    from steersman.paths.xodr.xml import parse

    root, _ = parse(file, _CURE)
    if root.tag != "osm":
        raise root.fault(f"this is no Lanelet2 map, whose first element is <osm>; {_CURE}")
    kinds = [(tag.get("k", ""), tag.get("v", "")) for tag in root.down("relation", "tag")]
    nodes = root.children("node")
    if ("type", "lanelet") not in kinds or not nodes:
        raise DataError(
            f"{file}: holds no lanelet (a relation of type lanelet); a street of OpenStreetMap is a"
            f" path as GPX or GeoJSON"
        )
    if not all(map(_has_local, nodes)):
        origin = [nodes[0].number(name) for name in ("lat", "lon")]
        note = f"x and y are metres east and north of ({origin[0]:.7f}, {origin[1]:.7f})"
        return LaneletMap(_read(file, file.expanduser(), origin), note)
    # The library turns the edges of lanelets by where they lie: what lat and lon say may be void.
    for node in nodes:
        x, y = (_tags(node)[name].number("v") for name in _LOCAL)
        node.set("lon", repr(min(max(x / _DEGREE, -_MOST), _MOST)))
        node.set("lat", repr(min(max(y / _DEGREE, -_MOST), _MOST)))
    with tempfile.TemporaryDirectory() as folder:
        copy = FilePath(folder) / "map.osm"
        copy.write_bytes(root.written())
        found = _read(file, copy, [0.0, 0.0], local=True)
    return LaneletMap(found, "x and y are local_x and local_y of the map")


def _tags(node: Node) -> dict[str, Node]:
    return {tag.get("k", ""): tag for tag in node.children("tag")}


def _has_local(node: Node) -> bool:
    """Whether a node has coordinates of a plane."""
    return _tags(node).keys() >= set(_LOCAL)


def _read(
    file: FilePath, copy: FilePath, origin: list[float], *, local: bool = False
) -> dict[str, Lanelet]:
    """What the library finds in ``copy``."""
    if importlib.util.find_spec("lanelet2") is None:
        raise ConfigError(
            f"path: lanelet2 needs {how_to_install('lanelet2')} (Linux on x86-64; elsewhere convert"
            f" the map to OpenDRIVE)"
        )
    words = [json.dumps(sys.path), str(copy), *map(repr, origin), str(int(local))]
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", _READER, *words],
            capture_output=True,
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise DataError(f"{file}: Lanelet2's library takes more than {_PATIENCE} s") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines() or ["it ends abruptly"]
        raise DataError(f"{file}: Lanelet2's library cannot read it: {shortened(said[-1], 200)}")
    rows = from_json(done.stdout)
    found = {
        name: Lanelet([(x, y) for x, y in row["line"]], row["subtype"], row["leads_to"])
        for name, row in rows.items()
        if len(row["line"]) > 1
    }
    if not found:
        raise DataError(f"{file}: holds no lanelet that can be read; {_CURE}")
    return found
