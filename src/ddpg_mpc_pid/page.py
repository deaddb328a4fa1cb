"""Numbers as words for the sentences of the report."""

from __future__ import annotations

import math

from ddpg_mpc_pid.results import SeedInterval, StudyDrive

NOTHING = "-"


def number(value: float | None, unit: str = "", digits: int = 3) -> str:
    """A number for a sentence; "never" for infinite, a dash for unknown."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "never"
    text = f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"
    return f"{text}{' ' if unit else ''}{unit}"


def ended(row: StudyDrive) -> str:
    """How a drive ended, for a table."""
    if row.completed:
        return "driven"
    return f"{row.end.replace('_', ' ')} after {number(row.distance, 'm')}"


def counted(count: int, noun: str) -> str:
    """So many of them: "1 training"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def percent(share: float | None) -> str:
    """A share as percent."""
    return NOTHING if share is None or not math.isfinite(share) else f"{100.0 * share:.0f} %"


def interval(found: SeedInterval | None, scale: float = 1.0, digits: int = 3) -> str:
    """Value and interval: "3 [1, 5]"."""
    if found is None or found.value is None:
        return NOTHING
    values = (found.value, found.low, found.high)
    a, b, c = (number(None if v is None else scale * v, "", digits) for v in values)
    return f"{a} [{b}, {c}]"


def verdict(found: SeedInterval | None) -> bool | None:
    """True if the interval lies above zero, False if below, else None."""
    if found is None or found.low is None or found.high is None:
        return None
    if found.low > 0.0:
        return True
    return False if found.high < 0.0 else None


def ratio(a: float | None, b: float | None) -> float | None:
    """A / b where that says something."""
    return a / b if a is not None and b else None
