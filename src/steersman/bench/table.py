"""Rows as a table: ``results.parquet``, one row for each run."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path as FilePath

from steersman.bench.drive import Row
from steersman.files import replacing

NAME = "results.parquet"


def write_table(rows: Sequence[Row], out: FilePath) -> FilePath | None:
    """Write all rows with every column; None if the extra ``bench`` (pyarrow) is not installed.

    A column without a single defined value holds numbers.

    Raises:
        DataError: the file cannot be written.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ModuleNotFoundError:
        return None
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {}
    for name in names:
        column = pa.array([row.get(name) for row in rows])
        columns[name] = column.cast(pa.float64()) if pa.types.is_null(column.type) else column
    stream = io.BytesIO()
    parquet.write_table(pa.table(columns), stream)
    with replacing(out / NAME) as file:
        file.write(stream.getvalue())
    return out / NAME
