"""Lanes of OpenDRIVE maps as paths."""

from __future__ import annotations

import os
from functools import cached_property, lru_cache
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BeforeValidator, model_validator

from steersman.config import Built, param, register, required
from steersman.errors import ConfigError, DataError
from steersman.kernels.path import LENGTH, PathTable
from steersman.paths.base import PathComponent
from steersman.paths.segments import from_samples, part
from steersman.types import Surface

if TYPE_CHECKING:
    from steersman.paths.xodr.model import RoadNetwork
    from steersman.paths.xodr.ways import Ways

_CHOICES = ("road", "route", "random")
# So many elements that are left out are told one by one.
_MOST_TOLD = 3


def _text(value: Any) -> Any:
    """The id of a road, which YAML takes for a number."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


_RoadId = Annotated[str, BeforeValidator(_text)]


class _Followed(NamedTuple):
    """A way as a path."""

    table: PathTable
    surface: Surface | None
    changes: tuple[str, ...]
    """Changes of lane, a clause each."""


@register("path", "opendrive")
class OpenDrivePath(PathComponent):
    """The centre line of lanes of an OpenDRIVE map (*.xodr), in their driving direction.

    Exactly one of road, route and random selects them.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".xodr",)

    file: FilePath = required("-", "OpenDRIVE file, *.xodr")
    road: _RoadId | None = param(None, "-", "id of the road whose lane is followed to its end")
    route: tuple[_RoadId, ...] | None = param(
        None,
        "-",
        "ids [from, to] or [from, via, ..., to]: shortest way between roads; from = to: a lap",
        min_length=2,
        max_length=100,
    )
    random: int | None = param(None, "-", "seed of a random way of length distance", ge=0)
    distance: float = param(500.0, "m", "length of the random way", ge=1.0, le=1e5)
    lane: int | None = param(
        None, "-", "number of the lane where road or route begins; null: next to the middle"
    )
    min_radius: float = param(
        0.0, "m", "route and random take no lane that bends more sharply", ge=0.0, le=1e4
    )
    lane_change: float = param(
        50.0,
        "m",
        "length of a change of lane, made where route and random cannot do without; 0: none",
        ge=0.0,
        le=1000.0,
    )

    smooth: float = param(
        0.0,
        "m",
        "farthest that clothoids may leave the lane's centre; 0: as the map is",
        ge=0,
        le=2,
    )
    sha256: str | None = param(
        None, "-", "digest of the file, so that no other is taken for it", pattern="^[0-9a-f]{64}$"
    )

    @model_validator(mode="after")
    def _check(self) -> OpenDrivePath:
        given = [name for name in _CHOICES if getattr(self, name) is not None]
        if len(given) != 1:
            what = " and ".join(given) or "none"
            raise ConfigError(
                f"give one of {', '.join(_CHOICES)}; given: {what}; "
                f"'steersman path roads {self.file}' lists roads"
            )
        if self.lane is not None and given == ["random"]:
            raise ConfigError("lane goes with road or route, a random way draws its own")
        return self

    def cure(self) -> str:
        """Transitions, or other lanes."""
        wider = "" if self.road is not None else ", path.min_radius=6 takes other lanes"
        return f"path.smooth=0.5 lays transitions{wider}"

    def build_table(self) -> PathTable:
        """Short clothoids through positions and tangents of the lanes' centres.

        Raises:
            DataError: the file cannot be used, or holds no such way.
        """
        return self.followed.value.table

    def surface(self) -> Surface | None:
        """Height and banking of the roads under the lanes' centres."""
        return self.followed.value.surface

    @cached_property
    def followed(self) -> Built[_Followed]:
        """The way, as it is first used."""
        from steersman.paths.smooth import smoothed
        from steersman.paths.xodr.joined import joined
        from steersman.paths.xodr.relief import surface_along
        from steersman.paths.xodr.ways import Ways

        network = _network(self.file, _stamp(self.file))
        if self.sha256 not in {None, network.sha256}:
            raise DataError(f"{self.file}: its SHA-256 is {network.sha256}, not {self.sha256}")
        ways = Ways(network, self.min_radius, self.lane_change)
        try:
            way, closed = self._way(ways)
            table = from_samples(*joined(ways.lines(way), closed), closed=closed)
            if self.smooth > 0.0:
                table = smoothed(table, self.smooth)
        except DataError as error:
            raise DataError(f"{self.file}: {error}") from None
        surface = surface_along(ways, way, table)
        if self.random is not None:
            start, end = self._cut(table, ways.length(way[0]))
            table = part(table, start, end)
            surface = surface and surface._replace(s=surface.s - start)
        changes = tuple(str(place) for place in way if place.entered)
        return Built(_Followed(table, surface, changes))

    def notes(self) -> tuple[str, ...]:
        """The elements of the map that are left out; of many, the first."""
        lost = _network(self.file, _stamp(self.file)).left_out
        rest = len(lost) - _MOST_TOLD
        more = (f"{rest} more of the map; 'steersman path check' lists all",) if rest > 0 else ()
        return (*map(str, lost[:_MOST_TOLD]), *more, *self.followed.value.changes)

    def _cut(self, table: PathTable, first: float) -> tuple[float, float]:
        """The part of a random way that is wanted, from a drawn point of its first lane on [m]."""
        whole = float(table.meta[0, LENGTH])
        # The way itself was drawn from the seed alone.
        share = np.random.default_rng([int(self.random or 0), 1]).uniform()
        start = share * max(min(whole - self.distance, first), 0.0)
        return start, min(start + self.distance, whole)

    def _way(self, ways: Ways) -> tuple[list[Any], bool]:
        if self.road is not None:
            return ways.along(self.road, self.lane)
        if self.route is not None:
            return ways.between(self.route, self.lane)
        return ways.random(int(self.random or 0), self.distance), False


def _stamp(file: FilePath) -> tuple[int, int]:
    try:
        found = os.stat(os.path.expanduser(file))
    except (OSError, ValueError):
        return (0, 0)  # reading it raises with the cause
    return (found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=4)
def _network(file: FilePath, stamp: tuple[int, int]) -> RoadNetwork:
    """The roads of a file, which is read again only if it has changed."""
    from steersman.paths.xodr.read import read_network

    return read_network(file)
