"""The points of a path, from a table or elsewhere, as they were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from steersman.columns import (
    ANGLE,
    LENGTH,
    SPEED,
    ExpectedColumn,
    Found,
    Wanted,
    find,
    some_titles,
)
from steersman.errors import DataError
from steersman.paths.geodetic import projected
from steersman.paths.told import left_out, other_unit
from steersman.tables import Sheet, read_sheet
from steersman.types import FloatArray

_CURE = "give a table of positions with a header like x,y or latitude,longitude"
_DEGREES = {"deg": 1.0, "rad": 1.0 / ANGLE["deg"], "min": 1.0 / 60.0}
_EAST = {**_DEGREES, "minwest": -1.0 / 60.0}
# Titles of TUM's race lines, ROS, UTM and Gauss-Krueger.
_X = (
    *("x_ref", "pos_x", "x_pos", "position_x", "pose_position_x"),
    *("east", "easting", "utm_x", "x_utm", "utm_east", "utm_easting", "ost", "ostwert"),
    "rechtswert",
)
_Y = (
    *("y_ref", "pos_y", "y_pos", "position_y", "pose_position_y"),
    *("north", "northing", "utm_y", "y_utm", "utm_north", "utm_northing", "nord", "nordwert"),
    "hochwert",
)
_LATITUDE, _LONGITUDE = ("lat", "breitengrad"), ("lon", "long", "lng", "laengengrad")
_SPEED = (
    "vx",
    "v",
    "ref_v",
    "v_x",
    "velocity",
    "longitudinal_velocity",
    "vel",
    "geschwindigkeit",
    "geschw",
)
COLUMNS = {
    "x": ExpectedColumn("position to the east, or ahead", LENGTH, _X),
    "y": ExpectedColumn("position to the north, or to the left", LENGTH, _Y),
    "latitude": ExpectedColumn("latitude, north positive", _DEGREES, _LATITUDE, ("breite",)),
    "longitude": ExpectedColumn("longitude, east positive", _EAST, _LONGITUDE, ("laenge",)),
    "speed": ExpectedColumn("speed", SPEED, _SPEED),
}
MOST_BYTES = 50_000_000
_FARTHEST = 1e8
# A shorter path in "metres" of such numbers is one in degrees [m].
_TOO_SHORT = 1.0
# A longer one [m] in even steps is in millimetres; points so far apart [m] are told.
_TOO_LONG, _FAR_APART = 250_000.0, 100.0
_PAIR = 2
# Largest latitude, and longitude as some write it [deg].
_NORTHMOST, _ROUND = 90.0, 360.0


class Points(NamedTuple):
    """Points of a path and where they stand in their file."""

    file: FilePath
    x: FloatArray
    y: FloatArray
    lines: list[int]
    closed: bool | None
    """Whether the last one is followed by the first; None: where it is near."""
    counted: str = "line"
    """What ``lines`` count."""
    speed: FloatArray | None = None
    """Speed at each point [m/s]; None: it is not known, or was not read."""
    notes: tuple[str, ...] = ()
    """What was assumed or changed, a clause each."""
    hint: str = ""
    """What ends every message about them."""

    @property
    def place(self) -> FloatArray:
        """Positions, shape (n, 2) [m]."""
        return np.column_stack((self.x, self.y))

    def rows(self, rows: NDArray[np.int64]) -> Points:
        """Some of the points."""
        return self.moved(self.place[rows], rows)

    def moved(self, place: FloatArray, rows: NDArray[np.int64]) -> Points:
        """Points at other places, each with the line and the speed of one of these."""
        speed = None if self.speed is None else self.speed[rows]
        lines = [self.lines[row] for row in rows.tolist()]
        x, y = np.ascontiguousarray(place.T)
        return self._replace(x=x, y=y, lines=lines, speed=speed)

    def noted(self, text: str) -> Points:
        """The same with one more note."""
        return self._replace(notes=(*self.notes, text))

    def fault(self, row: int, text: str) -> DataError:
        """The error to raise about the point ``row``."""
        place = f"{self.counted} {self.lines[row % len(self.lines)]}"
        return DataError(f"{self.file}, {place}: {text}{self.hint}")

    def error(self, text: str) -> DataError:
        """The error to raise about all of them."""
        return DataError(f"{self.file}: {text}{self.hint}")


def read_points(
    file: FilePath, columns: Mapping[str, Wanted] | None = None, *, speeds: bool = False
) -> Points:
    """The points of a table.

    Rows without any position are left out: nothing was measured there.

    Args:
        file: the table.
        columns: titles or numbers of the columns x and y, or latitude and longitude, and speed.
        speeds: whether a column of speeds is read, if there is one.

    Raises:
        DataError: the file cannot be used; one line says where and what to do.
    """
    given = dict(columns or {})
    named = {name: wanted for name, wanted in given.items() if not wanted.title.isdecimal()}

    def is_header(titles: list[str]) -> bool:
        try:
            return _pair(find(Sheet(file, titles, 0, [], []), COLUMNS, named)) is not None
        except DataError:  # without what the user names; or in another unit, told with its line
            return not named

    return points_of(read_sheet(file, _CURE, is_header, MOST_BYTES), given, speeds=speeds)


def has_positions(sheet: Sheet, columns: Mapping[str, Wanted] | None = None) -> bool:
    """Whether a table has columns of positions, those that the user names among them."""
    try:
        return _pair(find(sheet, COLUMNS, columns)) is not None
    except DataError:
        return False


def has_speeds(sheet: Sheet, columns: Mapping[str, Wanted] | None = None) -> bool:
    """Whether a table has a column of speeds as well."""
    return has_positions(sheet, columns) and "speed" in find(sheet, COLUMNS, columns)


def points_of(
    sheet: Sheet, columns: Mapping[str, Wanted] | None = None, *, speeds: bool = False
) -> Points:
    """The points of a table that was read; as ``read_points``."""
    given = dict(columns or {})
    notes: tuple[str, ...] = ()
    if not sheet.headed and not given:
        given, notes = _unnamed(sheet)
    found = find(sheet, COLUMNS, given)
    pair = _pair(found, {"latitude", "longitude"} <= given.keys())
    if pair is None:
        raise _lacking(sheet, found)
    first, second = (sheet.numbers(found[name].place, gaps=True) for name in pair)
    empty = np.isnan(first) & np.isnan(second)
    for name, values in zip(pair, (first, second), strict=True):
        alone = np.flatnonzero(np.isnan(values) & ~empty)
        if alone.size:  # the other one is there: the same reading says what the cell holds
            raise _of_cell(sheet, found[name].place, int(alone[0]))
    a, b = (found[name].factor * values for name, values in zip(pair, (first, second), strict=True))
    if pair == ("latitude", "longitude"):
        empty |= (a == 0.0) & (b == 0.0)  # what receivers write without a fix
    rows = np.flatnonzero(~empty)
    points = Points(sheet.file, a, b, sheet.lines, None, sheet.counted, notes=notes)
    if speeds and "speed" in found:
        points = points._replace(speed=_speeds(sheet, found["speed"]))
    points = points.rows(rows)
    points = _checked(points, pair, sheet, found)
    return points.noted(left_out(points.place, sheet, rows)) if empty.any() else points


def _pair(found: Mapping[str, Found], geodetic: bool = False) -> tuple[str, str] | None:
    """The two columns of positions; None if there are none."""
    pairs = [("x", "y"), ("latitude", "longitude")]
    known = [pair for pair in pairs if found.keys() >= set(pair)]
    return (known[-1] if geodetic else known[0]) if known else None


def _unnamed(sheet: Sheet) -> tuple[dict[str, Wanted], tuple[str, ...]]:
    """The columns of a table without a header, if it has just two."""
    if len(sheet.titles) != _PAIR:
        raise sheet.fault(
            sheet.title_line,
            f"no header names the {len(sheet.titles)} columns; set columns to x=NUMBER,y=NUMBER,"
            f" or put a line like x,y on top",
        )
    return {"x": Wanted("1"), "y": Wanted("2")}, (
        "without a header its two columns are x and y [m]",
    )


def _lacking(sheet: Sheet, found: Mapping[str, Found]) -> DataError:
    names = ("latitude", "longitude") if {"latitude", "longitude"} & found.keys() else ("x", "y")
    lacking = " and ".join(name for name in names if name not in found)
    cure = f"set columns to {names[0]}=TITLE,{names[1]}=TITLE"
    cure += " or latitude=TITLE,longitude=TITLE" if names[0] == "x" else ""
    return sheet.fault(
        sheet.title_line, f"no column {lacking} in {some_titles(sheet.titles)!r}; {cure}"
    )


def _of_cell(sheet: Sheet, place: int, row: int) -> DataError:
    """The fault of a cell that holds no number."""
    one = sheet._replace(rows=[sheet.rows[row]], lines=[sheet.lines[row]])
    try:
        one.numbers(place)
    except DataError as error:
        return error
    return sheet.fault(sheet.lines[row], f"{sheet.titles[place]} is missing")


def _speeds(sheet: Sheet, found: Found) -> FloatArray:
    """The column of speeds [m/s]."""
    title = sheet.titles[found.place]
    speed = sheet.numbers(found.place) * found.factor
    back = np.flatnonzero(speed < 0.0)
    if back.size:
        raise sheet.fault(sheet.lines[int(back[0])], f"{title} must not be negative")
    return speed


def refuse_far(points: Points) -> None:
    """Refuse positions whose distances would be no numbers.

    Raises:
        DataError: there is one.
    """
    far = np.flatnonzero(np.maximum(np.abs(points.x), np.abs(points.y)) > _FARTHEST)
    if far.size:
        row = int(far[0])
        place = f"({points.x[row]:g}, {points.y[row]:g})"
        raise points.fault(row, f"{place} is too far; positions are in metres")


def _checked(
    points: Points, pair: tuple[str, str], sheet: Sheet, found: Mapping[str, Found]
) -> Points:
    """Points in metres, each where the earth or a road can be."""
    if pair == ("latitude", "longitude"):
        return in_the_plane(points)
    refuse_far(points)
    x, y = (sheet.titles[found[name].place] for name in pair)
    chords = np.hypot(np.diff(points.x), np.diff(points.y))
    length, usual = float(np.sum(chords)), float(np.median(chords)) if chords.size else 0.0
    if 0.0 < length < _TOO_SHORT and np.all(np.abs(points.y) <= _NORTHMOST):
        raise DataError(
            f"{points.file}: the path is {length:.2g} m long; if it is in degrees, set"
            f" columns to longitude={x},latitude={y}, if in km, to x_km={x},y_km={y}"
        )
    apart = f"the points are {usual:.0f} m apart"
    if usual * chords.size > _TOO_LONG:
        raise DataError(
            f"{points.file}: {apart}, the path {1e-3 * length:.0f} km long; give positions in"
            f" metres, or if they are in mm, set columns to x_mm={x},y_mm={y}"
        )
    if usual > _FAR_APART:
        points = points.noted(f"{apart}; if they are in cm, set columns to x_cm={x},y_cm={y}")
    return points


def in_the_plane(points: Points) -> Points:
    """Points whose x and y are latitude and longitude [deg], in metres.

    Raises:
        DataError: one is not on the earth.
    """
    latitude, longitude = points.x, points.y
    off = np.flatnonzero((np.abs(latitude) > _NORTHMOST) | (np.abs(longitude) > _ROUND))
    if off.size:
        row = int(off[0])
        place = f"({latitude[row]:g}, {longitude[row]:g})"
        raise points.fault(
            row, f"{place} is no latitude and longitude in degrees{other_unit(latitude, longitude)}"
        )
    if not latitude.size:
        return points
    plane = projected(np.deg2rad(latitude), np.deg2rad(longitude))
    origin = f"({latitude[0]:.7f}, {longitude[0]:.7f})"
    return points._replace(x=plane.east, y=plane.north).noted(
        f"latitude and longitude become metres east and north of {origin}"
    )
