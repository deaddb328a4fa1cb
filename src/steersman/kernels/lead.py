"""A car ahead on the same road: its speed over time, and the gap to it."""

from __future__ import annotations

import math

from steersman.kernels import path as paths
from steersman.kernels import reward as rew
from steersman.kernels.compiled import inlined, kernel
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.speed import CAP_SCALE, road_limit
from steersman.kernels.vehicle import interpolate
from steersman.types import FloatArray

# Columns of a lead row: bumper to bumper [m]; the car ahead's speed [m/s]; both cars' centres apart
# when they touch [m]; the gap wished at standstill [m] and its growth with the own speed [s]; the
# own acceleration one step ago [m/s^2].
GAP, SPEED, LENGTH, STANDSTILL, HEADWAY, SURGE = range(6)
N_LEAD = 6


@kernel
def lead_speed(world: World, n: int, p: int, time: float, s: float) -> float:
    """Speed [m/s] of the car ahead of vehicle ``n``, at arc length ``s`` [m] of path ``p``.

    That of its trace, and no more than the limits along the road, which hold for both cars; there
    are none beyond the end of an open path.
    """
    speed, length = world.speed, world.paths.meta[p, paths.LENGTH]
    now = interpolate(world.lead_times[n], world.lead_speeds[n], time)
    if world.paths.meta[p, paths.CLOSED] > 0.0:
        s -= length * math.floor(s / length)
    if speed.cap.shape[0] > 0 and s < length:
        now = min(now, speed.rows[n, CAP_SCALE] * road_limit(speed, world.paths, p, s))
    return now


@inlined
def move_lead(world: World, fleet: Fleet, n: int, time: float, s: float, gain: float) -> None:
    """Move the car ahead of vehicle ``n``, which itself has come ``gain`` [m] further, to ``s``.

    ``time`` [s] is that after the step. Its speed is linear over the step (trapezoidal rule).
    """
    lead = fleet.lead[n]
    before = lead[SPEED]
    there = s + lead[GAP] + lead[LENGTH]
    lead[SPEED] = lead_speed(world, n, fleet.path[n], time, there)
    lead[GAP] += 0.5 * (before + lead[SPEED]) * world.dt - gain


@kernel
def wished_gap(lead: FloatArray, v: float) -> float:
    """Gap that is wished at an own speed [m]."""
    return float(lead[STANDSTILL] + lead[HEADWAY] * v)


@kernel
def describe_lead(lead: FloatArray, step: FloatArray) -> None:
    """Write what belongs to the car ahead into a judged step (N_JUDGED,) that is described.

    The own acceleration is remembered for the next one's jerk.
    """
    v, a_x = step[rew.SPEED], step[rew.A_X]
    step[rew.GAP], step[rew.RELATIVE_SPEED] = lead[GAP], lead[SPEED] - v
    step[rew.WISHED_GAP], step[rew.JERK] = wished_gap(lead, v), (a_x - lead[SURGE]) / step[rew.DT]
    lead[SURGE] = a_x
