"""What is told about elements of a map: one that cannot be read costs itself, and a line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, TypeVar

from steersman.errors import DataError
from steersman.paths.xodr.model import MapFault

T = TypeVar("T")
# Lines about what cannot be read.
_MOST_NOTES = 1000


class MapNotes:
    """Lines about the elements of a file, each with its road and what was done."""

    def __init__(self, file: FilePath) -> None:
        """None yet."""
        self.file, self.road, self._found, self._more = file, "", list[MapFault](), 0

    def without(self, what: str, read: Callable[..., T], *words: Any, default: T) -> T:
        """What ``read`` makes of ``words``; if it raises, ``default`` and a line."""
        try:
            return read(*words)
        except DataError as error:
            self.add(error, f"{what} left out")
            return default

    def add(self, fault: DataError, done: str) -> None:
        """A line: what is wrong, and what was done about it."""
        if len(self._found) >= _MOST_NOTES:
            self._more += 1
            return
        text = str(fault).removeprefix(f"{self.file}: ")
        self._found.append(MapFault(self.road, None, f"{text}; {done}"))

    @property
    def found(self) -> tuple[MapFault, ...]:
        """All lines, or the first of very many."""
        more = (MapFault("", None, f"{self._more} more elements left out"),) if self._more else ()
        return (*self._found, *more)
