"""Numbers as people and loggers write them."""

from __future__ import annotations

import math
import re

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
# Thousands set apart by apostrophes or blanks (also those that break no line).
_APART = re.compile(r"(?<=\d)['\u2019 \u00a0\u202f](?=\d{3}(?!\d))")
# By points or commas: cells that mean nothing else, by the mark, and all that then mean it.
SURE = {
    ".": re.compile(r"[-+]?\d{1,3}(?:(?:\.\d{3})+,\d+|(?:\.\d{3}){2,})"),
    ",": re.compile(r"[-+]?\d{1,3}(?:(?:,\d{3})+\.\d+|(?:,\d{3}){2,})"),
}
_GROUPED = {
    mark: re.compile(rf"[-+]?\d{{1,3}}(?:[{mark}]\d{{3}})+(?:[{other}]\d+)?")
    for mark, other in (".,", ",.")
}
# Degrees with their sign, then minutes and seconds; the sides that are negative.
_ARC = re.compile(
    r"([-+]?)(\d+(?:[.,]\d+)?)\s*°\s*(?:(\d+(?:[.,]\d+)?)\s*['\u2032\u2019])?\s*"
    r"(?:(\d+(?:[.,]\d+)?)\s*(?:[\"\u2033\u201d]|'')?)?\s*([NSEWOnsewo]?)"
)
_BACK = frozenset("SW")


def value(cell: str, mark: str = "") -> float:
    r"""The number in a cell; NaN if there is none. Degrees may have minutes and seconds.

    >>> round(value("48°46'35.7386\"N"), 6), round(value("11° 26,2' W"), 6)
    (48.776594, -11.436667)
    >>> value("4.567.890,12"), value("4'567'890.12"), value("691.000", "."), value("691.000")
    (4567890.12, 4567890.12, 691000.0, 691.0)
    """
    if "°" in cell:
        return _degrees(cell)
    cell = _APART.sub("", cell)
    for sign in SURE:
        if (_GROUPED if sign == mark else SURE)[sign].fullmatch(cell):
            cell = cell.replace(sign, "")
            break
    try:
        return float(cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell)
    except ValueError:
        return math.nan


def _degrees(cell: str) -> float:
    """Degrees from degrees, minutes and seconds, perhaps with the side; NaN if it is none."""
    found = _ARC.fullmatch(cell.strip())
    if found is None:
        return math.nan
    sign, *parts, side = found.groups()
    degrees, minutes, seconds = (float((part or "0").replace(",", ".")) for part in parts)
    back = (sign == "-") != ((side or "").upper() in _BACK)
    return (-1.0 if back else 1.0) * (degrees + minutes / 60.0 + seconds / 3600.0)
