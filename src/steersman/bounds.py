"""Bounds of what is read from files of unknown origin, JSON and archives of arrays within them."""

from __future__ import annotations

import io
import json
import math
import zipfile
from typing import Any, BinaryIO

import numpy as np

from steersman.errors import ConfigError, one_line, shortened

DEEPEST, MOST_DIGITS = 50, 300
"""How deep plain data may nest, and the digits of a whole number: it still fits a float."""
MOST_JSON = 20_000_000
"""Largest JSON file that is read [bytes]."""
MOST_ARRAYS = 400_000_000
"""Most that the arrays of a compressed file may take [bytes]."""
# Ends of member names that hold one array each, and kinds of numpy's types that are plain.
_ARRAY, _PLAIN = ".npy", "biufU"


def in_order(of: object, low: str, high: str, unit: str) -> None:
    """Refuse a range whose ends, two fields of ``of``, are the wrong way round.

    Raises:
        ConfigError: they are.
    """
    least, most = getattr(of, low), getattr(of, high)
    if least > most:
        raise ConfigError(f"{low} {least} {unit} is more than {high} {most} {unit}")


def from_json(text: str | bytes) -> Any:
    """The plain data of a JSON text.

    Raises:
        ValueError: it is not JSON, nests deeper than ``DEEPEST``, or has an absurd number.
    """
    try:
        data = json.loads(text, parse_int=_whole)
    except RecursionError:
        raise ValueError(f"nests deeper than {DEEPEST} levels") from None
    level = [data]
    for _ in range(DEEPEST):
        level = [inner for value in level for inner in _inner(value)]
    if level:
        raise ValueError(f"nests deeper than {DEEPEST} levels")
    return data


def _inner(value: Any) -> Any:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def _whole(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(f"a number has more than {MOST_DIGITS} digits")
    return int(text)


def read_arrays(stream: BinaryIO, most: int | None = None) -> dict[str, Any]:
    """The arrays of an ``.npz`` file by their names; nothing is unpacked that claims too much.

    Args:
        stream: the file.
        most: what all arrays may take together [bytes]; None: the size of the file, which is
            right where nothing is compressed.

    Raises:
        ValueError: it is damaged, no such file, or its arrays are too large.
        OSError: it cannot be read.
    """
    if most is None:
        most = stream.seek(0, io.SEEK_END)
    try:
        with zipfile.ZipFile(stream) as archive:
            total = sum(member.file_size for member in archive.infolist())
            if total > most:
                raise ValueError(f"unpacks to {total / 1e6:.0f} MB, the most is {most / 1e6:.0f}")
            return {
                name.removesuffix(_ARRAY): _array(name, archive.read(name))
                for name in archive.namelist()
            }
    except OSError:
        raise
    # For a damaged header zipfile and numpy raise errors of many classes.
    except Exception as error:  # noqa: BLE001
        raise ValueError(shortened(one_line(str(error)) or type(error).__name__, 200)) from None


def _array(name: str, data: bytes) -> Any:
    """The array of a member, whose size is known to be right before memory is taken for it."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    head = np.lib.format.read_array_header_1_0 if version == (1, 0) else None
    shape, _, dtype = (head or np.lib.format.read_array_header_2_0)(stream)
    if dtype.kind not in _PLAIN:
        raise ValueError(f"{name} holds {dtype}, not numbers")
    if math.prod(shape) * dtype.itemsize != len(data) - stream.tell() or not dtype.itemsize:
        raise ValueError(f"{name} does not have the size that its shape says")
    stream.seek(0)
    return np.lib.format.read_array(stream, allow_pickle=False)
