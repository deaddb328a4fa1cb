"""Tables in CSV files: what stands in which line; the callers know what the columns mean."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.errors import DataError
from steersman.files import read_bytes
from steersman.types import FloatArray

# Cells, in lower case, in which nothing was measured.
_EMPTY = frozenset({"", "nan", "null", "none", "na", "n/a"})
_LONGEST_SHOWN = 40


class Sheet(NamedTuple):
    """The cells of a table, stripped of spaces and quotes, and the lines that they stand in."""

    file: FilePath
    titles: list[str]
    title_line: int
    rows: list[list[str]]
    lines: list[int]
    """Line of each row in the file, from 1."""

    def fault(self, line: int, text: str) -> DataError:
        """The error to raise about a line."""
        return DataError(f"{self.file}, line {line}: {text}")

    def numbers(self, title: str, *, gaps: bool = False) -> FloatArray:
        """The column of that title, one number for each row.

        Args:
            title: as in ``titles``.
            gaps: whether a cell may be empty, which gives NaN.

        Raises:
            DataError: a cell is missing, or holds no finite number.
        """
        place = self.titles.index(title)
        rows = zip(self.lines, self.rows, strict=True)
        return np.array([self._number(line, cells, place, gaps) for line, cells in rows])

    def _number(self, line: int, cells: list[str], place: int, gaps: bool) -> float:
        title, cell = self.titles[place], "".join(cells[place : place + 1])
        if gaps and place < len(cells) and cell.lower() in _EMPTY:
            return math.nan
        if not cell:
            raise self.fault(line, f"{title} is missing")
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            hint = "; leave the cell empty if nothing was measured" * gaps
            shown = repr(cell[:_LONGEST_SHOWN])
            raise self.fault(line, f"{title} is {shown}, not a finite number{hint}")
        return value


def read_sheet(
    file: FilePath, cure: str, is_header: Callable[[list[str]], bool], most_bytes: int = 200_000_000
) -> Sheet:
    """Read a CSV file with a header; cells are separated by semicolons, tabs or commas.

    Empty lines and comments (#) are left out. A comment above the header is the header if
    ``is_header`` says so of its cells.

    Args:
        file: the file; ~ is the user's home.
        cure: what to give instead, for the messages.
        is_header: whether cells name the columns that are needed.
        most_bytes: larger files are refused.

    Raises:
        DataError: the file cannot be read, is no text, too large, empty, or has no header.
    """
    lines = _text(file, cure, most_bytes).splitlines()
    filled = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip()]
    for k, (number, line) in enumerate(filled):
        separator = next((mark for mark in (";", "\t") if mark in line), ",")
        titles = _cells(line.lstrip("# "), separator)
        if not line.startswith("#") or is_header(titles):
            body = [(n, row) for n, row in filled[k + 1 :] if not row.startswith("#")]
            rows = [_cells(row, separator) for _, row in body]
            return Sheet(file, titles, number, rows, [n for n, _ in body])
    raise DataError(f"{file}: {'has no header' if filled else 'is empty'}; {cure}")


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip().strip("\"'") for cell in line.split(separator)]


def _text(file: FilePath, cure: str, most_bytes: int) -> str:
    data = read_bytes(file, cure, most_bytes)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise DataError(f"{file}: is not a text file; {cure}")
    return text
