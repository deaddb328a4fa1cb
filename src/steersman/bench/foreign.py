"""Foreign worlds: what others recorded, drew or published, as one suite.

Race circuits at speeds near the grip's limit, OpenDRIVE maps, TUM-CONTROL's references with its car
and its published noise, recorded lines, and the multi-body car. All files are the user's; a result
names them and holds nothing of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from fnmatch import fnmatch
from pathlib import Path as FilePath
from typing import NamedTuple

from steersman.bench.courses import Speeds, changing, constant, course, known_courses
from steersman.bench.disturbance import Disturbance
from steersman.bench.grip import burden
from steersman.bench.maps import ALONE, Map, read_maps, with_maps
from steersman.bench.standard import GENERATORS, core
from steersman.bench.suite import CLEAN, Course, Suite
from steersman.bench.suites import suite
from steersman.errors import ConfigError, DataError
from steersman.kernels.vehicle import GRAVITY
from steersman.paths.base import PathComponent
from steersman.paths.csv_path import CsvPath
from steersman.paths.tum_reference import TumReference
from steersman.plants.multibody import MultiBody
from steersman.plants.tum_single_track import TumSingleTrack
from steersman.speed import PathSpeed, SpeedProfile
from steersman.vehicles import Bmw320i, CarlaModel3, Vehicle, VwT7

FOREIGN = "foreign"
"""Name of the suite."""

MAPS, LINES = "roads of OpenDRIVE maps", "lines that CARLA's agents were to follow"
WORLDS = {
    "race circuits at 60 and 80 % of the grip, Model 3": "*_carla_model3",
    "the same with a BMW 320i": "*_bmw_320i",
    MAPS: None,
    "TUM-CONTROL's references, its car, its noise": "reftraj*",
    "multi-body BMW": "multibody*",
    LINES: None,
}
"""Foreign worlds by title, with the pattern of their courses' names."""

_CARS: dict[str, Vehicle] = {
    "carla_model3": CarlaModel3(),
    "bmw_320i": Bmw320i(),
    "vw_t7": VwT7(),
}
_RACING = ("carla_model3", "bmw_320i")
# Shares of the grip at which circuits are driven, and of the brakes' force that is reckoned with.
_SHARES, _BRAKES = (0.6, 0.8), 0.8
_SEEN = (CLEAN, "delay_100ms", "noise_0.1m", "v_y_bias", "drift", "latency_100ms")
# TUM-CONTROL drives 120 s; its published controllers leave 1.5 m.
_TUM_SECONDS, _TUM_CORRIDOR = 120.0, 5.0


class ForeignFolders(NamedTuple):
    """Where the files are; None: that world is left out."""

    tracks: FilePath | None = None
    """Race circuits as CSV files of TUM's database."""
    maps: FilePath | None = None
    """OpenDRIVE maps."""
    tum: FilePath | None = None
    """Reference trajectories of TUM-CONTROL as JSON files."""
    logs: FilePath | None = None
    """Recorded lines as CSV files with the columns x and y."""


def world_of(course: str, maps: Iterable[str]) -> str:
    """The title in ``WORLDS`` of a course, by its name and those of the files of the maps.

    >>> world_of("Town01_2", ["Town01.xodr"]), world_of("multibody_spline", [])
    ('roads of OpenDRIVE maps', 'multi-body BMW')
    """
    if any(course.startswith(f"{FilePath(name).stem}_") for name in maps):
        return MAPS
    found = (title for title, pattern in WORLDS.items() if pattern and fnmatch(course, pattern))
    return next(found, LINES)


def published_noise() -> dict[str, Disturbance]:
    """The noise of the state in TUM-CONTROL's published runs; SDs, anew at each step."""
    first = Disturbance(heading_noise=0.035, speed_noise=0.1, v_y_noise=0.05, yaw_rate_noise=0.001)
    second = Disturbance(speed_noise=0.8, v_y_noise=0.35, yaw_rate_noise=0.035)
    third = second.model_copy(update={"v_y_noise": 0.8, "yaw_rate_noise": 0.1})
    fourth = third.model_copy(update={"position_noise": 0.3, "heading_noise": 0.05})
    every = enumerate((first, second, third, fourth), start=1)
    return {f"published_noise_{k}": one for k, one in every}


def foreign(
    folders: ForeignFolders, notify: Callable[[str], None] = lambda _: None
) -> tuple[Suite, list[Map]]:
    """The suite over what the folders hold, and the maps.

    Args:
        folders: where the files are.
        notify: called with a sentence about each map, and about each file that cannot be driven.

    Raises:
        DataError: a folder is not there, or holds no file of its sort.
        ConfigError: two files would give courses of one name.
    """
    known = core()
    maps = [] if folders.maps is None else read_maps(folders.maps)
    for each in maps:
        notify(each.described())
    courses: dict[str, Course] = {}
    parts = (_multibody(), _tracks(folders, notify), _tum(folders, notify), _logs(folders, notify))
    every = [(name, one) for part in parts for name, one in part]
    every += [(name, _seen(one)) for each in maps for name, one in each.courses.items()]
    for name, one in every:
        if name in courses:
            raise ConfigError(f"two courses would be named {name!r}; rename a file")
        courses[name] = one
    chosen = {name: known.disturbances[name] for name in _SEEN}
    return Suite(
        courses=courses, disturbances={**chosen, **published_noise()}, vehicles=_CARS
    ), maps


def over_files(
    name: str, folders: Mapping[str, FilePath], notify: Callable[[str], None]
) -> tuple[Suite, list[Map]]:
    """A suite by its name or file, with the courses over the user's files.

    Args:
        name: of the suite; ``foreign`` and ``maps`` consist of such courses.
        folders: by the names of :class:`ForeignFolders`; other suites take ``maps`` alone.
        notify: of :func:`foreign`.

    Raises:
        ConfigError: the suite is unknown, or does not take these folders.
        DataError: a folder is not there, or holds no file of its sort.
    """
    if name == FOREIGN:
        return foreign(ForeignFolders(**folders), notify)
    others = sorted(folders.keys() - {"maps"})
    if others:
        raise ConfigError(f"--{others[0]} goes with the suite {FOREIGN!r}")
    if name == ALONE and not folders:
        raise ConfigError("the suite 'maps' needs a folder of OpenDRIVE maps: --maps DIR")
    base = None if name == ALONE else suite(name)
    read = read_maps(folders["maps"]) if folders else []
    for each in read:
        notify(each.described())
    return (with_maps(base, read) if read or base is None else base), read


def _seen(found: Course, vehicle: str = "carla_model3") -> Course:
    """The course with the usual disturbances at every speed, for one car."""
    only = dict.fromkeys(found.speeds, _SEEN)
    return found.model_copy(update={"only": only, "vehicle": vehicle})


def _multibody() -> Iterator[tuple[str, Course]]:
    tracks = {name: known_courses()[name] for name in ("iso_3888_1", "figure_eight")}
    roads = {f"{name}_0": course(kind(), 12.0, 18.0) for name, kind in GENERATORS.items()}
    for name, one in {**tracks, **roads}.items():
        capped: Speeds = {"constant": constant(12.0, 5.0), "changing": changing(18.0, 5.0)}
        own = one.model_copy(update={"speeds": capped, "plant": MultiBody()})
        yield f"multibody_{name}", _seen(own, "bmw_320i")


def _tracks(folders: ForeignFolders, notify: Callable[[str], None]) -> Iterator[tuple[str, Course]]:
    for path, stem in _paths(folders.tracks, "csv", lambda file: CsvPath(file=file), notify):
        for car in _RACING:
            speeds: Speeds = {f"grip_{round(100 * k)}": _profile(_CARS[car], k) for k in _SHARES}
            yield f"{stem}_{car}", _seen(Course(path=path, speeds=speeds, laps=1), car)


def _profile(car: Vehicle, share: float) -> SpeedProfile:
    grip = share * car.friction * GRAVITY
    along = grip / burden(car)
    brakes = _BRAKES * car.brake_force / car.mass
    return SpeedProfile(a_lat_max=grip, deceleration=min(along, brakes), acceleration=2.5)


def _tum(folders: ForeignFolders, notify: Callable[[str], None]) -> Iterator[tuple[str, Course]]:
    words = (CLEAN, *published_noise())
    for path, stem in _paths(folders.tum, "json", lambda file: TumReference(file=file), notify):
        yield (
            stem,
            Course(
                path=path,
                speeds={"reference": PathSpeed()},
                duration=_TUM_SECONDS,
                only={"reference": words},
                vehicle="vw_t7",
                plant=TumSingleTrack(),
                corridor=_TUM_CORRIDOR,
            ),
        )


def _logs(folders: ForeignFolders, notify: Callable[[str], None]) -> Iterator[tuple[str, Course]]:
    for path, stem in _paths(folders.logs, "csv", _recorded, notify):
        speeds: Speeds = {"constant": constant(12.0), "changing": changing(18.0)}
        if path.speeds() is not None:
            speeds["recorded"] = PathSpeed()
        laps = 1 if path.closed else None
        yield stem, _seen(Course(path=path, speeds=speeds, laps=laps))


def _recorded(file: FilePath) -> CsvPath:
    """A recorded line: standstill thinned out, noise smoothed."""
    return CsvPath(file=file, spacing=1.0, smoothing="auto")


def _paths(
    folder: FilePath | None,
    ending: str,
    read: Callable[[FilePath], PathComponent],
    notify: Callable[[str], None],
) -> Iterator[tuple[PathComponent, str]]:
    """The paths of a folder's files that can be driven, with the files' names."""
    if folder is None:
        return
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder")
    files = sorted(folder.glob(f"*.{ending}"))
    if not files:
        raise DataError(f"{folder}: holds no *.{ending}")
    for file in files:
        try:
            path = read(file)
            path.table  # noqa: B018 - what cannot be driven is known now
        except DataError as error:
            notify(f"{file.name}: left out: {str(error).removeprefix(f'{file}: ')}")
        else:
            yield path, file.stem
