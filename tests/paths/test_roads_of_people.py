"""Roads as people have them: the same road, written and damaged in many ways, is the same path."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from steersman.kernels import path as kernel
from steersman.paths.analytic import Circle
from steersman.paths.csv_path import CsvPath
from steersman.paths.random_road import RandomRoad
from steersman.paths.tracks import TrainingCircuit

Array = NDArray[np.float64]
AXIS, ECCENTRICITY2 = 6378137.0, 0.00669437999014
NORTH, EAST = 48.137, 11.575


class Truth(NamedTuple):
    """A road to find again."""

    dense: Array
    """Points on it, 0.1 m apart."""
    closed: bool
    sharpest: float
    """Largest curvature [1/m]."""
    length: float


@cache
def truth(name: str) -> Truth:
    roads = {
        "open": RandomRoad(seed=3, distance=250.0, min_radius=20.0),
        "lap": Circle(radius=35.0),
        "circuit": TrainingCircuit(),
    }
    road = roads[name]
    stations = np.arange(0.0, road.length, 0.1)
    dense = np.array([road.at(s)[:2] for s in stations.tolist()])
    sharpest = float(np.max(np.abs(road.table.pieces[:, kernel.KAPPA0])))
    return Truth(dense, road.closed, sharpest, road.length)


class Drawn(NamedTuple):
    """A file and what it should be."""

    text: bytes
    settings: dict[str, Any]
    truth: Truth
    noise: float
    label: str
    origin: Array
    """Where the path has the road's origin; of degrees, the first point that was recorded is it."""


def sampled(rng: np.random.Generator, road: Truth, spacing: float) -> Array:
    """Points along the road, unevenly spaced."""
    steps = spacing * rng.uniform(0.6, 1.4, int(1.2 * road.length / spacing))
    at = np.cumsum(steps)
    rows = np.concatenate(([0], (at[at < road.length - 0.5 * spacing] * 10.0).astype(int)))
    return road.dense[rows]


def damaged(rng: np.random.Generator, place: Array, closed: bool) -> tuple[Array, float, str]:
    """What recorders do to points; the noise that only smoothing removes."""
    kinds = ["none", "doubled", "stood", "jitter", "noise", "heavy", "rounded"]
    kind = str(rng.choice([*kinds, "overrun", "repeat"] if closed else kinds))
    count, row = len(place), int(rng.integers(3, len(place) - 3))
    usual = float(np.median(np.hypot(*np.diff(place, axis=0).T)))
    noise = 0.0
    if kind == "doubled":
        place = np.repeat(place, rng.integers(1, 3, count), axis=0)
    elif kind == "stood":
        place = np.insert(place, [row] * 25, place[row], axis=0)
    elif kind == "jitter":
        stood = place[row] + rng.normal(0.0, 0.02, (40, 2))
        place = np.concatenate((place[:row], stood, place[row:]))
        noise = 0.02
    elif kind in {"noise", "heavy"}:
        noise = usual * float(rng.uniform(0.02, 0.1) if kind == "noise" else rng.uniform(0.3, 0.6))
        noise = min(noise, 0.5)
        place = place + rng.normal(0.0, noise, place.shape)
    elif kind == "rounded":
        noise = 0.03
        place = np.round(place, 1)
    elif kind == "overrun":
        place = np.concatenate((place, place[: int(rng.integers(2, 8))]))
        place = place + 0.4 * np.arange(len(place))[:, None] / count
        noise = 0.4
    elif kind == "repeat":
        place = np.concatenate((place, place[:1] + rng.uniform(-0.01, 0.01, 2)))
    return place, noise, kind


class Head(NamedTuple):
    """A way to name the columns."""

    titles: tuple[str, ...]
    scale: float = 1.0
    digits: int = 4
    shown: str = "{}"
    """The header's line; empty without one."""
    columns: str | None = None
    order: tuple[int, ...] = (0, 1)
    """Which column of (x, y, the number of the row) stands where."""
    units: tuple[str, ...] = ()
    """A row beneath the titles."""


HEADS = {
    "plain": Head(("x", "y")),
    "units": Head(("X [m]", "Y [m]")),
    "kilometres": Head(("X (km)", "Y (km)"), 1e-3, 7),
    "suffix": Head(("pos_x_mm", "pos_y_mm"), 1e3),
    "comment": Head(("x", "y"), shown="# {}"),
    "none": Head(("x", "y"), shown=""),
    "tum": Head(("x_ref_m", "y_ref_m"), shown="# {}"),
    "utm": Head(("Easting", "Northing")),
    "gauss": Head(("Hochwert [m]", "Rechtswert [m]"), digits=2, order=(1, 0)),
    "geo": Head(("latitude", "longitude"), digits=10),
    "own": Head(("rechts", "hoch"), columns="x=rechts,y=hoch"),
    "numbers": Head((), shown="", columns="x=3,y=2", order=(2, 1, 0)),
    "wide": Head(("y", "n", "x"), order=(1, 2, 0)),
    "feet": Head(("x (feet)", "y (feet)"), 1.0 / 0.3048),
    "centimetres": Head(("x", "y"), 100.0, 2, columns="x_cm=x,y_cm=y"),
    "beneath": Head(("x", "n", "y"), 1e3, 1, order=(0, 2, 1), units=("[mm]", "-", "[mm]")),
}
FAR = {"utm": np.array([691000.0, 5334000.0]), "gauss": np.array([4468000.0, 5334000.0])}
# What loggers write above a table.
ABOVE = (
    "Test drive on the proving ground",
    "Logger 1.2;serial 123;;",
    "Date: 2024-05-01, 10:30",
    "x and y of the centre line, as it was surveyed",
)
# What stands between thousands and before decimals.
MARKS = {".": ".,", ",": ",.", "'": "'.", " ": "\u00a0,", "": ""}


def written(rng: np.random.Generator, place: Array) -> tuple[bytes, dict[str, Any], str, Array]:
    """A table of points in some format, the settings that read it, its label and its origin."""
    separator = str(rng.choice([",", ";", "\t", " ", "|", " ; "]))
    name = str(rng.choice(list(HEADS)))
    head = HEADS[name]
    x, y = geographic(place) if name == "geo" else head.scale * (place + FAR.get(name, 0.0)).T
    columns = np.array([x, y, np.arange(len(place))])[list(head.order)]
    comma = separator != "," and bool(rng.integers(2))
    marks = MARKS[str(rng.choice([*MARKS]))] if name in FAR else ""
    if separator == " " and marks.startswith("\u00a0"):  # a blank as any other
        marks = ""
    both = str.maketrans(dict(zip(",.", marks or ("", "," if comma else "."), strict=True)))
    quote = '"' if separator in marks else ""
    cells = [[f"{value:,.{head.digits}f}".translate(both) for value in row] for row in columns.T]
    lines = [separator.join(f"{quote}{cell}{quote}" for cell in row) for row in cells]
    if head.shown:
        titles = [head.titles, head.units] if head.units else [head.titles]
        lines[:0] = [head.shown.format(separator.join(each)) for each in titles]
        if rng.integers(3) == 0:
            lines[:0] = rng.choice(ABOVE, int(rng.integers(1, 4))).tolist()
    if rng.integers(3) == 0:
        lines.insert(0, "# recorded on a Sunday, in the rain")
    if rng.integers(3) == 0:
        lines.insert(len(lines) // 2, "")
    if rng.integers(5) == 0:
        lines.insert(0, f"sep={separator.strip(' ')}")
    encoding = str(rng.choice(["utf-8", "utf-8-sig", "utf-16", "latin-1"]))
    text = str(rng.choice(["\n", "\r\n"])).join(lines)
    settings = {} if head.columns is None else {"columns": head.columns}
    origin = -place[0] if name == "geo" else np.asarray(FAR.get(name, (0.0, 0.0)))
    label = f"{separator!r} comma={comma} {marks!r} {name} {encoding}"
    return text.encode(encoding), settings, label, origin


def geographic(place: Array) -> Array:
    """Latitude and longitude of points east and north of a place, by its radii of curvature."""
    sin, cos = math.sin(math.radians(NORTH)), math.cos(math.radians(NORTH))
    across = AXIS / math.sqrt(1.0 - ECCENTRICITY2 * sin**2)
    along = across * (1.0 - ECCENTRICITY2) / (1.0 - ECCENTRICITY2 * sin**2)
    x, y = place.T
    latitude = y / along - x**2 * sin / cos / (2.0 * along * across)
    longitude = x / (across * cos) * (1.0 + y * sin / cos / across)
    return np.stack((NORTH + np.degrees(latitude), EAST + np.degrees(longitude)))


def drawn(seed: int) -> Drawn:
    rng = np.random.default_rng(seed)
    road = truth(str(rng.choice(["open", "lap"])))
    spacing = float(rng.choice([0.5, 1.0, 2.0]))
    place, noise, damage = damaged(rng, sampled(rng, road, spacing), road.closed)
    text, settings, form, origin = written(rng, place)
    smooth = noise > 0.0 and damage != "overrun"
    if smooth or "gauss" in form or rng.integers(2):  # centimetres bend points 0.5 m apart
        settings["smoothing"] = "auto"
    label = f"{seed}: {spacing} m, {damage} {noise:.2g}, {form}"
    return Drawn(text, settings, road, noise, label, origin)


@pytest.mark.parametrize("first", range(0, 200, 20))
def test_a_road_is_found_again(tmp_path: FilePath, first: int) -> None:
    wrong = []
    for seed in range(first, first + 20):
        case = drawn(seed)
        file = tmp_path / f"{seed}.csv"
        file.write_bytes(case.text)
        fault = difference(CsvPath(file=file, **case.settings), case)
        if fault:
            wrong.append(f"{case.label}: {fault}")
    assert not wrong, "\n".join(wrong)


def difference(path: CsvPath, case: Drawn) -> str:
    """How the path is another than the road; empty if it is that road."""
    road, noise = case.truth, case.noise
    place = np.array([path.at(s)[:2] for s in np.linspace(0.0, path.length, 150).tolist()])
    off = place - case.origin
    gaps = np.hypot(*(off[:, None] - road.dense[None, ::3]).transpose(2, 0, 1)).min(axis=1)
    sharpest = float(np.max(np.abs(path.table.pieces[:, kernel.KAPPA0])))
    faults = {
        "closed": path.closed != road.closed,
        f"beside by {gaps.max():.2f} m": gaps.max() > 0.2 + 1.5 * noise,
        f"length {path.length:.1f} m of {road.length:.1f}": abs(path.length - road.length)
        > 3.0 + 0.02 * road.length,
        f"curvature {sharpest:.3g} of {road.sharpest:.3g} 1/m": sharpest
        > 1.5 * road.sharpest + 0.02,
    }
    return "; ".join(text for text, wrong in faults.items() if wrong)
