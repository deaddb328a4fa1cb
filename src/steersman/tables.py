"""Tables in text files: what stands in which line; the callers know what the columns mean."""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.errors import NMEA, DataError
from steersman.files import read_bytes
from steersman.numerals import DECIMAL_COMMA, SURE, value
from steersman.types import FloatArray
from steersman.vbox import is_section, read_vbox

# Cells, in lower case, in which nothing was measured.
_EMPTY = frozenset({"", "nan", "null", "none", "na", "n/a"})
_LONGEST_SHOWN = 40
_COMMENT = ("#", "%", "//")
# What separates cells, the most telling first; None: blanks.
_SEPARATORS = (";", "\t", "|", ",", None)
# Rows that are looked at to find the separator; those without words, if there are any.
_SAMPLE, _WORD = 50, re.compile(r"[^\W\d_]{2}|^\W*[^\W\d_]")
# What tells Excel the separator, which is found without it.
_EXCEL = re.compile(r"sep=.?$", re.IGNORECASE)
# Words in a title.
_LONGEST_TITLE = 2
# Rows that are looked at to find the mark.
_MARKED = 1000
_BLANKS_BEFORE_UNIT = re.compile(r"(?<=\w)\s+(?=[\[(])")
# What a row beneath the titles holds, if it is one of units.
_UNITS = re.compile(
    r"-|1|%|[kcmuµn]?m|ft|feet|inch|in|yd|(centi|milli)?met(re|er)s?|h|min|sec|[mun]?s|deg|rad|°|grad"
    r"|m?m/s|kmh?|km/h|kph|mph|kn|kt|(rad|deg|°|1)/(s|min|m)|m?m/s\^?[2²]|g|k?n|n?m|k?n/m|m?[va]|bar"
    r"|k?pa|rpm|u/min|hz|kg"
)
# Sentences of a receiver.
_NMEA = re.compile(rb"\s*\$(G[A-Z]|B[DM]|QZ)[A-Z]{3},")
# What files begin with that are not UTF-8.
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}


class Sheet(NamedTuple):
    """The cells of a table, stripped of spaces and quotes, and the lines that they stand in."""

    file: FilePath
    titles: list[str]
    title_line: int
    rows: list[list[str]]
    lines: list[int]
    """Line of each row in the file, from 1."""
    headed: bool = True
    """Whether a line names the columns; else the titles are their numbers from 1."""
    counted: str = "line"
    """What ``lines`` count."""

    def fault(self, line: int, text: str) -> DataError:
        """The error to raise about a line."""
        return DataError(f"{self.file}, {self.counted} {line}: {text}")

    def numbers(self, title: str | int, *, gaps: bool = False) -> FloatArray:
        """A column as one number for each row; a comma may be the decimal mark.

        Thousands may be set apart by points, commas, apostrophes or blanks.

        Args:
            title: as in ``titles``, or its place there.
            gaps: whether a cell may be empty, which gives NaN.

        Raises:
            DataError: a cell is missing, or holds no finite number.
        """
        place = title if isinstance(title, int) else self.titles.index(title)
        rows, mark = zip(self.lines, self.rows, strict=True), self._mark()
        return np.array([self._number(line, cells, place, gaps, mark) for line, cells in rows])

    def _mark(self) -> str:
        """What sets thousands apart in this table: a point, a comma, or nothing."""
        several = (c for row in self.rows[:_MARKED] for c in row if c.count(".") + c.count(",") > 1)
        marks = [mark for cell in several for mark in SURE if SURE[mark].fullmatch(cell)]
        return marks[0] if marks else ""

    def _number(self, line: int, cells: list[str], place: int, gaps: bool, mark: str) -> float:
        title, cell = self.titles[place], "".join(cells[place : place + 1])
        if gaps and place < len(cells) and cell.lower() in _EMPTY:
            return math.nan
        if not cell:
            raise self.fault(line, f"{title} is missing")
        number = value(cell, mark)
        if not math.isfinite(number):
            hint = "; leave the cell empty if nothing was measured" * gaps
            shown = repr(cell[:_LONGEST_SHOWN])
            raise self.fault(line, f"{title} is {shown}, not a finite number{hint}")
        return number


def read_sheet(
    file: FilePath, cure: str, is_header: Callable[[list[str]], bool], most_bytes: int = 200_000_000
) -> Sheet:
    """Read a table; cells are separated by semicolons, tabs, bars, commas or blanks.

    Empty lines, comments (#, %, //), Excel's first line ``sep=;`` and what stands above the header
    are left out; a row of units beneath it belongs to it. A comment above the table is its header
    if ``is_header`` says so of its cells, or if the table has no other and the comment has as many
    cells as its rows. Without any header the titles are the numbers of the columns.

    Args:
        file: the file; ~ is the user's home.
        cure: what to give instead, for the messages.
        is_header: whether cells name the columns that are needed.
        most_bytes: larger files are refused.

    Raises:
        DataError: the file cannot be read, is no text, too large, empty, or only has comments.
    """
    lines = _text(file, cure, most_bytes).splitlines()
    numbered = enumerate((line.strip() for line in lines), 1)
    filled = [(n, line) for n, line in numbered if line and not (n == 1 and _EXCEL.match(line))]
    if (vbox := read_vbox(filled)) is not None:
        return _sheet(file, vbox.titles, vbox.line, vbox.rows)
    filled = _once([(n, line) for n, line in filled if not is_section(line)])
    body = [(number, line) for number, line in filled if not line.startswith(_COMMENT)]
    comments = [(n, line.lstrip("#%/ ")) for n, line in filled if line.startswith(_COMMENT)]
    # Lines of words have blanks and commas of their own.
    sample = [line for _, line in body if not _WORD.search(line)][:_SAMPLE]
    separator = _separator(
        sample or [line for _, line in body[1 : _SAMPLE + 1] or body or comments]
    )
    rows = [(number, _cells(line, separator)) for number, line in body]
    some = [_cells(line, separator) for line in sample] or [row for _, row in rows[1:] or rows]
    width = Counter(map(len, some[:_SAMPLE])).most_common(1)
    count = width[0][0] if width else 0
    data = next((k for k, (_, row) in enumerate(rows) if _is_numeric(row, count)), 0)
    above = [(n, line) for n, line in comments if not body or n < body[data][0]]
    for number, line in above:
        titles = _titles(line, count)
        if is_header(titles):
            return _sheet(file, titles, number, rows[data:])
    first = _first(body, data, count, is_header)
    numeric = bool(rows) and _is_numeric(rows[first][1], count)
    body, rows = body[first:], rows[first:]
    if numeric:
        for number, line in reversed(above):
            titles = _titles(line, count)
            if len(titles) == count > 1 and separator and not _is_prose(line, titles, separator):
                return _sheet(file, titles, number, rows)
        numbers = [str(k + 1) for k in range(count)]
        return _sheet(file, numbers, rows[0][0], rows)._replace(headed=False)
    if rows:
        titles, rest = _titles(body[0][1], count), rows[1:]
        if rest and _are_units(rest[0][1]) and len(rest[0][1]) == len(titles):
            titles, rest = _with_units(titles, rest[0][1]), rest[1:]
        return _sheet(file, titles, body[0][0], rest)
    raise DataError(f"{file}: {'has no header' if filled else 'is empty'}; {cure}")


def _once(lines: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Lines without what repeats an earlier one and holds no number: a logger that began anew."""
    seen: set[str] = set()
    out = []
    for number, line in lines:
        if line in seen and not line.startswith(_COMMENT):
            cells = re.split(r"[;\t|, ]", line)
            if all(cell.lower() not in _EMPTY and math.isnan(value(cell)) for cell in cells):
                continue
        seen.add(line)
        out.append((number, line))
    return out


def _first(
    body: Sequence[tuple[int, str]],
    data: int,
    count: int,
    is_header: Callable[[list[str]], bool],
) -> int:
    """The row that names the columns, or else holds the first numbers: above are a logger's words.

    It is the first one that ``is_header`` takes, or that as many cells lead from to the numbers.
    """
    for k, (_, line) in enumerate(body[: min(data or len(body), _SAMPLE)]):
        if is_header(_titles(line, count)):
            return k
    first = data
    while first > 0 and len(titles := _titles(body[first - 1][1], count)) == count:
        first -= 1
        if not _are_units(titles):
            break
    return first


def _is_numeric(row: Sequence[str], count: int) -> bool:
    """Whether a row has so many cells, and no word."""
    filled = [cell for cell in row if cell]
    return len(row) == count and not any(math.isnan(value(cell)) for cell in filled)


def _are_units(row: Sequence[str]) -> bool:
    """Whether a row beneath the titles has a unit for most, and no number."""
    known = [_UNITS.fullmatch(cell.strip("[]()<> ").lower()) for cell in row if cell]
    return bool(known) and all(known) and any(cell not in "-1" for cell in row)


def _with_units(titles: Sequence[str], units: Sequence[str]) -> list[str]:
    """Titles with the units that stand beneath them, as if behind them."""
    bare = [unit.strip("[]()<> ") for unit in units]
    pairs = zip(titles, bare, strict=True)
    return [f"{t} [{unit}]" if unit and not set("[(<") & set(t) else t for t, unit in pairs]


def _sheet(
    file: FilePath, titles: list[str], line: int, rows: Sequence[tuple[int, list[str]]]
) -> Sheet:
    return Sheet(file, titles, line, [row for _, row in rows], [number for number, _ in rows])


def _separator(rows: Sequence[str]) -> str | None:
    """What separates the cells of most rows."""
    for mark in _SEPARATORS:
        if mark is None or (rows and 2 * sum(mark in row for row in rows) >= len(rows)):
            blanks = mark == "," and all(_are_decimal_commas(row) for row in rows)
            return None if blanks else mark
    return None


def _are_decimal_commas(row: str) -> bool:
    """Whether blanks separate the row's numbers, and commas are marks within them."""
    cells = row.split()
    return len(cells) > 1 and all(
        any(kind.fullmatch(c) for kind in (DECIMAL_COMMA, *SURE.values())) or c.isdecimal()
        for c in cells
    )


def _titles(line: str, count: int) -> list[str]:
    """The cells of a header, which may be separated in another way than the rows' ``count``."""
    ways = [_cells(line, mark) for mark in _SEPARATORS if mark is None or mark in line]
    return next((cells for cells in ways if len(cells) == count), ways[0])


def _is_prose(line: str, titles: Sequence[str], separator: str) -> bool:
    """Whether a comment is a remark, rather than the titles of columns."""
    return separator not in line or any(len(t.split()) > _LONGEST_TITLE for t in titles)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return [cell.strip("\"'") for cell in _BLANKS_BEFORE_UNIT.sub("", line).split()]
    cells = line.split(separator)
    if '"' in line:  # a separator inside quotes separates nothing
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [cell.strip().strip("\"'") for cell in cells]


def _text(file: FilePath, cure: str, most_bytes: int) -> str:
    data = read_bytes(file, cure, most_bytes)
    if data[:2] == b"PK":
        raise DataError(f"{file}: is no text, but an archive like those of Excel; save it as CSV")
    if _NMEA.match(data):
        raise DataError(f"{file}: {NMEA}")
    try:
        text = data.decode(_MARKS.get(data[:2], "utf-8-sig"))
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # what spreadsheets in Europe write: only titles have accents
    if "\0" in text:
        raise DataError(f"{file}: is not a text file; {cure}")
    return text
