"""The rows that are finished, kept line by line so that an interruption loses none of them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path as FilePath

from pydantic import ValidationError

from steersman.bench.results import BenchRow
from steersman.errors import DataError
from steersman.files import make_folder

NAME = "rows.jsonl"


def read_rows(folder: FilePath) -> dict[str, BenchRow]:
    """The finished rows of a folder by their key; nothing in it is changed.

    Raises:
        DataError: the file is no journal.
    """
    return _read(folder / NAME)[0]


def _read(file: FilePath) -> tuple[dict[str, BenchRow], int, int]:
    """Rows by key, the bytes of the lines that are whole, and those of the file."""
    try:
        text = file.read_bytes() if file.exists() else b""
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror})") from None
    whole = text[: text.rfind(b"\n") + 1]
    rows: dict[str, BenchRow] = {}
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            row = BenchRow.model_validate_json(line)
        except ValidationError:
            raise DataError(f"{file}, line {number}: not a row of a benchmark") from None
        rows[row.key] = row
    return rows, len(whole), len(text)


class Journal:
    """Rows by their key in a file of one JSON object a line.

    A line that was torn by an interruption is cut off when the journal is opened; a row is kept
    only once its whole line is on the disk.
    """

    def __init__(self, folder: FilePath) -> None:
        """Open the journal of a folder, which is made if need be.

        Raises:
            DataError: the folder cannot be made, or the file is no journal.
        """
        self.file = make_folder(folder) / NAME
        self.rows, whole, size = _read(self.file)
        if whole != size:
            os.truncate(self.file, whole)

    def add(self, rows: Iterable[BenchRow]) -> None:
        """Append rows.

        Raises:
            DataError: the file cannot be written.
        """
        new = list(rows)
        text = "".join(json.dumps(row.plain(), allow_nan=False) + "\n" for row in new)
        try:
            with self.file.open("ab") as stream:
                stream.write(text.encode())
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise DataError(f"{self.file}: cannot be written ({error.strerror})") from None
        self.rows |= {row.key: row for row in new}
