"""What the report's page is made of: sections, and numbers as words for their sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

NOTHING = "-"


class PaperFinding(NamedTuple):
    """A sentence, and whether the paper's statement holds (None: neither yes nor no)."""

    agrees: bool | None
    text: str


class PaperTable(NamedTuple):
    """A table; each row maps headings to values, in the order of the columns."""

    title: str
    rows: Sequence[Mapping[str, Any]]

    def data(self) -> dict[str, Any]:
        """As the report takes it; a row may lack some of the columns."""
        columns = {heading: heading for row in self.rows for heading in row}
        return {"title": self.title, "columns": columns, "rows": list(self.rows)}


class PaperFigure(NamedTuple):
    """Lines over one axis, drawn into a file of that name."""

    file: str
    title: str
    x: str
    """Label of the axis."""
    y: str
    lines: Sequence[Mapping[str, Any]]
    """``name``, ``x``, ``y``, and perhaps ``low`` and ``high``, the ends of a band."""
    log: bool = False
    """Logarithmic y."""
    equal: bool = False
    """The same scale for x and y."""


class PaperSection(NamedTuple):
    """A section of the page."""

    title: str
    text: Sequence[str]
    """Paragraphs."""
    findings: Sequence[PaperFinding] = ()
    tables: Sequence[PaperTable] = ()
    figures: Sequence[PaperFigure] = ()

    def data(self) -> dict[str, Any]:
        """As the report takes it; tables without rows are left out."""
        return {
            "title": self.title,
            "text": list(self.text),
            "findings": [finding._asdict() for finding in self.findings],
            "tables": [table.data() for table in self.tables if table.rows],
            "figures": [figure._asdict() for figure in self.figures],
        }


def number(value: float | None, unit: str = "", digits: int = 3) -> str:
    """A number for a sentence; "never" for infinite, a dash for unknown."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "never"
    text = f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"
    return f"{text}{' ' if unit else ''}{unit}"


def percent(share: float | None) -> str:
    """A share as percent."""
    return NOTHING if share is None or not math.isfinite(share) else f"{100.0 * share:.0f} %"


def interval(found: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> str:
    """Value and interval: "3 [1, 5]"."""
    if found is None or found["value"] is None:
        return NOTHING
    values = [found[k] for k in ("value", "low", "high")]
    a, b, c = (number(None if v is None else scale * v, "", digits) for v in values)
    return f"{a} [{b}, {c}]"


def verdict(found: Mapping[str, Any] | None) -> bool | None:
    """True if the interval lies above zero, False if below, else None."""
    if found is None or found["low"] is None or found["high"] is None:
        return None
    if found["low"] > 0.0:
        return True
    return False if found["high"] < 0.0 else None


def ratio(a: float | None, b: float | None) -> float | None:
    """A / b where that says something."""
    return a / b if a is not None and b else None
