"""Tables as files that other programs read: CSV, MATLAB's MAT, Parquet."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, TypeAlias

import numpy as np

from steersman.errors import DataError, SteersmanError, how_to_install
from steersman.files import replacing, write_text
from steersman.types import FloatArray

Columns: TypeAlias = Mapping[str, Sequence[Any] | FloatArray]
# The longest name of a variable in MATLAB.
_LONGEST = 63


def flat(row: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as ``outer.inner``.

    >>> flat({"a": 1, "b": {"c": 2}})
    {'a': 1, 'b.c': 2}
    """
    out: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, Mapping):
            out |= flat(value, f"{prefix}{name}.")
        else:
            out[f"{prefix}{name}"] = value
    return out


def columns_of(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """The columns of rows of plain data, in order of appearance; None where a row lacks one."""
    table = [flat(row) for row in rows]
    names = dict.fromkeys(name for row in table for name in row)
    return {name: [row.get(name) for row in table] for name in names}


def write_columns(file: FilePath, columns: Columns, units: Mapping[str, str] | None = None) -> None:
    """Write a table as what its name ends in, replacing the file only when complete.

    Args:
        file: ``.csv`` with a line of names, numbers without loss, and empty cells for what is
            missing; ``.mat`` with a column vector for each name and the struct ``units``;
            ``.parquet`` with the units in the metadata of its fields.
        columns: columns of equal length.
        units: the unit of some of them.

    Raises:
        DataError: the file cannot be written, or its name ends in something else.
        SteersmanError: Parquet needs the extra ``bench``.
    """
    if file.suffix not in WRITERS:
        allowed = ", ".join(WRITERS)
        raise DataError(f"{file}: {file.suffix!r} is not allowed; a table's name ends in {allowed}")
    content = WRITERS[file.suffix](columns, units or {})
    if isinstance(content, str):
        write_text(file, content)
    else:
        with replacing(file) as stream:
            stream.write(content.getvalue())


def _values(column: Sequence[Any] | FloatArray) -> list[Any]:
    return column.tolist() if isinstance(column, np.ndarray) else list(column)


def _csv(columns: Columns, _: Mapping[str, str]) -> str:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*map(_values, columns.values()), strict=True))
    return stream.getvalue()


def _mat(columns: Columns, units: Mapping[str, str]) -> io.BytesIO:
    from scipy.io import savemat

    table: dict[str, Any] = {_variable(name): _vector(v) for name, v in columns.items()}
    table["units"] = {_variable(name): unit for name, unit in units.items()}
    stream = io.BytesIO()
    savemat(stream, table, long_field_names=True, oned_as="column")
    return stream


def _variable(name: str) -> str:
    """A name that MATLAB takes.

    >>> _variable("all.rms_m")
    'all_rms_m'
    """
    return re.sub(r"\W", "_", name, flags=re.ASCII)[-_LONGEST:].lstrip("_0123456789") or "column"


def _vector(column: Sequence[Any] | FloatArray) -> Any:
    """Numbers as they are, with NaN where there is none; anything else as a cell array."""
    values = _values(column)
    if all(value is None or isinstance(value, (int, float)) for value in values):
        return np.array([np.nan if value is None else value for value in values], dtype=float)
    cells = np.empty(len(values), dtype=object)
    cells[:] = ["" if value is None else value for value in values]
    return cells


def _parquet(columns: Columns, units: Mapping[str, str]) -> io.BytesIO:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise SteersmanError(f"Parquet needs {how_to_install('bench')}") from None
    arrays = [pa.array(column) for column in columns.values()]
    # A column without a single defined value holds numbers.
    arrays = [a.cast(pa.float64()) if pa.types.is_null(a.type) else a for a in arrays]
    fields = [
        pa.field(name, a.type, metadata={"unit": units[name]} if name in units else None)
        for name, a in zip(columns, arrays, strict=True)
    ]
    stream = io.BytesIO()
    parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), stream)
    return stream


WRITERS: dict[str, Callable[[Columns, Mapping[str, str]], str | io.BytesIO]] = {
    ".csv": _csv,
    ".mat": _mat,
    ".parquet": _parquet,
}
