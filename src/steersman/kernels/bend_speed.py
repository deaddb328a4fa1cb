"""Speeds and longitudinal accelerations that grip allows a point mass on a road.

"Friction circle", Rajamani, Vehicle Dynamics and Control, 2nd ed., ch. 13.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.vehicle import BRAKE_FRONT, DRIVE_FRONT, L_F, L_R
from steersman.types import FloatArray

# Least curvature that limits a speed [1/m].
_STRAIGHT = 1e-4
# Shares of the grip for bends and pedals together, while driving and while braking: a car that is
# too fast uses more of it.
_DRIVING, _BRAKING = 0.7, 0.85
# Share for braking where bends take it all: a car that slides has to become slower.
_LEAST_BRAKING = 0.4


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
def pedal_shares(row: FloatArray) -> tuple[float, float]:
    """Shares of the car's grip that driving and braking can use: one axle is first at its limit."""
    front = row[L_R] / (row[L_F] + row[L_R])
    return _axle_first(front, row[DRIVE_FRONT]), _axle_first(front, row[BRAKE_FRONT])


@kernel
def _axle_first(load: float, force: float) -> float:
    """The smaller load of an axle over its force; both are the front's shares."""
    if load <= force:
        return float(load / force)
    return float((1.0 - load) / (1.0 - force))


@kernel
def for_pedals(
    grip: float, braking: float, shares: tuple[float, float], v: float, kappa: float
) -> tuple[float, float]:
    """Hardest braking (negative) and speeding up that the bend leaves of the grip [m/s^2].

    ``braking`` is the most for speeding up [m/s^2], ``shares`` are those of ``pedal_shares``.
    """
    drive, brake = shares
    across = v * v * abs(kappa)
    slowing = max(brake * _left(_BRAKING * grip, across), _LEAST_BRAKING * grip)
    return -slowing, min(drive * _left(_DRIVING * grip, across), braking)


@kernel
def _left(grip: float, across: float) -> float:
    return math.sqrt(max(grip * grip - across * across, 0.0))
