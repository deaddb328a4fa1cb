"""Maps: the OpenDRIVE text that clients are handed, and where cars may be spawned on it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path as FilePath
from xml.parsers import expat

import steersman as sm
from carla_standin.actors import Actor, overlap
from carla_standin.geo import GeoReference
from carla_standin.wire import MAX_NAME, Refused, Transform, warn_once

# What CARLA calls a world that a client has generated.
GENERATED = "OpenDriveMap"
_DEFAULT = "StandInStraight"
_FOLDER = "Carla/Maps/"
# The end of a town's name whose buildings and the like are layers.
_LAYERED = "_Opt"
# Distance of a spawn point from the beginning of its lane, and of those that follow [m]. With it,
# CARLA's Town01 has 246 of them, and in CARLA 255.
_INTO_THE_LANE, _APART = 5.0, 20.0
# Half of the room that a spawn point needs: along, across, up [m].
_ROOM = (3.0, 1.3, 1.0)
# Elements of a client's map: no client is served while it is read. Town07 of CARLA has
# 17 454.
_MOST_ELEMENTS = 50_000
# A straight road of 1 km, one lane each way, on which an empty server starts.
_STRAIGHT = """<?xml version="1.0"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="4" name="stand-in"/>
  <road name="straight" length="1000.0" id="1" junction="-1">
    <planView>
      <geometry s="0.0" x="0.0" y="0.0" hdg="0.0" length="1000.0"><line/></geometry>
    </planView>
    <lanes>
      <laneSection s="0.0">
        <left>
          <lane id="1" type="driving" level="false">
            <width sOffset="0.0" a="3.5" b="0.0" c="0.0" d="0.0"/>
            <roadMark sOffset="0.0" type="solid" color="white" width="0.12"/>
          </lane>
        </left>
        <center>
          <lane id="0" type="none" level="false">
            <roadMark sOffset="0.0" type="broken" color="white" width="0.12"/>
          </lane>
        </center>
        <right>
          <lane id="-1" type="driving" level="false">
            <width sOffset="0.0" a="3.5" b="0.0" c="0.0" d="0.0"/>
            <roadMark sOffset="0.0" type="solid" color="white" width="0.12"/>
          </lane>
        </right>
      </laneSection>
    </lanes>
  </road>
</OpenDRIVE>
"""


@dataclass(frozen=True)
class WorldMap:
    """A map by name."""

    name: str
    opendrive: str

    @cached_property
    def spawn_points(self) -> tuple[Transform, ...]:
        """Poses along every driving lane, on each of which there is room for a car at once.

        A map that the reader of OpenDRIVE refuses has none; the log says why.
        """
        try:
            starts = sm.lane_starts(self.opendrive, _INTO_THE_LANE, _APART)
        except sm.DataError as error:
            warn_once(f"stand-in: no spawn points: {error}")
            return ()
        return _free([Transform.of(pose, 0.0) for pose in starts])

    @cached_property
    def origin(self) -> GeoReference:
        """Where on Earth it lies."""
        return GeoReference.read(self.opendrive)

    @cached_property
    def marked(self) -> bool:
        """Whether every lane has a road mark from its beginning on.

        Where one has none, the client's sensor of lane invasions ends the client's program.
        """
        lanes: list[bool] = []

        def start(tag: str, attributes: dict[str, str]) -> None:
            if tag == "lane":
                lanes.append(False)
            elif tag == "roadMark" and lanes:
                lanes[-1] = lanes[-1] or _zero(attributes.get("sOffset", ""))

        parser = expat.ParserCreate()
        parser.StartElementHandler = start
        parser.Parse(self.opendrive, True)
        return all(lanes)

    @property
    def path(self) -> str:
        """How CARLA names it."""
        return _FOLDER + self.name


def _free(points: list[Transform]) -> tuple[Transform, ...]:
    """Those whose room does not overlap that of one before; a grid has what is near."""
    side = 2.0 * math.hypot(*_ROOM[:2])
    kept: dict[tuple[int, int], list[Actor]] = {}
    found = []
    for point in points:
        i, j = math.floor(point.x / side), math.floor(point.y / side)
        box = Actor(0, [], point, extent=_ROOM)
        near = (kept.get((i + k, j + m), []) for k in (-1, 0, 1) for m in (-1, 0, 1))
        if not any(overlap(box, other) for cell in near for other in cell):
            kept.setdefault((i, j), []).append(box)
            found.append(point)
    return tuple(found)


def _zero(text: str) -> bool:
    try:
        return float(text) == 0.0
    except ValueError:
        return False


def default_map() -> WorldMap:
    """What an empty server shows."""
    return WorldMap(_DEFAULT, _STRAIGHT)


def read_map(name: str, text: str, most: float = _MOST_ELEMENTS) -> WorldMap:
    """A map from a client's text, which is checked for being OpenDRIVE at all.

    Args:
        name: of the map.
        text: OpenDRIVE.
        most: elements that it may have.

    Raises:
        Refused: it is not.
    """
    parser = expat.ParserCreate()
    seen: list[str] = []

    def start(tag: str, _: object) -> None:
        seen.append(tag)
        if len(seen) > most:
            cure = "put a larger map into the folder of steersman carla serve --maps"
            raise Refused(f"OpenDRIVE: more than {most} elements; {cure}")

    def entity(*_: object) -> None:
        raise Refused("OpenDRIVE: entities are not allowed")

    parser.StartElementHandler = start
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise Refused(f"OpenDRIVE: {error}") from None
    if seen[0] != "OpenDRIVE" or "road" not in seen:
        raise Refused(f"OpenDRIVE: expected <OpenDRIVE> with a <road>, got <{seen[0]}>")
    return WorldMap(name, text)


class MapLibrary:
    """The maps that ``load_world`` knows: the default one and those of a folder."""

    def __init__(self, folder: FilePath | None = None) -> None:
        """Look at the folder's names; a map is read when it is loaded.

        Raises:
            sm.DataError: the folder cannot be read, or has no map.
        """
        self._files: dict[str, FilePath] = {}
        if folder is not None:
            if not folder.is_dir():
                raise sm.DataError(f"{folder}: no such folder")
            self._files = {file.stem: file for file in sorted(folder.glob("*.xodr"))}
            if not self._files:
                raise sm.DataError(f"{folder}: no *.xodr in it")

    def names(self) -> list[str]:
        """All maps, as CARLA names them."""
        return [_FOLDER + name for name in (_DEFAULT, *self._files)]

    def load(self, name: str) -> WorldMap:
        """The map of that name, with or without its folder.

        CARLA has its towns twice: ``Town01_Opt`` has the roads of ``Town01``, its file will do.

        Raises:
            Refused: there is none, or its file cannot be read.
        """
        stem = name.rpartition("/")[2][:MAX_NAME]
        if stem == _DEFAULT:
            return default_map()
        file = self._files.get(stem, self._files.get(stem.removesuffix(_LAYERED)))
        if file is None:
            raise Refused(
                f"there is no map {stem!r}{sm.suggestion(stem, [_DEFAULT, *self._files])}"
            )
        try:
            return read_map(stem, file.read_text(encoding="utf-8"), math.inf)
        except (OSError, UnicodeDecodeError) as error:
            raise Refused(f"{file.name}: {error}") from None
