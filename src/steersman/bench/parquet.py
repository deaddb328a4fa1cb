"""The rows of a benchmark as a table, ``results.parquet``."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path as FilePath

from steersman.bench.results import BenchRow
from steersman.table_file import columns_of, write_columns

PARQUET = "results.parquet"


def write_table(rows: Sequence[BenchRow], out: FilePath) -> FilePath | None:
    """Write ``results.parquet``: one row for each drive, with every column.

    Returns:
        The file; None if the extra ``bench`` (pyarrow) is not installed.

    Raises:
        DataError: the file cannot be written.
    """
    if find_spec("pyarrow") is None:
        return None
    write_columns(out / PARQUET, columns_of(row.plain() for row in rows))
    return out / PARQUET
