"""How cars, delays and sensors differ from episode to episode."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from steersman.config import Settings, param
from steersman.kernels import vehicle as car
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.vehicle import GRAVITY
from steersman.profiles import Profile
from steersman.vehicles import Vehicle

if TYPE_CHECKING:
    from steersman.learning.problem import Problem


class Spread(Settings):
    """How far cars and starts differ from episode to episode; zero: not at all."""

    mass: float = param(0.0, "-", "Mass is scaled by up to 1 +- this.", ge=0, lt=1)
    yaw_inertia: float = param(0.0, "-", "Yaw inertia is scaled by up to 1 +- this.", ge=0, lt=1)
    stiffness: float = param(0.0, "-", "Each axle's stiffness, up to 1 +- this.", ge=0, lt=1)
    friction: float = param(0.0, "-", "Friction is scaled by up to 1 +- this.", ge=0, lt=1)
    delay: float = param(0.0, "s", "Longest additional steering delay.", ge=0, le=0.4)
    steer_rate: float = param(
        0.0, "-", "The steering actuator's rates are lower by up to this share.", ge=0, lt=1
    )
    steer_bias: float = param(
        0.0, "rad", "Inner wheel angle at centred steering, up to this to either side.", ge=0
    )
    waypoints: float = param(
        0.0,
        "-",
        "Errors of waypoints and of the other sensors are scaled by a draw from 1 - this to 1.",
        ge=0,
        le=1,
    )
    nominal: float = param(
        0.0, "-", "Share of episodes with the nominal car, delay and sensor.", ge=0, le=1
    )
    a_lat_max: float | None = param(
        None, "m/s^2", "So are those whose speed cap allows more than this; null: none.", gt=0
    )
    slippery: float = param(0.0, "-", "Share of episodes on a slippery road.", ge=0, le=1)
    least_friction: float = param(
        0.4,
        "-",
        "Tyre friction there: from this to the vehicle's own, evenly in its logarithm.",
        gt=0,
    )
    used_grip: float = param(
        0.6, "-", "Share of that grip which speed caps ask for at most.", gt=0, le=2
    )
    offset: float = param(0.0, "m", "Start up to this far beside the path.", ge=0)
    heading: float = param(0.0, "rad", "Start turned by up to this.", ge=0)
    slower: float = param(
        0.0, "-", "Start slower than wished by a share of up to this.", ge=0, lt=1
    )


def lateral_cap(profile: Profile) -> float:
    """Lateral acceleration that a profile's speed cap allows [m/s^2]; infinite without a cap."""
    return math.inf if profile.a_lat_max is None else profile.a_lat_max * profile.cap_scale**2


class CarSpread:
    """Draws the cars of a problem's episodes."""

    def __init__(self, problem: Problem, world: World, fleet: Fleet, vehicle: Vehicle) -> None:
        """The vehicle is the nominal one."""
        self._problem, self._fleet = problem, fleet
        self._rows, self._base = world.vehicles.rows, vehicle.row()

    def vary(self, i: int, rng: np.random.Generator) -> None:
        """Draw this episode's car, delay and sensor."""
        spread = self._problem.spread
        row = self._rows[i]
        row[:] = self._base
        self._fleet.levels[i] = 1.0
        if spread.nominal > 0.0 and rng.uniform() < spread.nominal:
            self.make_nominal(i)
            return
        if spread.waypoints > 0.0:
            self._fleet.levels[i] = 1.0 - rng.uniform(0.0, spread.waypoints)
        draws = 1.0 + rng.uniform(-1.0, 1.0, 5) * (
            spread.mass,
            spread.yaw_inertia,
            spread.stiffness,
            spread.stiffness,
            spread.friction,
        )
        for column, factor in zip(
            (car.MASS, car.INERTIA, car.C_F, car.C_R, car.MU), draws, strict=True
        ):
            row[column] *= factor
        if spread.steer_rate > 0.0:
            row[[car.STEER_UP, car.STEER_DOWN]] *= 1.0 - rng.uniform(0.0, spread.steer_rate)
        if spread.steer_bias > 0.0:
            row[car.STEER_BIAS] += rng.uniform(-1.0, 1.0) * spread.steer_bias / row[car.MAX_STEER]
        extra = int(rng.integers(round(spread.delay / self._problem.plant.h) + 1))
        self._fleet.delay[i] = self._problem.plant.delay_of(self._problem.vehicle) + extra

    def make_slippery(self, i: int, profile: Profile, rng: np.random.Generator) -> Profile:
        """Lower the friction; the profile with its speed cap lowered to that grip."""
        row = self._rows[i]
        least, own = self._problem.spread.least_friction, row[car.MU]
        row[car.MU] = min(least * (own / least) ** rng.uniform(), own)
        cap = self._problem.spread.used_grip * row[car.MU] * GRAVITY
        if profile.a_lat_max is None or lateral_cap(profile) <= cap:
            return profile
        return profile._replace(cap_scale=math.sqrt(cap / profile.a_lat_max))

    def make_nominal(self, i: int) -> None:
        """The car, delay and sensor without any spread."""
        self._rows[i] = self._base
        self._fleet.delay[i] = self._problem.plant.delay_of(self._problem.vehicle)
        self._fleet.levels[i] = 1.0 - self._problem.spread.waypoints
