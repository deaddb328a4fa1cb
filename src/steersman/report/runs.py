"""What a report is made of, and finding it in folders.

A folder may hold, at any depth: ``*.npz`` episodes (with ``metrics.json`` beside
``episode.npz``), ``progress.csv`` training curves (with ``policy.json`` beside), ``table*.json``
tables, and ``config.yaml``, which holds for its folder and those below.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from steersman.config import read_yaml
from steersman.episode import Episode, is_episode, load_episode
from steersman.errors import DataError
from steersman.files import read_json
from steersman.metrics.base import summarise
from steersman.types import FloatArray

# Parts of a file's place that say nothing about the run.
_PLAIN_PARTS = frozenset({"episode", "episodes", "progress", "metrics"})
# Decimals that a column may have.
_MOST = 15


@dataclass(frozen=True)
class Table:
    """A table made elsewhere; a row may lack some of the columns.

    Attributes:
        title: what stands above it.
        rows: mappings from a column's key to a value.
        columns: the header of each column by its key; None: every key of the rows is a header.
        decimals: the decimals of a column's floats by its key; others have four digits.
        about: sentences under the title.
    """

    title: str
    rows: Sequence[Mapping[str, Any]]
    columns: Mapping[str, str] | None = None
    decimals: Mapping[str, int] | None = None
    about: str = ""

    @property
    def headers(self) -> Mapping[str, str]:
        """The header of each column by its key; without ``columns`` in order of appearance."""
        if self.columns is None:
            return {key: key for row in self.rows for key in row}
        return self.columns


@dataclass(frozen=True)
class ReportRun:
    """One thing to report; whatever it does not have is left out of the page.

    Attributes:
        name: what the legends and tables call it.
        episode: the drive, if it was one.
        metrics: name -> value as of ``summarise``; made from the episode when empty.
        training: column -> values of a training run, NaN where a cell was empty.
        table: a table to show as it is.
        config: plain data shown folded up.
    """

    name: str
    episode: Episode | None = None
    metrics: Mapping[str, Any] = field(default_factory=dict)
    training: Mapping[str, FloatArray] | None = None
    table: Table | None = None
    config: Mapping[str, Any] = field(default_factory=dict)


def load_runs(folders: Iterable[FilePath]) -> list[ReportRun]:
    """Everything to report in these folders (or ``.npz`` files), sorted within each.

    Raises:
        DataError: a folder is missing or holds nothing to report, or a file is corrupt.
    """
    roots = [FilePath(folder) for folder in folders]
    runs: list[ReportRun] = []
    for root in roots:
        found = _load_root(root, prefix=len(roots) > 1)
        if not found:
            raise DataError(
                f"{root}: nothing to report; expected *.npz episodes, metrics.json, progress.csv "
                "or table*.json"
            )
        runs += found
    return _distinct(runs)


def _load_root(root: FilePath, *, prefix: bool) -> list[ReportRun]:
    if not root.exists():
        raise DataError(f"{root}: no such folder")
    if root.is_file():
        return [_load_episode(root, root.stem, root.parent)]
    runs = []
    for file in _files(root):
        load = _loader(file)
        if load is not None:
            runs.append(load(file, _name(file, root, prefix=prefix), root))
    return runs


def _files(root: FilePath) -> list[FilePath]:
    try:
        return sorted(
            file
            for file in root.rglob("*")
            if not any(part.startswith(".") for part in file.relative_to(root).parts)
            and file.is_file()
        )
    except OSError as error:
        raise DataError(f"{root}: cannot be read ({error.strerror or error})") from None


def _loader(file: FilePath) -> Any:
    if file.suffix == ".npz":
        return _load_episode if is_episode(file) else None
    if file.name == "progress.csv":
        return _load_training
    if file.name == "metrics.json" and not (file.parent / "episode.npz").exists():
        return _load_metrics
    if file.suffix == ".json" and file.name.startswith("table"):
        return _load_table
    return None


def _name(file: FilePath, root: FilePath, *, prefix: bool) -> str:
    parts = [p for p in file.relative_to(root).with_suffix("").parts if p not in _PLAIN_PARTS]
    whole = root.resolve().name or str(root)
    return "/".join([whole, *parts] if prefix or not parts else parts)


def _distinct(runs: list[ReportRun]) -> list[ReportRun]:
    """Number the names that occur more than once among things of the same sort."""
    seen: dict[tuple[str, bool], int] = {}
    out = []
    for run in runs:
        key = (run.name, run.training is None)
        seen[key] = seen.get(key, 0) + 1
        out.append(run if seen[key] == 1 else replace(run, name=f"{run.name} ({seen[key]})"))
    return out


def _load_episode(file: FilePath, name: str, root: FilePath) -> ReportRun:
    episode = load_episode(file)
    beside = file.with_name("metrics.json")
    recorded = read_json_object(beside) if file.name == "episode.npz" and beside.exists() else {}
    own = file.name == "episode.npz" and (file.parent / "config.yaml").exists()
    config = _config(file, root) if own or not episode.meta else dict(episode.meta)
    metrics = {**summarise(episode), **recorded}
    return ReportRun(name, episode=episode, metrics=metrics, config=config)


def _load_metrics(file: FilePath, name: str, root: FilePath) -> ReportRun:
    return ReportRun(name, metrics=read_json_object(file), config=_config(file, root))


def _load_training(file: FilePath, name: str, root: FilePath) -> ReportRun:
    card = file.with_name("policy.json")
    config = _config(file, root)
    if card.exists():
        config = {"policy": read_json_object(card), **({"config": config} if config else {})}
    return ReportRun(name, training=read_progress(file), config=config)


def _load_table(file: FilePath, name: str, root: FilePath) -> ReportRun:
    return ReportRun(name, table=read_table(file))


def _config(file: FilePath, root: FilePath) -> dict[str, Any]:
    """The nearest ``config.yaml`` from the file's folder up to the one that was asked for."""
    for folder in file.parents:
        if (folder / "config.yaml").is_file():
            return read_yaml(folder / "config.yaml")
        if folder == root:
            break
    return {}


def read_json_object(file: FilePath) -> dict[str, Any]:
    """A JSON file that holds one object.

    Raises:
        DataError: the file is missing, not JSON, or holds something else.
    """
    data = read_json(file)
    if not isinstance(data, dict):
        raise DataError(f"{file}: holds a {type(data).__name__}, expected an object")
    return data


def read_table(file: FilePath) -> Table:
    """A table: a list of rows, or an object of ``rows`` and what :class:`Table` has.

    Rows are objects. ``columns`` is a mapping from key to header text, or a list of keys; without
    it all keys are shown in the order in which they first occur. ``decimals`` maps keys to numbers.

    Raises:
        DataError: the file is missing, not JSON, or of another form.
    """
    data = read_json(file)
    whole = data if isinstance(data, dict) else {"rows": data}
    rows = whole.get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise DataError(f"{file}: not a table; expected 'rows', a list of objects")
    columns = whole.get("columns") or None
    if isinstance(columns, list) and all(isinstance(key, str) for key in columns):
        columns = {key: key for key in columns}
    if not isinstance(columns, dict | None):
        raise DataError(f"{file}: 'columns' must map keys to header texts, or list keys")
    headers = columns and {key: str(text) for key, text in columns.items()}
    decimals = whole.get("decimals")
    if not (decimals is None or isinstance(decimals, dict)) or not all(
        isinstance(count, int) and 0 <= count <= _MOST for count in (decimals or {}).values()
    ):
        raise DataError(f"{file}: 'decimals' must map keys to whole numbers, 0 to {_MOST}")
    return Table(str(whole.get("title", file.stem)), rows, headers, decimals)


def read_progress(file: FilePath) -> dict[str, FloatArray]:
    """The numeric columns of a training record; NaN where a cell is empty.

    Columns without a single number are taken for text and left out. The last line may be cut
    short, as an interrupted training leaves it.

    Raises:
        DataError: the file is missing, has no header, or mixes numbers and text in a column.
    """
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            header, *lines = [line for line in csv.reader(stream) if line] or [[]]
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{file}: not valid CSV ({error})") from None
    if not header or len(set(header)) != len(header):
        raise DataError(f"{file}: expected a first line of distinct column names")
    return dict(_columns(file, header, lines))


def _columns(
    file: FilePath, header: list[str], lines: list[list[str]]
) -> Iterable[tuple[str, FloatArray]]:
    for number, line in enumerate(lines, start=2):
        if len(line) > len(header) or (len(line) < len(header) and line is not lines[-1]):
            raise DataError(f"{file}: row {number} has {len(line)} cells, expected {len(header)}")
    for k, name in enumerate(header):
        cells = [line[k].strip() if k < len(line) else "" for line in lines]
        values = [_number(cell) for cell in cells]
        bad = [i for i, value in enumerate(values) if value is None]
        if bad and len(bad) == sum(cell != "" for cell in cells):
            continue
        if bad:
            raise DataError(f"{file}: row {bad[0] + 2}: {name} is {cells[bad[0]]!r}, no number")
        yield name, np.array([v for v in values if v is not None], dtype=np.float64)


def _number(cell: str) -> float | None:
    if cell == "":
        return math.nan
    try:
        return float(cell)
    except ValueError:
        return None
