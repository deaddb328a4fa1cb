"""How rows fall into groups: what no figure counts for want of grip, and the values of a factor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from steersman.bench.grip import GripClass
from steersman.bench.results import BenchRow


def apart(rows: Iterable[BenchRow]) -> set[str]:
    """Names of the scenarios beyond grip; none where there are no others.

    What sums up rows of several controllers leaves out the same for all of them.
    """
    beyond: dict[str, bool] = {}
    for row in rows:
        beyond[row.scenario] = beyond.get(row.scenario, False) or row.beyond_grip
    found = {name for name, out in beyond.items() if out}
    return set() if len(found) == len(beyond) else found


def values_of(rows: Iterable[BenchRow], factor: str) -> list[str]:
    """The values of a factor in the order of the suite, the classes of grip as it grows."""
    found = dict.fromkeys(getattr(row, factor) for row in rows)
    return (
        [each for each in ("", *get_args(GripClass)) if each in found]
        if factor == "grip"
        else [*found]
    )
