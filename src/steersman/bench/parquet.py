"""The rows of a benchmark as a table, ``results.parquet``."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path as FilePath

from steersman.bench.results import BenchRow
from steersman.files import replacing

PARQUET = "results.parquet"


def write_table(rows: Sequence[BenchRow], out: FilePath) -> FilePath | None:
    """Write ``results.parquet``: one row for each drive, with every column.

    A column without a single defined value holds numbers.

    Returns:
        The file; None if the extra ``bench`` (pyarrow) is not installed.

    Raises:
        DataError: the file cannot be written.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ModuleNotFoundError:
        return None
    table = [row.plain() for row in rows]
    columns = {}
    for name in dict.fromkeys(name for row in table for name in row):
        column = pa.array([row.get(name) for row in table])
        columns[name] = column.cast(pa.float64()) if pa.types.is_null(column.type) else column
    stream = io.BytesIO()
    parquet.write_table(pa.table(columns), stream)
    with replacing(out / PARQUET) as file:
        file.write(stream.getvalue())
    return out / PARQUET
