"""How an episode of one vehicle begins."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.kernels import path as paths
from steersman.kernels.fleet import World
from steersman.lead import LeadStart
from steersman.learning.problem import Problem
from steersman.profiles import Profile


class FleetStart(NamedTuple):
    """How an episode of one vehicle begins."""

    road: int
    s: float
    offset: float
    heading: float
    profile: Profile
    speed: float
    """NaN: that which is wished there [m/s]."""
    share: float = 1.0
    """Share of that at which it starts."""
    lead: LeadStart | None = None
    """The car ahead, where there is one."""


def draw_start(problem: Problem, world: World, rng: np.random.Generator) -> FleetStart:
    """Draw road, place, offset, heading and speed of an episode."""
    spread = problem.spread
    road = int(rng.integers(len(problem.roads)))
    length = world.paths.meta[road, paths.LENGTH]
    closed = world.paths.meta[road, paths.CLOSED] > 0.0
    s = 0.0
    if problem.start == "anywhere":
        s = float(rng.uniform(0.0, length if closed else 0.7 * length))
    source = problem.speeds[int(rng.integers(len(problem.speeds)))]
    profile = source.draw(rng, problem.episode_time)
    offset, heading = rng.uniform(-1.0, 1.0, 2) * (spread.offset, spread.heading)
    speed = math.nan
    if profile.throttle is not None:
        speed = source.start_speed(problem.roads[road], s)
    share = 1.0 - rng.uniform(0.0, spread.slower) if spread.slower > 0.0 else 1.0
    start = FleetStart(road, s, float(offset), float(heading), profile, speed, share)
    if not problem.leads:
        return start
    lead = problem.leads[int(rng.integers(len(problem.leads)))]
    return start._replace(lead=lead.draw(rng, problem.episode_time))
