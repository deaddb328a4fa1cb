"""A recording: commands and measurements over time, in SI units with the signs of ISO 8855."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.episode import Episode, is_episode, load_episode
from steersman.errors import DataError
from steersman.files import write_text
from steersman.logs.columns import SIGNALS, check_time, missing, read_columns
from steersman.tables import Sheet
from steersman.types import FloatArray

# Rows further apart than this do not belong to one drive [s].
LONGEST_GAP = 0.5
# Shorter drives are left out [s].
SHORTEST = 3.0
_LEAST_ROWS = 100
_SLOWEST_RATE = 0.21
# Of each of these a recording has at least one signal.
_REQUIRED = (
    ("time",),
    ("steer_command", "steer_angle", "wheel_angle"),
    ("v_x", "speed"),
    ("yaw_rate", "yaw"),
)
# Signals that the lateral fit compares; each has an offset of its sensor as an unknown.
RESPONSES = ("yaw_rate", "v_y", "a_y", "wheel_angle", "steer")
# Least standard deviation of a residual, in the unit of its signal.
RESOLUTION = {
    "yaw_rate": 2e-4,
    "v_y": 2e-3,
    "a_y": 5e-3,
    "wheel_angle": 2e-4,
    "steer": 2e-4,
    "v_x": 2e-3,
}


class Log(NamedTuple):
    """Rows at increasing times; NaN where a cell was empty, no entry where a column is missing."""

    name: str
    time: FloatArray
    signals: Mapping[str, FloatArray]
    yaw_rate_lag: float = 0.0
    """Time constant [s] of the low pass through which the yaw rate was recorded."""
    yaw_rate_offset: float | None = None
    """Offset of its sensor [rad/s], which was subtracted; None: not known."""
    contradicting: float = 0.0
    """Time [s] for which heading and yaw rate contradicted each other, so that neither counts."""
    by_angle: bool = False
    """Whether ``steer_command`` is computed from the measured wheel angle: no command is there."""

    def get(self, name: str) -> FloatArray | None:
        """A signal, or None if there is none or it is empty throughout."""
        values = self.signals.get(name)
        return None if values is None or not np.isfinite(values).any() else values


def read_log(
    file: FilePath, lock: float | None = None, ahead: float = 0.0, columns: str | None = None
) -> Log:
    """A CSV file, an episode (its file, or the folder that ``drive --out`` wrote), or a ROS 2 bag.

    Args:
        file: ``.csv``, ``.npz``, ``.mcap``, ``.db3``, or a folder with ``episode.npz`` or
            ``metadata.yaml``.
        lock: angle [rad] that is full lock where the commands are angles.
        ahead: how far the centre of mass is ahead of a bag's Odometry [m].
        columns: where the signals of a CSV file stand, as in
            :func:`steersman.logs.columns.read_columns`.

    Raises:
        DataError: it cannot be read, or holds too little; one line says where and what.
        ConfigError: ``columns`` is not allowed.
        ModuleNotFoundError: a bag needs the extra ``logs``.
    """
    bag = (file / "metadata.yaml").is_file() or file.suffix in {".mcap", ".db3"}
    if file.is_dir() and not bag:
        file = file / "episode.npz"
    if bag:
        log = _of_bag(file, lock, ahead)
    elif file.suffix == ".npz":
        if not is_episode(file):
            raise DataError(f"{file}: not an episode of Steersman")
        log = of_episode(load_episode(file), str(file))
    else:
        log = read_csv(file, lock, columns)
    _check_length(log)
    return log


def joined(logs: Sequence[Log]) -> Log:
    """One recording of several of the same car, with a gap between each two.

    Raises:
        DataError: they hold different signals.
    """
    first, *others = logs
    for log in others:
        odd = sorted(set(log.signals) ^ set(first.signals))
        if odd:
            raise DataError(f"{log.name}: {odd[0]} is in it or in {first.name}, but not in both")
    times: list[FloatArray] = []
    for log in logs:
        start = times[-1][-1] + 2.0 * LONGEST_GAP if times else 0.0
        times.append(log.time - log.time[0] + start)
    signals = {name: np.concatenate([log.signals[name] for log in logs]) for name in first.signals}
    return Log(", ".join(log.name for log in logs), np.concatenate(times), signals)


# A bag's columns -> our signals.
_OF_BAG = {"angle": "wheel_angle"} | {n: n for n in ("v_x", "v_y", "yaw_rate", "steer_command")}
_OF_BAG |= {name: name for name in ("steer", "throttle", "brake")}


def _of_bag(file: FilePath, lock: float | None, ahead: float) -> Log:
    from steersman.logs import read

    bag = read(file, ahead=ahead)
    signals = {ours: bag[theirs] for theirs, ours in _OF_BAG.items() if theirs in bag}
    if "steer_command" not in signals:
        if "angle_command" not in bag:
            raise DataError(f"{file}: holds no steering commands (Lateral or Control of Autoware)")
        if lock is None:
            raise DataError(f"{file}: its commands are wheel angles; give --lock ANGLE [rad]")
        signals["steer_command"] = bag["angle_command"] / lock
    return Log(str(file), bag["time"], signals)


# Of an episode: those that are measured on a car, too.
_OF_EPISODE = [name for name in SIGNALS if name not in {"time", "speed", "x", "y", "yaw"}]


def of_episode(episode: Episode, name: str = "episode") -> Log:
    """The signals of an episode: true values, without any sensor's noise."""
    signals = {key: episode[key] for key in _OF_EPISODE if key in episode.columns}
    return Log(name, episode["time"] - episode["time"][:1], signals)


def _check_length(log: Log) -> None:
    rows, seconds = len(log.time), float(log.time[-1] - log.time[0]) if len(log.time) else 0.0
    if rows < _LEAST_ROWS or seconds < 2.0 * SHORTEST:
        raise DataError(
            f"{log.name}: {rows} rows over {seconds:.1f} s are too few; give at least "
            f"{_LEAST_ROWS} rows over {2.0 * SHORTEST:.0f} s"
        )
    usual = float(np.median(np.diff(log.time)))
    if usual > _SLOWEST_RATE:
        raise DataError(
            f"{log.name}: a row every {usual:.3g} s is too seldom; give at least 5 rows a second"
            " (is the column time in seconds? time_ms is in milliseconds)"
        )


def pieces(log: Log) -> list[slice]:
    """Stretches of rows without a gap, each long enough to be of use."""
    cuts = np.flatnonzero(np.diff(log.time) > LONGEST_GAP) + 1
    ends = [0, *cuts.tolist(), len(log.time)]
    found = [slice(a, b) for a, b in pairwise(ends)]
    return [s for s in found if log.time[s.stop - 1] - log.time[s.start] >= SHORTEST]


def read_csv(file: FilePath, lock: float | None = None, columns: str | None = None) -> Log:
    """Read a recording; ``columns`` as in :func:`steersman.logs.columns.read_columns`.

    Raises:
        DataError: names the file, the line and what is wrong.
        ConfigError: ``columns`` is not allowed.
    """
    cure = "give a CSV file with a header line, an episode.npz or the folder it is in"
    sheet, signals = read_columns(file, columns, cure)
    _check_signals(sheet, signals, lock)
    time = signals.pop("time")
    check_time(sheet, time)
    if "steer_angle" in signals and lock is not None:
        signals["steer_command"] = signals.pop("steer_angle") / lock
    return Log(str(file), time - time[:1], signals)


def _check_signals(sheet: Sheet, signals: Mapping[str, FloatArray], lock: float | None) -> None:
    def fault(text: str) -> DataError:
        return sheet.fault(sheet.title_line, text)

    if "steer_angle" in signals:
        if "steer_command" in signals:
            raise fault("steer_command and steer_angle; keep one of them")
        if lock is None:
            raise fault("steer_angle needs its value at full lock: --lock ANGLE [rad]")
    for options in _REQUIRED:
        if signals.keys().isdisjoint(options):
            others = f", or {' or '.join(options[1:])} instead" if options[1:] else ""
            raise fault(missing(options[0], sheet.titles, "--columns ") + others)


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
