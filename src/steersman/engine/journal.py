"""Results kept line by line, so that an interruption loses none of those that are finished."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, Generic, NamedTuple, TypeVar

from steersman.errors import DataError
from steersman.files import make_folder

T = TypeVar("T")


class LineFormat(NamedTuple, Generic[T]):
    """How the results of one sort of job are written as lines of JSON."""

    what: str
    """Name of a line in messages, e.g. "a row of a benchmark"."""
    load: Callable[[bytes], T]
    """A result from a line; raises ValueError, TypeError or KeyError."""
    dump: Callable[[T], dict[str, Any]]
    key: Callable[[T], str]


def read_journal(file: FilePath, form: LineFormat[T]) -> dict[str, T]:
    """The finished results in a file by their key; nothing in it is changed.

    Raises:
        DataError: the file is no such journal.
    """
    return _read(file, form)[0]


def _read(file: FilePath, form: LineFormat[T]) -> tuple[dict[str, T], int, int]:
    """Results by key, the bytes of the lines that are whole, and those of the file."""
    try:
        text = file.read_bytes() if file.exists() else b""
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror})") from None
    whole = text[: text.rfind(b"\n") + 1]
    results: dict[str, T] = {}
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            result = form.load(line)
            results[form.key(result)] = result
        except (ValueError, TypeError, KeyError):
            raise DataError(f"{file}, line {number}: not {form.what}") from None
    return results, len(whole), len(text)


class Journal(Generic[T]):
    """Results by their key in a file of one JSON object a line.

    A line that was torn by an interruption is cut off when the journal is opened; a result counts
    as finished only once its whole line is on the disk.
    """

    def __init__(self, file: FilePath, form: LineFormat[T]) -> None:
        """Open the journal; its folder is made if need be.

        Raises:
            DataError: the folder cannot be made, or the file is no such journal.
        """
        make_folder(file.parent)
        self.file, self.form = file, form
        self.results, whole, size = _read(file, form)
        if whole != size:
            os.truncate(file, whole)

    def add(self, *results: T) -> None:
        """Append results.

        Raises:
            DataError: the file cannot be written.
        """
        lines = [json.dumps(self.form.dump(result), allow_nan=False) + "\n" for result in results]
        try:
            with self.file.open("ab") as stream:
                stream.write("".join(lines).encode())
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise DataError(f"{self.file}: cannot be written ({error.strerror})") from None
        self.results |= {self.form.key(result): result for result in results}
