"""How rows fall into groups and controllers into an order; what no figure counts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import get_args

from steersman.bench.grip import GripClass
from steersman.bench.results import BenchRow, PooledErrors


def apart(rows: Iterable[BenchRow]) -> set[str]:
    """Names of the scenarios beyond grip; none where there are no others.

    What sums up rows of several controllers leaves out the same for all of them.
    """
    beyond: dict[str, bool] = {}
    for row in rows:
        beyond[row.scenario] = beyond.get(row.scenario, False) or row.beyond_grip
    found = {name for name, out in beyond.items() if out}
    return set() if len(found) == len(beyond) else found


def rank(errors: PooledErrors) -> tuple[float, float]:
    """By what controllers are ordered: the fewer drives lost the earlier, then by typical error.

    A pooled error would hang on what all controllers have, such as a drifting position.
    """
    typical = errors.typical_m
    value = None if typical is None else typical.value
    return errors.failures / max(errors.runs, 1), math.inf if value is None else value


def values_of(rows: Iterable[BenchRow], factor: str) -> list[str]:
    """The values of a factor in the order of the suite, the classes of grip as it grows."""
    found = dict.fromkeys(getattr(row, factor) for row in rows)
    return (
        [each for each in ("", *get_args(GripClass)) if each in found]
        if factor == "grip"
        else [*found]
    )
