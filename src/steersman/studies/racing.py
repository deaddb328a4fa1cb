"""Which runs of a trial are driven: those that cost most first, until it cannot be a good one.

The cost of a trial is the mean over its runs, and none costs less than nothing: what a part of the
runs costs, over the number of all, is a lower bound. A trial whose bound exceeds the cost of the
best quarter of the trials before it is stopped, with the bound as its cost. The sampler splits
trials into the best tenth and all others, in which their cost does not matter, so it draws as if
every trial had been driven to its end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from steersman.studies.objective import RunCost

# Share of the trials that counts as good, the fewest of them, and runs between two looks.
_GOOD, _FEWEST, _ROUND = 0.25, 3, 8


def affordable(costs: Sequence[float]) -> float:
    """The cost [m] above which a trial is stopped, given those of the trials before it.

    >>> affordable([5.0, 1.0]), affordable([4.0, 3.0, 2.0, 1.0]), affordable([1.0] * 3 + [2.0] * 97)
    (inf, 3.0, 2.0)
    """
    place = max(math.ceil(_GOOD * len(costs)), _FEWEST)
    return sorted(costs)[place - 1] if len(costs) >= place else math.inf


def raced(
    drive: Callable[[Sequence[int]], Sequence[RunCost]], order: Sequence[int], most: float
) -> dict[int, RunCost]:
    """The costs of the runs that were driven, by their numbers; all of them, or the trial stopped.

    Args:
        drive: gives the costs of the runs of these numbers.
        order: the numbers of all runs, in the order in which they are driven.
        most: cost of the trial [m] above which it is stopped.
    """
    driven: dict[int, RunCost] = {}
    for begin in range(0, len(order), _ROUND):
        numbers = order[begin : begin + _ROUND]
        driven |= dict(zip(numbers, drive(numbers), strict=True))
        if bound(driven, len(order)) > most:
            break
    return driven


def bound(driven: dict[int, RunCost], runs: int) -> float:
    """What a trial of so many runs costs at least [m]."""
    return sum(one.total for one in driven.values()) / runs
