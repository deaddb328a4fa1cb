"""Lanes' centres of OpenDRIVE maps: this package and others beside CARLA's own reader.

    python benchmarks/opendrive.py DIR --out results/opendrive/readers.json

For every lane that can be driven, points of our centre line every metre are compared with
``carla.Map.get_waypoint_xodr`` at the same road, lane and s: to the side, along, and in direction.
If ``pyxodr-omega-prime`` is installed, its centre lines (resolution 0.1 m) are compared too, to the
side of ours, and so are the lanes of exported paths, to the side of the paths. The record names the
maps with their SHA-256. With ``asam-qc-opendrive``, the exports are held against the schema, too.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from steersman.config import resolve
from steersman.files import make_folder, write_text
from steersman.kernels import path as kernel
from steersman.paths.base import PathComponent
from steersman.paths.segments import from_samples
from steersman.paths.xodr.lane_line import lane_line
from steersman.paths.xodr.model import RoadNetwork
from steersman.paths.xodr.read import read_network
from steersman.paths.xodr.ways import Ways
from steersman.paths.xodr.write import opendrive
from steersman.provenance import provenance

# CARLA's lane at the end of a section is that of the next: points keep away from it [m].
INSIDE = 1e-4
TOLERANCE = 0.01
KINDS = ("circle", "double_lane_change", "figure_eight", "lemniscate", "random_road", "monza")


def dense(network: RoadNetwork) -> dict[tuple[str, int, int], Any]:
    """Rows x, y, psi (towards growing s), s of every drivable lane, by road, section and lane."""
    ways = Ways(network)
    out: dict[tuple[str, int, int], Any] = {}
    for place in ways.graph.all():
        section = ways.graph.section(place)
        curves = lane_line(network.roads[place.road], section, place.lane)
        if curves:
            key = (place.road, place.section, place.lane)
            out[key] = np.concatenate([np.column_stack(curve) for curve in curves])
    return out


def beside_carla(file: Path, lanes: dict[tuple[str, int, int], Any]) -> dict[str, float]:
    """Largest differences from CARLA's lanes."""
    import carla

    world = carla.Map(file.stem, file.read_text(encoding="utf-8"))
    found = []
    for (road, _, lane), rows in lanes.items():
        low, high = rows[0, 3] + INSIDE, rows[-1, 3] - INSIDE
        for x, y, psi, s in rows:
            if low <= s <= high:
                there = world.get_waypoint_xodr(int(road), lane, float(s)).transform
                dx, dy = there.location.x - x, -there.location.y - y
                away = -math.radians(there.rotation.yaw) + (math.pi if lane > 0 else 0.0)
                c, n = math.cos(psi), math.sin(psi)
                turned = abs(math.remainder(away - psi, math.tau))
                found.append((abs(dy * c - dx * n), abs(dx * c + dy * n), turned))
    aside, along, turned = np.max(found, axis=0)
    return {
        "points": len(found),
        "aside_max_mm": 1e3 * float(aside),
        "along_max_mm": 1e3 * float(along),
        "direction_max_mrad": 1e3 * float(turned),
    }


def of_pyxodr(file: Path, lanes: dict[tuple[str, int, int], Any]) -> dict[str, float]:
    """How far the centre lines of pyxodr-omega-prime lie beside ours."""
    from pyxodr_omega_prime.road_objects.network import RoadNetwork

    worst, nowhere = [], 0
    for road in RoadNetwork(xodr_file_path=str(file), resolution=0.1).get_roads():
        for section in road.lane_sections:
            for lane in section.lanes:
                rows = lanes.get((road.id, section.lane_section_ordinal, lane.id))
                if rows is None:
                    continue
                points = np.asarray(lane.centre_line)[:, :2]
                if not points.any():  # all of it is put at the origin
                    nowhere += 1
                    continue
                worst.append(max(_aside(rows, points)))
    return {
        "lanes": len(worst) + nowhere,
        "lanes_at_the_origin": nowhere,
        "aside_max_mm": 1e3 * max(worst),
        "aside_median_mm": 1e3 * float(np.median(worst)),
        "other_lanes_beyond_1_cm": int(np.sum(np.array(worst) > TOLERANCE)),
    }


def exports() -> dict[str, float]:
    """How far pyxodr-omega-prime finds the lane of an exported path beside the path [mm]."""
    from pyxodr_omega_prime.road_objects.network import RoadNetwork

    out = {}
    for kind in KINDS:
        path = resolve("path", kind)
        assert isinstance(path, PathComponent)
        with TemporaryDirectory() as folder:
            file = Path(folder) / "path.xodr"
            write_text(file, opendrive(path))
            roads = RoadNetwork(xodr_file_path=str(file), resolution=0.1).get_roads()
            lanes = [lane for road in roads for part in road.lane_sections for lane in part.lanes]
            points = [lane.centre_line for lane in lanes if lane.type == "driving"]
        out[kind] = 1e3 * max(abs(path.project(x, y)[1]) for x, y, *_ in np.concatenate(points))
    return out


def valid() -> bool:
    """Whether exports agree with ASAM's schema, which comes with asam-qc-opendrive."""
    from lxml import etree

    found = find_spec("qc_opendrive")
    assert found is not None
    file = Path(str(found.origin)).parent / "schema" / "1.4" / "OpenDRIVE_1.4H.xsd"
    schema = etree.XMLSchema(etree.parse(file))
    texts = [opendrive(resolve("path", kind)).encode() for kind in KINDS]  # type: ignore[arg-type]
    return all(schema.validate(etree.fromstring(text)) for text in texts)


def _aside(rows: Any, points: Any) -> Iterator[float]:
    """Distances of points from the curve through our samples, seen within their length."""
    _, first = np.unique(rows[:, 3], return_index=True)
    rows = rows[first]
    table = from_samples(rows[:, 0], rows[:, 1], rows[:, 2], closed=False)
    yield 0.0
    for x, y in points:
        s, d = kernel.project(table, 0, float(x), float(y))
        if 0.0 <= s <= table.meta[0, kernel.LENGTH]:
            yield abs(d)


def main() -> None:
    """Compare on all maps of a folder and write the record."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    maps = {}
    for file in sorted(arguments.folder.glob("*.xodr")):
        network = read_network(file)
        lanes = dense(network)
        row: dict[str, Any] = {"sha256": network.sha256, "lanes": len(lanes)}
        row["carla"] = beside_carla(file, lanes)
        if find_spec("pyxodr_omega_prime") is not None:
            row["pyxodr_omega_prime"] = of_pyxodr(file, lanes)
        maps[file.name] = row
        print(file.name, json.dumps(row))  # noqa: T201 - a script
    record: dict[str, Any] = {**provenance(), "readers": _versions(), "maps": maps}
    if find_spec("pyxodr_omega_prime") is not None:
        record["exports_in_pyxodr_aside_max_mm"] = exports()
    if find_spec("qc_opendrive") is not None:
        record["exports_valid_by_the_schema_of_1.4"] = valid()
    make_folder(arguments.out.parent)
    write_text(arguments.out, json.dumps(record, indent=1) + "\n")


def _versions() -> dict[str, str]:
    versions = {}
    for name in ("carla", "pyxodr-omega-prime", "asam-qc-opendrive"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


if __name__ == "__main__":
    main()
