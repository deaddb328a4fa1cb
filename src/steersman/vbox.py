"""Files of Racelogic's VBOX as a table in usual units: ``[column names]`` and ``[data]``.

Positions are minutes of arc, north and **west** positive; times are hhmmss.ss of the day (UTC).
Source: Racelogic's description of the format, in which the file names its columns itself.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

_NAMES, _DATA = "[column names]", "[data]"
_SECTION = re.compile(r"\[[^\]]*\]")
# Column names and what they are called here, with their units.
_TITLES = {
    "time": "time [s]",
    "lat": "latitude [min]",
    "long": "longitude [min west]",
    "velocity": "velocity [km/h]",
    "heading": "heading [deg]",
    "height": "height [m]",
}
_CLOCK = re.compile(r"(\d{2})(\d{2})(\d{2}(?:\.\d*)?)")


class VboxTable(NamedTuple):
    """The titles, their line, and the rows with their lines."""

    titles: list[str]
    line: int
    rows: list[tuple[int, list[str]]]


def is_section(line: str) -> bool:
    """Whether a line is the head of a section, which no table's row is.

    >>> is_section("[data]"), is_section("[1] x")
    (True, False)
    """
    return bool(_SECTION.fullmatch(line))


def read_vbox(lines: Sequence[tuple[int, str]]) -> VboxTable | None:
    """The table of a VBOX file from its lines that are not empty; None if it is none."""
    heads = {line.lower(): k for k, (_, line) in enumerate(lines) if is_section(line)}
    if not {_NAMES, _DATA} <= heads.keys() or heads[_NAMES] + 1 >= len(lines):
        return None
    number, names = lines[heads[_NAMES] + 1]
    titles = [_TITLES.get(name.lower(), name) for name in names.split()]
    clock = titles.index("time [s]") if "time [s]" in titles else len(titles)
    rows = [(n, line.split()) for n, line in lines[heads[_DATA] + 1 :] if not is_section(line)]
    for _, cells in rows:
        if clock < len(cells):
            cells[clock] = _seconds(cells[clock])
    return VboxTable(titles, number, rows)


def _seconds(cell: str) -> str:
    """The seconds of the day of a time hhmmss.ss; what is none stays.

    >>> _seconds("101233.10")
    '36753.10'
    """
    found = _CLOCK.fullmatch(cell)
    if found is None:
        return cell
    hours, minutes, seconds = found.groups()
    return f"{3600 * int(hours) + 60 * int(minutes) + float(seconds):.2f}"
