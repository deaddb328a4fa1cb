"""Numbers in few bytes: columns of whole multiples of a step, and pages' scripts that read them.

A column is rounded to multiples of its step (its ``q``), and of these the differences are kept,
sign in the lowest bit, in groups of seven bits (as in protocol buffers' ``sint64``). Signals of a
drive change little from row to row, so most differences take a byte or two; gzip takes a third of
that away again.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steersman.types import FloatArray

# Multiples stay below this, so that the script can decode them in 32 bits.
_LARGEST = 2.0**28
_GROUP, _MORE = 7, 128


class Blob:
    """The bytes of all columns of a page, one behind the other."""

    def __init__(self) -> None:
        """Start without any."""
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: ArrayLike, step: float) -> dict[str, Any]:
        """Append a column.

        Args:
            values: numbers of any shape, read in C order; what is not finite stays a gap.
            step: resolution, in the unit of the values; coarser where they are too large for it.

        Returns:
            Where it is: ``at`` (byte), ``n`` (numbers), ``q`` (their step) and, if there are any,
            ``gaps``: pairs of the first number that is missing and the first that is not.
        """
        numbers = np.asarray(values, dtype=np.float64).ravel()
        known = np.isfinite(numbers)
        largest = float(np.abs(numbers[known]).max(initial=0.0))
        step = max(step, largest / _LARGEST)
        whole = np.rint(_filled(numbers, known) / step).astype(np.int64)
        content = varints(np.diff(whole, prepend=0))
        entry: dict[str, Any] = {"at": self._size, "n": numbers.size, "q": step}
        if not known.all():
            entry["gaps"] = _spans(~known)
        self._parts.append(content)
        self._size += len(content)
        return entry

    def packed(self) -> str:
        """All columns, as :func:`packed`."""
        return packed(b"".join(self._parts))


def packed(content: bytes | str) -> str:
    """Compressed (with no time stamp: same content, same page) and in letters of base64."""
    raw = content.encode() if isinstance(content, str) else content
    return base64.b64encode(gzip.compress(raw, mtime=0)).decode()


def varints(numbers: NDArray[np.int64]) -> bytes:
    """Whole numbers in groups of seven bits, the lowest first; the eighth bit says: more follow.

    >>> varints(np.array([0, -1, 1, 64])).hex()
    '0001028001'
    """
    rest = (numbers << 1) ^ (numbers >> 63)
    groups, wanted = [], []
    more = np.ones(numbers.shape, dtype=bool)
    while more.any():
        wanted.append(more)
        groups.append(rest % _MORE)
        rest = rest >> _GROUP
        more = rest > 0
    if not groups:
        return b""
    table = np.stack(groups, axis=1)
    kept = np.stack(wanted, axis=1)
    # All but a number's last group say that more follow.
    table[:, :-1] += _MORE * kept[:, 1:]
    content: bytes = table.astype(np.uint8)[kept].tobytes()
    return content


def _filled(numbers: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """Missing numbers are packed as zero, and marked as missing."""
    return np.where(known, numbers, 0.0)


def _spans(marked: NDArray[np.bool_]) -> list[list[int]]:
    """First row, and the row behind the last, of each stretch of marked rows."""
    return [list(span) for span in stretches(marked)]


def stretches(marked: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
    """First row, and the row behind the last, of each stretch of marked rows.

    >>> list(stretches(np.array([True, False, True, True])))
    [(0, 1), (2, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
