"""Tables in CSV files: what stands in which line; the callers know what the columns mean."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import NamedTuple

from steersman.errors import DataError


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
    place = FilePath(os.path.expanduser(file))
    if place.is_dir():
        raise DataError(f"{file}: is a folder; {cure}")
    try:
        with place.open("rb") as stream:
            data = stream.read(most_bytes + 1)
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror}); {cure}") from None
    except ValueError:
        raise DataError(f"{str(file)!r}: is not the name of a file; {cure}") from None
    if len(data) > most_bytes:
        raise DataError(f"{file}: is larger than {most_bytes // 1_000_000} MB; thin it out")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise DataError(f"{file}: is not a text file; {cure}")
    return text
