"""Recordings as CSV: columns are named after signals, with their unit behind (``yaw_rate_deg_s``).

A name without a unit is in the signal's own one, so that the columns of an episode are read as
they are.
"""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.episode import Episode
from steersman.errors import DataError, suggestion
from steersman.files import write_text
from steersman.studies.identify.recording import SIGNALS, Log, of_episode
from steersman.types import FloatArray

_MOST_BYTES = 200_000_000
_EMPTY = frozenset({"", "nan", "null", "none", "na", "n/a"})


class _Column(NamedTuple):
    signal: str
    place: int
    factor: float
    title: str


def names() -> dict[str, tuple[str, float]]:
    """Every allowed title of a column -> its signal and the factor to the signal's own unit."""
    out: dict[str, tuple[str, float]] = {}
    for name, signal in SIGNALS.items():
        out[name] = (name, 1.0)
        for unit, factor in signal.units.items():
            out[f"{name}_{unit}" if unit else name] = (name, factor)
    return out


def read_csv(file: FilePath, lock: float | None = None) -> Log:
    """Read a recording.

    Raises:
        DataError: names the file, the line and what is wrong.
    """
    lines = _lines(file)
    separator = next((mark for mark in (";", "\t") if mark in lines[0]), ",")
    columns = _columns(file, lines[0].split(separator), lock)
    numbers = [i for i, line in enumerate(lines[1:], start=2) if line.strip()]
    data = np.array(
        [_row(file, i, lines[i - 1].split(separator), columns) for i in numbers]
    ).reshape(-1, len(columns))
    signals = {c.signal: data[:, k] * c.factor for k, c in enumerate(columns)}
    time = signals.pop("time")
    _check_time(file, time, numbers)
    if "steer_angle" in signals and lock is not None:
        signals["steer_command"] = signals.pop("steer_angle") / lock
    return Log(str(file), time - time[:1], signals)


def _lines(file: FilePath) -> list[str]:
    cure = "give a CSV file with a header line, an episode.npz or the folder it is in"
    try:
        with file.open("rb") as stream:
            data = stream.read(_MOST_BYTES + 1)
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror}); {cure}") from None
    if len(data) > _MOST_BYTES:
        raise DataError(f"{file}: is larger than {_MOST_BYTES // 1_000_000} MB; thin it out")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise DataError(f"{file}: is not a text file; {cure}")
    if not text.strip():
        raise DataError(f"{file}: is empty; {cure}")
    return text.lstrip().splitlines()


def _columns(file: FilePath, titles: list[str], lock: float | None) -> list[_Column]:
    known, found = names(), list[_Column]()
    titles = [title.strip().lstrip("# ").strip('"') for title in titles]
    for place, title in enumerate(titles):
        if title not in known:
            continue
        signal, factor = known[title]
        before = next((c.title for c in found if c.signal == signal), None)
        if before is not None:
            raise DataError(f"{file}, line 1: {before} and {title} are the same; keep one of them")
        found.append(_Column(signal, place, factor, title))
    have = {column.signal for column in found}
    if "steer_angle" in have and "steer_command" not in have:
        if lock is None:
            raise DataError(
                f"{file}, line 1: steer_angle needs its value at full lock: --lock ANGLE [rad]"
            )
        have.add("steer_command")
    elif "steer_angle" in have:
        raise DataError(f"{file}, line 1: steer_command and steer_angle; keep one of them")
    for name, wanted in SIGNALS.items():
        if wanted.required and name not in have:
            _refuse(file, name, titles)
    return found


def _refuse(file: FilePath, name: str, titles: list[str]) -> None:
    """Say that a signal is missing, and which column may have been meant."""
    options = [f"{name}_{unit}" if unit else name for unit in SIGNALS[name].units]
    near = suggestion(name, [title for title in titles if title not in names()])
    asked = near.removeprefix("; did you mean ").removesuffix("?")
    hint = f"; is {asked} it?" if near.startswith("; did you mean") else ""
    raise DataError(
        f"{file}, line 1: no column {' or '.join(options)} ({SIGNALS[name].meaning}){hint}"
    )


def _row(file: FilePath, line: int, cells: list[str], columns: list[_Column]) -> list[float]:
    return [_number(file, line, cells, column) for column in columns]


def _number(file: FilePath, line: int, cells: list[str], column: _Column) -> float:
    if column.place >= len(cells):
        raise DataError(f"{file}, line {line}: has {len(cells)} cells, {column.title} is missing")
    cell = cells[column.place].strip()
    if cell.lower() in _EMPTY:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.inf
    if not math.isfinite(value):
        raise DataError(
            f"{file}, line {line}: {column.title} is {cell[:40]!r}, not a finite number;"
            " leave the cell empty if nothing was measured"
        )
    return value


def _check_time(file: FilePath, time: FloatArray, numbers: list[int]) -> None:
    absent = np.flatnonzero(np.isnan(time))
    if absent.size:
        raise DataError(f"{file}, line {numbers[absent[0]]}: time is missing")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        raise DataError(
            f"{file}, line {numbers[back[0] + 1]}: time must increase from line to line"
        )


def write_csv(episode: Episode, file: FilePath) -> None:
    """Write an episode's signals as such a file.

    Raises:
        DataError: it cannot be written.
    """
    write_log(of_episode(episode), file)


def write_log(log: Log, file: FilePath) -> None:
    """Write a recording with the unit in every column's name; what is missing stays empty.

    Raises:
        DataError: it cannot be written.
    """
    present = [name for name in SIGNALS if name in log.signals]
    titles = ["time_s"]
    for name in present:
        unit = next(iter(SIGNALS[name].units))
        titles.append(f"{name}_{unit}" if unit else name)
    rows = [",".join(titles)]
    for k, t in enumerate(log.time):
        cells = [log.signals[name][k] for name in present]
        rows.append(",".join([f"{t:.9g}", *("" if math.isnan(c) else f"{c:.9g}" for c in cells)]))
    write_text(file, "\n".join(rows) + "\n")
