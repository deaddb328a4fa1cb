"""What every schedule has to fulfil."""

from __future__ import annotations

import math
from collections.abc import Iterator

from steersman.contracts import Contract
from steersman.learning.schedules import Schedule

_TOTALS = (1.0, 300.0, 1e6)
_SHARES = tuple(i / 64 for i in range(65))


def values_are_finite(schedule: Schedule) -> Iterator[str]:
    """From the first step to the last, of short and of long trainings."""
    for total in _TOTALS:
        for share in _SHARES:
            value = schedule.value(share * total, total)
            if not math.isfinite(value):
                yield f"gives {value} at step {share * total:g} of {total:g}"


def a_value_depends_on_the_step_alone(schedule: Schedule) -> Iterator[str]:
    """A training that is resumed goes on with the same values."""
    for total in _TOTALS:
        forth = [schedule.value(share * total, total) for share in _SHARES]
        back = [schedule.value(share * total, total) for share in reversed(_SHARES)]
        if forth != back[::-1]:
            yield f"gives other values of {total:g} steps in another order"


check: Contract[Schedule] = Contract(values_are_finite, a_value_depends_on_the_step_alone)
