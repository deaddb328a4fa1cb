"""Paths from the files of receivers and maps: GPX tracks and GeoJSON lines."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path as FilePath
from typing import Any, ClassVar, NamedTuple

import numpy as np

from steersman.bounds import MOST_JSON, from_json
from steersman.config import param, register, required
from steersman.errors import DataError
from steersman.files import read_bytes
from steersman.paths.point_path import SMOOTHING, PointPath, Smoothing
from steersman.paths.points import Points, in_the_plane

_LEAST = 2


class GeoLine(NamedTuple):
    """A line on the earth, or in the plane of a map."""

    places: list[tuple[float, float]]
    """Latitude and longitude [deg] of each point, or x and y [m]."""
    lines: list[int]
    """Where each point stands."""
    geographic: bool = True


class GeoPath(PointPath):
    """One of the lines in a file, as metres east and north of its first point."""

    counted: ClassVar[str]

    file: FilePath = required("-", "file of lines on the earth")
    number: int | None = param(
        None,
        "-",
        "which of the file's lines, from 1; null: that with the most points",
        ge=1,
    )

    @abstractmethod
    def found(self) -> list[GeoLine]:
        """All lines of the file."""

    def recorded(self, *, speeds: bool = False) -> Points:
        """The points of the line.

        Raises:
            DataError: the file cannot be used, or has no such line.
        """
        lines = [line for line in self.found() if len(line.places) >= _LEAST]
        if not lines:
            raise DataError(f"{self.file}: holds no line of at least {_LEAST} points")
        if self.number is not None and self.number > len(lines):
            raise DataError(
                f"{self.file}: number {self.number} is not among its {len(lines)} lines"
            )
        sizes = [len(line.places) for line in lines]
        row = sizes.index(max(sizes)) if self.number is None else self.number - 1
        chosen = lines[row]
        first, second = np.array(chosen.places, dtype=np.float64).T
        points = Points(self.file, first, second, chosen.lines, None, self.counted)
        if len(lines) > 1 and self.number is None:
            points = points.noted(f"line {row + 1} of {len(lines)} in the file (path.number)")
        return in_the_plane(points) if chosen.geographic else points


@register("path", "gpx")
class GpxPath(GeoPath):
    """A track of a GPX file, or a route: the line that a receiver recorded, or a plan.

    The parts of a track follow each other. Positions of receivers are noisy, so that they are
    smoothed unless ``smoothing`` says otherwise.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".gpx",)
    counted: ClassVar[str] = "line"

    smoothing: Smoothing = param("auto", "m", SMOOTHING)

    def found(self) -> list[GeoLine]:
        """Tracks, then routes.

        Raises:
            DataError: it is no XML without entities, or a point has no position.
        """
        from steersman.paths.xodr.xml import parse

        root, _ = parse(self.file, "give a GPX file (*.gpx)")
        lines = [track.down("trkseg", "trkpt") for track in root.children("trk")]
        lines += [route.children("rtept") for route in root.children("rte")]
        return [
            GeoLine([(p.number("lat"), p.number("lon")) for p in line], [p.line for p in line])
            for line in lines
        ]


@register("path", "geojson")
class GeoJsonPath(GeoPath):
    """A line of a GeoJSON file (RFC 7946): LineString, MultiLineString, the rings of Polygons.

    Positions are longitude and latitude. In a file that names another system (``crs``, as GIS
    programs write it) they are x and y in metres.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".geojson",)
    counted: ClassVar[str] = "position"

    def found(self) -> list[GeoLine]:
        """All lines, in the order of the file.

        Raises:
            DataError: it is no JSON, or a position is none.
        """
        cure = "give a GeoJSON file with a LineString"
        try:
            tree = from_json(read_bytes(self.file, cure, MOST_JSON))
        except (ValueError, UnicodeDecodeError) as error:
            if isinstance(error, DataError):
                raise
            raise DataError(f"{self.file}: not valid JSON ({error}); {cure}") from None
        geographic = _is_geographic(tree)
        return [self._line(line, geographic) for line in _lines(tree)]

    def _line(self, positions: Sequence[Any], geographic: bool) -> GeoLine:
        places = []
        for row, position in enumerate(positions, 1):
            pair = position[:2] if isinstance(position, list) else []
            numbers = [value for value in pair if type(value) in {int, float}]
            if len(numbers) != _LEAST or not all(map(math.isfinite, numbers)):
                raise DataError(f"{self.file}, position {row} of a line: is no pair of numbers")
            x, y = (float(value) for value in numbers)
            places.append((y, x) if geographic else (x, y))
        return GeoLine(places, list(range(1, len(places) + 1)), geographic)


def _is_geographic(tree: Any) -> bool:
    """Whether positions are longitude and latitude: no other system is named."""
    crs = tree.get("crs") if isinstance(tree, dict) else None
    name = str(crs.get("properties", {})) if isinstance(crs, dict) else ""
    return not name or "CRS84" in name or "4326" in name


def _lines(tree: Any) -> Iterator[Sequence[Any]]:
    """The coordinates of all lines in a GeoJSON object."""
    if not isinstance(tree, dict):
        return
    for inner in [*_list(tree, "features"), *_list(tree, "geometries"), tree.get("geometry")]:
        yield from _lines(inner)
    coordinates, kind = _list(tree, "coordinates"), tree.get("type")
    if kind == "LineString":
        yield coordinates
    elif kind == "MultiLineString" or kind == "Polygon":  # noqa: PLR1714 - it may be a list
        yield from (line for line in coordinates if isinstance(line, list))


def _list(tree: dict[str, Any], name: str) -> list[Any]:
    found = tree.get(name)
    return found if isinstance(found, list) else []
