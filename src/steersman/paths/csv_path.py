"""Paths from the user's own tables."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any, ClassVar

from pydantic import field_validator

from steersman import columns as titles
from steersman.config import param, register, required
from steersman.paths.point_path import PointPath
from steersman.paths.points import COLUMNS, Points, read_points


class TablePath(PointPath):
    """A cubic spline through the rows of a table in a file."""

    file: FilePath = required("-", "table of positions, with a header or two columns x and y")
    columns: str | None = param(
        None,
        "-",
        "columns by title or number, with units if need be: x=E [km],y=3,speed=v; names: "
        f"{', '.join(COLUMNS)}",
    )

    @field_validator("columns", mode="before")
    @classmethod
    def _named(cls, value: Any) -> Any:
        if isinstance(value, dict):
            value = ",".join(f"{name}={title}" for name, title in value.items())
        if isinstance(value, str):
            titles.parse(value, COLUMNS)
        return value

    def given(self) -> dict[str, titles.Wanted]:
        """What the user says of the columns."""
        return titles.parse(self.columns or "", COLUMNS)


@register("path", "csv")
class CsvPath(TablePath):
    """A cubic spline through the points of a table: a CSV file, or a text file.

    Columns are separated by commas, semicolons, tabs, bars or blanks; commas may be decimal marks.
    A header names x and y, easting and northing (UTM), or latitude and longitude, perhaps with
    their units; it may be a comment, as numpy.savetxt and TUM's race tracks have it. A column of
    speeds (``vx_mps``, ``v``, ``speed``, ...) is what ``speed=path`` drives. Files of Racelogic's
    VBOX (``.vbo``) are such tables.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".txt", ".tsv", ".dat", ".vbo")

    def recorded(self, *, speeds: bool = False) -> Points:
        """The points of the table."""
        return read_points(self.file, self.given(), speeds=speeds)
