"""How noisy measurements are, found from the measurements themselves."""

from __future__ import annotations

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# The median of the absolute values of some twenty differences over their standard deviation; of one
# normal variable it is 0.6745, and the square of a median of few values is larger on average.
_MEDIAN = 0.74
# Sums of the squared coefficients of third and fourth differences.
_THIRD, _FOURTH = 20.0, 70.0
# Waypoints from which on fourth differences are as many as a median needs.
_ENOUGH = 8
# Weight of the present step in an estimate, in the long run.
SHARE = 0.03


@kernel
def points_variance(points: FloatArray, spread: FloatArray) -> float:
    """Variance of the waypoints' errors in each direction [m^2]; ``spread`` (2 n,) is scratch.

    From the median of their fourth differences, which does not see where the road bends suddenly.
    """
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
    return float((middle / _MEDIAN) ** 2 / (_FOURTH if fourth else _THIRD))


@kernel
def parabola_share(n: int, spacing: float) -> tuple[float, float]:
    """Variances of value and slope at the end of a parabola through ``n`` points.

    Of errors of variance 1; a sensor that fits its errors to noisy waypoints has these.
    """
    value = 3.0 * (3.0 * n * n - 3.0 * n + 2.0) / (n * (n + 1.0) * (n + 2.0))
    slope = 12.0 * (2.0 * n - 1.0) * (8.0 * n - 11.0)
    slope /= n * (n * n - 1.0) * (n * n - 4.0) * spacing * spacing
    return value, slope
