"""Reversals of a signal: how often it turns back, small ripple left out."""

from __future__ import annotations

import numpy as np

from steersman.types import FloatArray


def reversals(values: FloatArray, gap: float) -> int:
    """How often a signal turns back by at least ``gap`` after it moved by as much."""
    steps = np.sign(np.diff(values))
    # Between its turning points a signal only rises or only falls; they are all that counts.
    turns = np.flatnonzero(steps[1:] != steps[:-1]) + 1
    count, direction = 0, 0
    low = high = float(values[0])
    for value in [*values[turns].tolist(), float(values[-1])]:
        low, high = min(low, value), max(high, value)
        if value - low >= gap and direction <= 0:
            count, direction = count + (direction < 0), 1
        elif high - value >= gap and direction >= 0:
            count, direction = count + (direction > 0), -1
        else:
            continue
        low = high = value
    return count
