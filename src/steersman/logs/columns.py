"""Recordings in CSV files: which column is which signal, in which unit and with which sign."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from steersman.columns import ANGLE, LENGTH, SPEED, ExpectedColumn, find, parse, some_titles
from steersman.errors import suggestion
from steersman.tables import Sheet, read_sheet
from steersman.types import FloatArray

LONGEST = 1e9
"""The longest time that a recording spans [s]."""
_SHARE = {"": 1.0, "percent": 0.01}
_ACCELERATION = {"m_s2": 1.0, "g": 9.81}
SIGNALS: dict[str, ExpectedColumn] = {
    "time": ExpectedColumn("time", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}, ("t", "zeit")),
    "steer_command": ExpectedColumn("commanded steering, -1 to 1, left positive", _SHARE),
    "steer_angle": ExpectedColumn("commanded angle of steering or wheels; needs --lock", ANGLE),
    "throttle": ExpectedColumn("commanded throttle, 0 to 1", _SHARE),
    "brake": ExpectedColumn("commanded brake, 0 to 1", _SHARE),
    "v_x": ExpectedColumn("speed ahead", SPEED),
    "speed": ExpectedColumn("size of the velocity, instead of v_x", SPEED),
    "v_y": ExpectedColumn("speed to the left", SPEED),
    "yaw_rate": ExpectedColumn("yaw rate, left positive", {"rad_s": 1.0, "deg_s": ANGLE["deg"]}),
    "a_x": ExpectedColumn("acceleration ahead; checked, not fitted", _ACCELERATION),
    "a_y": ExpectedColumn("acceleration to the left", _ACCELERATION),
    "steer": ExpectedColumn("measured steering, -1 to 1", _SHARE),
    "wheel_angle": ExpectedColumn("measured angle of the front wheels, the mean of both", ANGLE),
    "x": ExpectedColumn("position", LENGTH),
    "y": ExpectedColumn("position, left of x", LENGTH),
    "yaw": ExpectedColumn("heading, left positive", ANGLE),
}

FORMATS = {
    "carla": "time=time,x=x,y=-y,yaw=-yaw,speed=speed,steer_command=-steer_normalized,"
    "throttle=throttle,brake=brake",
}
"""Known formats; of a client of CARLA with its left-handed axes, yaw in rad."""


def read_columns(
    file: FilePath, columns: str | None = None, cure: str = "give a CSV file with a header line"
) -> tuple[Sheet, dict[str, FloatArray]]:
    """The signals of a CSV file; a missing value is NaN.

    Args:
        file: with a header line.
        columns: ``SIGNAL=TITLE,...`` as :func:`steersman.columns.parse` reads it, or a name of
            ``FORMATS``; other signals are found by their names.
        cure: what to give instead of a file that cannot be read.

    Raises:
        DataError: names the file, the line and what is wrong.
        ConfigError: ``columns`` names no signal, or no column.
    """
    given = parse(FORMATS.get(columns or "", columns or ""), SIGNALS)
    titles = {wanted.title.removeprefix("-") for wanted in given.values()}

    def is_header(cells: list[str]) -> bool:
        return not titles.isdisjoint(cells) or bool(find(Sheet(file, cells, 0, [], []), SIGNALS))

    sheet = read_sheet(file, cure, is_header)
    found = find(sheet, SIGNALS, given, single=True)
    return sheet, {
        name: sheet.numbers(column.place, gaps=True) * column.factor
        for name, column in found.items()
    }


def check_time(sheet: Sheet, time: FloatArray) -> None:
    """Refuse times that are missing, span too long or do not increase, and a file without any.

    Raises:
        DataError: names the line.
    """
    if not time.size:
        raise sheet.fault(sheet.title_line, "no row follows the titles")
    absent = np.flatnonzero(np.isnan(time))
    if absent.size:
        raise sheet.fault(sheet.lines[absent[0]], "time is missing")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        raise sheet.fault(sheet.lines[back[0] + 1], "time must increase from line to line")
    late = np.flatnonzero(time > time[0] + LONGEST)
    if late.size:
        after = f"is more than {LONGEST:g} s after the first; is it in milliseconds (time_ms)?"
        raise sheet.fault(sheet.lines[late[0]], f"time {after}")


def missing(name: str, titles: list[str], option: str = "columns=") -> str:
    """That a signal is missing, which column may have been meant, and how ``option`` names it."""
    options = [f"{name}_{unit}" if unit else name for unit in SIGNALS[name].units]
    near = suggestion(name, titles)
    close = near.removeprefix("; did you mean ").removesuffix("?")
    hint = f"; is {close} it?" if near.startswith("; did you mean") else ""
    found = f"no column {' or '.join(options)} ({SIGNALS[name].meaning}) in {some_titles(titles)!r}"
    return f"{found}{hint}; name it with {option}{name}=TITLE"
