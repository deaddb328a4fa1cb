"""Paths from JSON files: race lines, waypoints and tracks as programs write them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any, ClassVar, NamedTuple

from steersman.config import param, register
from steersman.errors import DataError
from steersman.files import read_json
from steersman.paths.csv_path import TablePath
from steersman.paths.points import Points, has_positions, has_speeds, points_of
from steersman.tables import Sheet

_LEAST, _PAIR = 2, 2


class _Table(NamedTuple):
    """A table somewhere in a JSON file."""

    place: str
    """The names that lead to it, with points between."""
    sheet: Sheet


@register("path", "json")
class JsonPath(TablePath):
    """A cubic spline through the points of a JSON file.

    Points are read as lists of numbers by name (``{"x": [...], "y": [...]}``), as a list of objects
    (``[{"x": 1, "y": 2}, ...]``, whose inner names join: ``pose_position_x``), or as a list of
    pairs, wherever in the file they stand. Names and units are those of tables.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".json",)

    number: int | None = param(
        None,
        "-",
        "which of the file's tables, from 1; null: of those with speeds, else of all, the longest",
        ge=1,
    )

    def recorded(self, *, speeds: bool = False) -> Points:
        """The points of the table.

        Raises:
            DataError: the file cannot be read, or has no such table.
        """
        data = read_json(self.file)
        if isinstance(data, dict) and data.get("type") in {"FeatureCollection", "Feature"}:
            raise DataError(f"{self.file}: is GeoJSON; write path=geojson path.file={self.file}")
        given = self.given()
        tables = list(_tables(self.file, data, ""))
        found = [table for table in tables if has_positions(table.sheet, given)]
        found = found or tables * bool(given)  # reading it says which name is not there
        if not found:
            raise DataError(
                f"{self.file}: holds no lists x and y, no list of objects with x and y and none of"
                f" pairs; other names are given with columns=x=NAME,y=NAME"
            )
        if self.number is not None and self.number > len(found):
            raise DataError(
                f"{self.file}: number {self.number} is not among its {len(found)} tables"
            )
        ranks = [(has_speeds(table.sheet, given), len(table.sheet.rows)) for table in found]
        row = ranks.index(max(ranks)) if self.number is None else self.number - 1
        points = points_of(found[row].sheet, given, speeds=speeds)
        if len(found) > 1 and self.number is None:
            place = found[row].place or "the outermost"
            points = points.noted(f"table {row + 1} of {len(found)}, {place} (path.number)")
        return points


def _tables(file: FilePath, value: Any, place: str) -> Iterator[_Table]:
    """All tables within a value."""
    if isinstance(value, dict):
        yield from _of_lists(file, value, place)
        for name, inner in value.items():
            yield from _tables(file, inner, f"{place}.{name}" if place else str(name))
    elif isinstance(value, list) and len(value) >= _LEAST:
        if all(isinstance(each, dict) for each in value):
            rows = [dict(_leaves(each, "")) for each in value]
            titles = list(rows[0])
            yield _table(file, place, titles, [[row.get(t, "") for t in titles] for row in rows])
        elif all(isinstance(each, list) and _is_row(each) for each in value):
            width = min(map(len, value))
            titles = ["x", "y", *map(str, range(_PAIR + 1, width + 1))]
            yield _table(file, place, titles, [[_cell(v) for v in row[:width]] for row in value])


def _of_lists(file: FilePath, value: dict[str, Any], place: str) -> Iterator[_Table]:
    """Lists of numbers side by side; those of one length are a table."""
    columns = {
        str(name): [_cell(each) for each in inner]
        for name, inner in value.items()
        if isinstance(inner, list) and len(inner) >= _LEAST and all(map(_is_number, inner))
    }
    for size in dict.fromkeys(map(len, columns.values())):
        titles = [title for title, cells in columns.items() if len(cells) == size]
        rows = [list(row) for row in zip(*(columns[title] for title in titles), strict=True)]
        yield _table(file, place, titles, rows)


def _leaves(value: dict[str, Any], name: str) -> Iterator[tuple[str, str]]:
    """The numbers in an object, by the names that lead to them."""
    for key, inner in value.items():
        whole = f"{name}_{key}" if name else str(key)
        if isinstance(inner, dict):
            yield from _leaves(inner, whole)
        elif _is_number(inner):
            yield whole, _cell(inner)


def _table(file: FilePath, place: str, titles: list[str], rows: list[list[str]]) -> _Table:
    lines = list(range(1, len(rows) + 1))
    return _Table(place, Sheet(file, titles, 1, rows, lines, counted="point"))


def _is_row(value: list[Any]) -> bool:
    return len(value) >= _PAIR and all(map(_is_number, value))


def _is_number(value: Any) -> bool:
    return value is None or type(value) in {int, float}


def _cell(value: float | None) -> str:
    """A number as a table has it; nothing where none was measured."""
    return "" if value is None or math.isnan(value) else repr(value)
