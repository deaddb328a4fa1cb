"""How much grip a controller that limits the speed reckons with, and how much of it it uses.

The friction is given, or it is found by driving: docs/equations/grip_speed.md has the equations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.config import param
from steersman.controllers.base import ControllerComponent
from steersman.kernels.mpc_delay import road_ahead
from steersman.kernels.vehicle import GRAVITY
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle

# Time constant of the accelerations that tyres have shown [s].
_SHOWN_TIME = 0.15
# What an acceleration along the road counts, where nothing shows that tyres are near their grip.
_ALONG = 0.5
# The limit moves on from the last one, unless that is so far from the speed [m/s].
_AWAY = 1.0
# After a slide, this share of the friction that was found then is reckoned with, at most: it is
# found too large at first.
_AFTER_SLIDE = 0.8


class Belief(NamedTuple):
    """What a drive has shown of the friction."""

    friction: float
    """Friction to reckon with [-]."""
    most: float
    """The largest that it may become; lower after a slide [-]."""
    a_x: float = 0.0
    """Acceleration along the road, filtered [m/s^2]."""
    a_y: float = 0.0
    """Across it [m/s^2]."""
    v: float = math.nan
    """Speed one period ago [m/s]."""


class GripUse(ControllerComponent):
    """What all controllers have that limit the speed to what grip allows."""

    friction: float | None = param(
        None, "-", "Tyre friction to reckon with; null: the nominal vehicle's.", gt=0
    )
    found: bool = param(
        False,
        "-",
        "Find the friction by driving: reckon with little at first, and with more as tyres show "
        "it; with less when mpc_delay or nmpc finds less.",
    )
    least: float = param(
        0.24, "-", "Where it is found: the friction at first, and the least.", gt=0, le=2
    )
    reach: float = param(
        2.3, "-", "Where it is found: friction over what accelerations have shown of it.", ge=1
    )
    growth: float = param(
        1.8, "1/s", "Its largest rate of growth, relative, while it is below `cautious`.", gt=0
    )
    cautious: float = param(
        0.42,
        "-",
        "Friction from which on it grows slowly: a slippery patch shows itself only in the bend.",
        gt=0,
    )
    slow_growth: float = param(0.05, "1/s", "Its largest rate of growth from there on.", gt=0)
    used: float = param(0.6, "-", "Share of the grip for bends.", gt=0, le=1)
    braking: float = param(
        0.48, "-", "Share of the grip for braking before them, and for speeding up.", gt=0, le=1
    )

    def believed(self, vehicle: Vehicle) -> Belief:
        """What is believed before the first step."""
        most = vehicle.friction if self.friction is None else self.friction
        return Belief(min(self.least, most) if self.found else most, most)

    def shown(self, belief: Belief, o: Observation, found: float, dt: float) -> Belief:
        """What is believed after one more period of ``dt`` [s].

        The friction grows while the car's acceleration comes near it, and falls to the one that the
        axles' forces show, ``found``, once the tyres slide.
        """
        if not self.found:
            return belief
        surge = 0.0 if math.isnan(belief.v) else (o.v_x - belief.v) / dt
        blend = min(dt / _SHOWN_TIME, 1.0)
        a_x = belief.a_x + blend * (surge - belief.a_x)
        a_y = belief.a_y + blend * (o.v_x * o.yaw_rate - belief.a_y)
        reached = self.reach * math.hypot(_ALONG * a_x, a_y) / GRAVITY
        rate = self.growth if belief.friction < self.cautious else self.slow_growth
        grown = min(reached, belief.friction * (1.0 + rate * dt))
        friction, most = max(belief.friction, grown), belief.most
        if found < belief.friction:
            most = min(most, _AFTER_SLIDE * found)
        least = min(self.least, belief.most)
        friction = max(min(friction, most, found), least)
        return Belief(friction, max(most, least), a_x, a_y, o.v_x)


def near_speed(limit: float, v: float) -> float:
    """The last limit of the speed, or as near it as is near the speed ``v``, both in [m/s]."""
    return min(max(limit, v - _AWAY), v + _AWAY) if math.isfinite(limit) else v


def bends_in_view(o: Observation) -> FloatArray:
    """Curvatures [1/m] between the waypoints, of which there are at least four."""
    kappa = np.empty(len(o.preview) - 2)
    road_ahead(o.preview, o.spacing, o.curvature, 0.0, o.spacing, kappa)
    return kappa
