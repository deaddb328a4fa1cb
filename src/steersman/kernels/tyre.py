"""Tyres: stiffness over load, lateral force, grip shared with the longitudinal force.

Sources: brush tyre, Pacejka, Tyre and Vehicle Dynamics, 3rd ed., sec. 3.2 (Fiala's cubic, which is
also the law of PhysX vehicles); its derating by longitudinal force, the friction ellipse. Stiffness
over load: in proportion, or by PhysX's smoothing function (PxVehicleUpdate.cpp).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.kernels.compiled import inlined

# A wheel takes its half of the axle's force up to this share of its grip.
_DRIVE_GRIP = 0.5
# A braked tyre keeps at least this share of its grip for cornering.
_MIN_SIDE_GRIP = 0.1


@inlined
def split_axle(demand: float, grip_left: float, grip_right: float) -> tuple[float, float]:
    """An axle's force on its two wheels [N]: halves, as by an open differential.

    What a wheel cannot carry without spinning passes to the other one (limited slip).
    """
    half = 0.5 * demand
    left = min(max(half, -_DRIVE_GRIP * grip_left), _DRIVE_GRIP * grip_left)
    right = min(max(half, -_DRIVE_GRIP * grip_right), _DRIVE_GRIP * grip_right)
    return left + (half - right), right + (half - left)


@inlined
def side_force(stiffness: float, slip: float, limit: float) -> float:
    """Fiala's lateral force for tan(slip angle), opposing it; ``limit`` is the grip left [N]."""
    z = stiffness * abs(slip) / (3.0 * limit + 1e-9)
    if z >= 1.0:
        return -math.copysign(limit, slip)
    return -stiffness * slip * (1.0 - z + z * z / 3.0)


class AxleTyres(NamedTuple):
    """What of an axle's tyres does not change while the car drives."""

    per_load: float
    """Cornering stiffness per load of a wheel at rest [1/rad]."""
    rest: float
    """Load of a wheel at rest [N]."""
    limit: float
    """Loads at rest from which on stiffness grows no more [-]; 0: in proportion to the load."""
    at_rest: float
    """Smoothing function at the load at rest."""


@inlined
def axle_tyres(per_load: float, rest: float, limit: float) -> AxleTyres:
    """An axle's tyres from their stiffness per load, load at rest and limit."""
    return AxleTyres(per_load, rest, limit, _smoothing(3.0 / limit) if limit > 0.0 else 1.0)


@inlined
def tyre_stiffness(tyres: AxleTyres, load: float) -> float:
    """Cornering stiffness of a wheel under ``load`` [N/rad]; at rest ``per_load`` times its load.

    With ``limit`` 0 in proportion to the load. Otherwise by PhysX's law: it grows ever slower, and
    no more from ``limit`` static loads on.
    """
    if tyres.limit <= 0.0:
        return tyres.per_load * load
    share = _smoothing(3.0 * load / (tyres.rest * tyres.limit))
    return tyres.per_load * tyres.rest * share / tyres.at_rest


@inlined
def _smoothing(x: float) -> float:
    """PhysX's smoothing function: slope 1 at 0, and 1 with slope 0 from 3 on."""
    x = min(x, 3.0)
    return x - x * x / 3.0 + x * x * x / 27.0


@inlined
def wheel_force(
    stiffness: float,
    grip: float,
    demand: float,
    tangent: float,
    v_x: float,
    v_y: float,
    slip_speed: float,
) -> tuple[float, float]:
    """Force of one wheel in the vehicle's frame, from the velocity of its contact point there.

    Slip is softened below ``slip_speed``: a standing tyre has no slip angle.
    """
    c = 1.0 / math.sqrt(1.0 + tangent * tangent)
    s = tangent * c
    rolling = c * v_x + s * v_y
    across = c * v_y - s * v_x
    slip = across / math.sqrt(rolling * rolling + slip_speed * slip_speed)
    limit = math.sqrt(1.0 - _MIN_SIDE_GRIP * _MIN_SIDE_GRIP) * grip
    f_x = min(max(demand, -limit), limit)
    f_y = side_force(stiffness, slip, math.sqrt(grip * grip - f_x * f_x))
    return c * f_x - s * f_y, s * f_x + c * f_y
