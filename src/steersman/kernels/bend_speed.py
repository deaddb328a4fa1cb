"""Speeds and longitudinal accelerations that grip allows a point mass on a road.

"Friction circle", Rajamani, Vehicle Dynamics and Control, 2nd ed., ch. 13.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.types import FloatArray

# Least curvature that limits a speed [1/m].
_STRAIGHT = 1e-4
# Share of the grip for bends and pedals together, and for braking where bends take it all.
_CIRCLE, _LEAST_BRAKING = 0.7, 0.1


@kernel
def bend_speed(grip: float, kappa: float) -> float:
    """Speed [m/s] at which a bend of curvature ``kappa`` [1/m] takes the ``grip`` [m/s^2]."""
    return math.sqrt(grip / max(abs(kappa), _STRAIGHT))


@kernel
def approach_speed(
    road: FloatArray, spacing: float, start: float, used: float, braking: float
) -> float:
    """The largest speed at ``start`` [m] from which every bend behind it can be braked for [m/s].

    Args:
        road: (n,) curvature [1/m], ``spacing`` [m] apart from 0 on.
        spacing: distance of two.
        start: place along the road.
        used: acceleration across that bends may take [m/s^2].
        braking: deceleration before them [m/s^2].
    """
    least = math.inf
    for j in range(road.shape[0]):
        way = j * spacing - start
        if way >= 0.0:
            square = used / max(abs(road[j]), _STRAIGHT) + 2.0 * braking * way
            least = min(least, square)
    return math.sqrt(least)


@kernel
def for_pedals(grip: float, braking: float, v: float, kappa: float) -> tuple[float, float]:
    """Hardest braking (negative) and speeding up that the bend leaves of the grip [m/s^2].

    ``braking`` is the most for speeding up [m/s^2].
    """
    across = v * v * abs(kappa)
    left = math.sqrt(max((_CIRCLE * grip) ** 2 - across * across, 0.0))
    return -max(left, _LEAST_BRAKING * grip), min(left, braking)
