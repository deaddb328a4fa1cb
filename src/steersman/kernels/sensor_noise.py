"""How noisy measurements are, found from the measurements themselves.

Medians, which do not see the few places where the road bends suddenly or the car slides.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# The median of the absolute value of a normal variable, over its standard deviation.
_MEDIAN = 0.6745
# Sums of the squared coefficients of third and fourth differences.
_THIRD, _FOURTH = 20.0, 70.0
# Waypoints from which on fourth differences are as many as a median needs.
_ENOUGH = 8
# Largest step of the logarithm of the running median, in one observation.
_STEP = 0.08


@kernel
def variance(size: float) -> float:
    """Of a normal variable whose absolute value has this median."""
    return (size / _MEDIAN) ** 2


@kernel
def watch(size: float, surprise: float, count: float) -> float:
    """The running median of the absolute value of a signal's surprises, brought up to date.

    It goes up by a step for each that is larger and down for each that is smaller (a stochastic
    quantile). ``count`` is the number of surprises before.
    """
    if count < 1.0:
        return abs(surprise)
    step = max(_STEP, min(1.5 / count, 0.7))
    return float(max(size * math.exp(step if abs(surprise) > size else -step), 1e-9))


@kernel
def points_variance(points: FloatArray, spread: FloatArray) -> float:
    """Variance of the waypoints' errors in each direction [m^2]; ``spread`` (2 n,) is scratch."""
    n = points.shape[0]
    fourth = n >= _ENOUGH
    count = 0
    for axis in range(2):
        for i in range(n - (4 if fourth else 3)):
            value = points[i + 3, axis] - points[i, axis]
            value += 3.0 * (points[i + 1, axis] - points[i + 2, axis])
            if fourth:
                value -= points[i + 4, axis] - points[i + 1, axis]
                value -= 3.0 * (points[i + 2, axis] - points[i + 3, axis])
            value = abs(value)
            k = count
            while k > 0 and spread[k - 1] > value:
                spread[k] = spread[k - 1]
                k -= 1
            spread[k] = value
            count += 1
    middle = 0.5 * (spread[(count - 1) // 2] + spread[count // 2])
    return variance(middle) / (_FOURTH if fourth else _THIRD)
