"""A recording: commands and measurements over time, in SI units with the signs of ISO 8855."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path as FilePath
from typing import NamedTuple

import numpy as np

from steersman.episode import Episode, is_episode, load_episode
from steersman.errors import DataError, suggestion
from steersman.files import write_text
from steersman.tables import Sheet, read_sheet
from steersman.types import FloatArray

# Rows further apart than this do not belong to one drive [s].
LONGEST_GAP = 0.5
# Shorter drives are left out [s].
SHORTEST = 3.0
_LEAST_ROWS = 100
_SLOWEST_RATE = 0.21


class LogSignal(NamedTuple):
    """A quantity of a recording; the first unit is the one that it is kept in."""

    meaning: str
    units: Mapping[str, float]
    """Unit as written in the name of a column -> factor to the kept unit."""
    required: bool = False


_DEG = float(np.pi / 180.0)
_SHARE = {"": 1.0, "percent": 0.01}
_SPEED = {"m_s": 1.0, "km_h": 1.0 / 3.6}
_ANGLE = {"rad": 1.0, "deg": _DEG}
_ACCELERATION = {"m_s2": 1.0, "g": 9.81}
SIGNALS: dict[str, LogSignal] = {
    "time": LogSignal("time", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}, required=True),
    "steer_command": LogSignal("commanded steering, -1 to 1, left positive", _SHARE, required=True),
    "steer_angle": LogSignal("commanded angle of steering or road wheels; needs --lock", _ANGLE),
    "throttle": LogSignal("commanded throttle, 0 to 1", _SHARE),
    "brake": LogSignal("commanded brake, 0 to 1", _SHARE),
    "v_x": LogSignal("speed ahead", _SPEED, required=True),
    "v_y": LogSignal("speed to the left, of the centre of mass", _SPEED),
    "yaw_rate": LogSignal("yaw rate, left positive", {"rad_s": 1.0, "deg_s": _DEG}, required=True),
    "a_x": LogSignal("acceleration ahead; checked, not fitted", _ACCELERATION),
    "a_y": LogSignal("acceleration to the left, of the centre of mass", _ACCELERATION),
    "steer": LogSignal("measured steering, -1 to 1", _SHARE),
    "wheel_angle": LogSignal("measured angle of the front wheels, the mean of both", _ANGLE),
}
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

    def get(self, name: str) -> FloatArray | None:
        """A signal, or None if there is none or it is empty throughout."""
        values = self.signals.get(name)
        return None if values is None or not np.isfinite(values).any() else values


def read_log(file: FilePath, lock: float | None = None, ahead: float = 0.0) -> Log:
    """A CSV file, an episode (its file, or the folder that ``drive --out`` wrote), or a ROS 2 bag.

    Args:
        file: ``.csv``, ``.npz``, ``.mcap``, ``.db3``, or a folder with ``episode.npz`` or
            ``metadata.yaml``.
        lock: angle [rad] that is full lock where the commands are angles.
        ahead: how far the centre of mass is ahead of a bag's Odometry [m].

    Raises:
        DataError: it cannot be read, or holds too little; one line says where and what.
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
        log = read_csv(file, lock)
    _check_length(log)
    return log


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


def of_episode(episode: Episode, name: str = "episode") -> Log:
    """The signals of an episode: true values, without any sensor's noise."""
    signals = {key: episode[key] for key in SIGNALS if key in episode.columns and key != "time"}
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
    cure = "give a CSV file with a header line, an episode.npz or the folder it is in"
    sheet = read_sheet(file, cure, lambda titles: not names().keys().isdisjoint(titles))
    signals = {
        signal: sheet.numbers(title, gaps=True) * names()[title][1]
        for signal, title in _columns(sheet, lock).items()
    }
    time = signals.pop("time")
    _check_time(sheet, time)
    if "steer_angle" in signals and lock is not None:
        signals["steer_command"] = signals.pop("steer_angle") / lock
    return Log(str(file), time - time[:1], signals)


def _columns(sheet: Sheet, lock: float | None) -> dict[str, str]:
    """Title of each signal's column."""
    known, found = names(), dict[str, str]()
    for title in sheet.titles:
        if title not in known:
            continue
        signal, _ = known[title]
        if signal in found:
            both = f"{found[signal]} and {title} are the same"
            raise sheet.fault(sheet.title_line, f"{both}; keep one of them")
        found[signal] = title
    have = set(found)
    if "steer_angle" in have and "steer_command" not in have:
        if lock is None:
            raise sheet.fault(
                sheet.title_line, "steer_angle needs its value at full lock: --lock ANGLE [rad]"
            )
        have.add("steer_command")
    elif "steer_angle" in have:
        raise sheet.fault(sheet.title_line, "steer_command and steer_angle; keep one of them")
    for name, wanted in SIGNALS.items():
        if wanted.required and name not in have:
            raise sheet.fault(sheet.title_line, _missing(name, sheet.titles))
    return found


def _missing(name: str, titles: list[str]) -> str:
    """That a signal is missing, and which column may have been meant."""
    options = [f"{name}_{unit}" if unit else name for unit in SIGNALS[name].units]
    near = suggestion(name, [title for title in titles if title not in names()])
    close = near.removeprefix("; did you mean ").removesuffix("?")
    hint = f"; is {close} it?" if near.startswith("; did you mean") else ""
    return f"no column {' or '.join(options)} ({SIGNALS[name].meaning}){hint}"


def _check_time(sheet: Sheet, time: FloatArray) -> None:
    absent = np.flatnonzero(np.isnan(time))
    if absent.size:
        raise sheet.fault(sheet.lines[absent[0]], "time is missing")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        raise sheet.fault(sheet.lines[back[0] + 1], "time must increase from line to line")


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
