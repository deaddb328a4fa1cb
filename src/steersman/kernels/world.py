"""One control step of N vehicles on their roads: the compiled loop under every drive.

A rollout is a fleet of one; environments, benchmark and tuning step the same functions. A step is
:func:`decide` (pedals, actuator faults), the motion, and :func:`conclude` (place on the road, end
of the drive, what the sensors measure next). Where :mod:`steersman.disturbances` acts, it fills
arrays of the fleet between the steps.
"""

from __future__ import annotations

import math

import numpy as np

from steersman.kernels import lead as ahead
from steersman.kernels import observe as obs
from steersman.kernels import vehicle as car
from steersman.kernels.compiled import inlined, kernel
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.path import CLOSED, LENGTH
from steersman.kernels.speed import AT_END, STANDING, pedals, stops, wishes
from steersman.kernels.vehicle import VehicleTable
from steersman.types import FloatArray

# Reasons to end a drive; GOAL_REACHED is the end of an open road or the laps that were asked for,
# OVERRAN that the car did not stand at the end of a road where that was wished.
RUNNING, LEFT_CORRIDOR, ROLLED, GOAL_REACHED, TIME_UP, COLLIDED, OVERRAN = range(7)
FAILED = LEFT_CORRIDOR, ROLLED, COLLIDED, OVERRAN
# What arrives of an observation: the measurement; the last numbers again, at the present time or
# at their own; or NaN.
MEASURED, FROZEN, DROPPED, NOTHING = range(4)
# Columns of a clock row.
CLOCK_STEPS, CLOCK_INTEGRAL, CLOCK_LIMIT, CLOCK_DISTANCE, CLOCK_GOAL = range(5)
# Distances and times that differ by less are the same, but for rounding [m], [s].
_SAME = 1e-9


@kernel
def hold_back(steer: float, delayed: FloatArray, delay: int, substeps: int) -> tuple[int, int]:
    """Put a command into the delay line; returns the whole periods of the delay and the rest."""
    for i in range(delayed.shape[0] - 1, 0, -1):
        delayed[i] = delayed[i - 1]
    delayed[0] = steer
    whole = delay // substeps
    return whole, delay - whole * substeps


@kernel
def drive(  # noqa: PLR0917 - numba takes no keyword-only arguments
    vehicles: VehicleTable,
    n: int,
    state: FloatArray,
    command: FloatArray,
    delayed: FloatArray,
    delay: int,
    h: float,
    substeps: int,
    work: FloatArray,
    fine: FloatArray,
) -> None:
    """Advance one vehicle by one control period; steering takes effect ``delay`` substeps late.

    ``fine`` (substeps, 2) gets a_x and a_y [m/s^2] of every substep; of shape (0, 2) it does not,
    with the same motion to the bit.
    """
    whole, late = hold_back(command[car.CMD_STEER], delayed, delay, substeps)
    if fine.shape[0] > 0:
        for i in range(substeps):
            command[car.CMD_STEER] = delayed[whole + 1] if i < late else delayed[whole]
            car.advance(vehicles, n, state, command, h, 1, work)
            fine[i, 0], fine[i, 1] = state[car.AX], state[car.AY]
        return
    if late > 0:
        command[car.CMD_STEER] = delayed[whole + 1]
        car.advance(vehicles, n, state, command, h, late, work)
    command[car.CMD_STEER] = delayed[whole]
    car.advance(vehicles, n, state, command, h, substeps - late, work)


@inlined
def look(world: World, fleet: Fleet, n: int) -> None:
    """Renew the observation of vehicle ``n``, whose tracking row is up to date.

    With latency it is one measured some control periods ago; at the start of a drive, the first.
    The speeds wished ahead are no measurement: they are those of the true place and time.
    """
    if fleet.wishes.shape[1] > 0:
        wishes(
            world.speed,
            n,
            world.paths,
            fleet.path[n],
            fleet.clock[n, CLOCK_STEPS] * world.dt,
            fleet.tracking[n, obs.S],
            world.spacing,
            fleet.wishes[n],
        )
    late = fleet.late[n]
    if late.shape[0] == 0:
        _measure(world, fleet, n, fleet.rows[n])
        return
    oldest = late.shape[0] - 1
    first = fleet.clock[n, CLOCK_STEPS] == 0.0
    for j in range(late.shape[1]):
        for i in range(oldest, 0, -1):
            late[i, j] = late[i - 1, j]
    _measure(world, fleet, n, late[0])
    for j in range(late.shape[1]):
        for i in range(1, oldest + 1 if first else 0):
            late[i, j] = late[0, j]
        fleet.rows[n, j] = late[oldest, j]


@inlined
def _measure(world: World, fleet: Fleet, n: int, row: FloatArray) -> None:
    """Measure vehicle ``n``; what does not arrive leaves the row as it is."""
    arrives = fleet.arrives[n]
    if arrives in (FROZEN, DROPPED):
        return
    if arrives == NOTHING:
        for i in range(row.shape[0]):
            row[i] = math.nan
        return
    state, tracking = fleet.state[n], fleet.tracking[n]
    if fleet.errors.shape[1] > 0:
        for i in range(car.N_STATE):
            fleet.measured[i] = state[i]
        for i in range(obs.N_MEASURED):
            fleet.measured[i] += fleet.errors[n, i]
        fleet.measured[car.VX] += fleet.errors[n, obs.V_X_SCALE] * state[car.VX]
        obs.track(world.paths, fleet.path[n], fleet.measured, tracking[obs.S], fleet.place)
        state, tracking = fleet.measured, fleet.place
    obs.sense(
        world.paths,
        fleet.path[n],
        state,
        tracking,
        world.spacing,
        (row.shape[0] - obs.O_PREVIEW) // 2,
        fleet.shifts[n],
        world.weights,
        row,
    )


@inlined
def decide(world: World, fleet: Fleet, n: int, steer: float) -> float:
    """Fill the command of vehicle ``n`` for a steering; returns where the vehicle will be.

    That is the arc length [m] that it reaches in this step at its present speed.
    """
    state, clock, dt, command = fleet.state[n], fleet.clock[n], world.dt, fleet.command[n]
    speed, s = np.hypot(state[car.VX], state[car.VY]), fleet.tracking[n, obs.S]
    throttle, brake, clock[CLOCK_INTEGRAL] = pedals(
        world.speed,
        n,
        world.paths,
        fleet.path[n],
        clock[CLOCK_STEPS] * dt,
        s,
        speed,
        clock[CLOCK_INTEGRAL],
        dt,
        fleet.speed_limit[n],
    )
    fleet.sent[n] = min(max(steer, fleet.bounds[n, 0]), fleet.bounds[n, 1])
    command[0], command[1], command[2] = fleet.sent[n], throttle, brake
    return float(s + speed * dt)


@inlined
def find_end(world: World, fleet: Fleet, n: int) -> None:
    """Note whether the drive of vehicle ``n`` ends where it is."""
    clock = fleet.clock[n]
    fleet.ended[n] = RUNNING
    # Not "greater than": an error that is not a number must end the drive too.
    inside = abs(fleet.tracking[n, obs.D]) <= world.corridor
    if not inside:
        fleet.ended[n] = LEFT_CORRIDOR
    elif car.rolls_over(world.vehicles.rows[n], fleet.state[n, car.LOAD_AY]):
        fleet.ended[n] = ROLLED
    elif fleet.lead.shape[1] > 0 and not fleet.lead[n, ahead.GAP] > 0.0:
        fleet.ended[n] = COLLIDED
    elif stops(world.speed, n, world.paths, fleet.path[n]):
        _find_stop(world, fleet, n)
    elif clock[CLOCK_DISTANCE] >= clock[CLOCK_GOAL] - _SAME:
        fleet.ended[n] = GOAL_REACHED
    if fleet.ended[n] == RUNNING and clock[CLOCK_STEPS] * world.dt >= clock[CLOCK_LIMIT] - _SAME:
        fleet.ended[n] = TIME_UP


@inlined
def _find_stop(world: World, fleet: Fleet, n: int) -> None:
    """The end of a drive that is to stand at the end of its path."""
    state = fleet.state[n]
    left = world.paths.meta[fleet.path[n], LENGTH] - fleet.tracking[n, obs.S]
    if left < -AT_END:
        fleet.ended[n] = OVERRAN
    elif left <= AT_END and np.hypot(state[car.VX], state[car.VY]) <= STANDING:
        fleet.ended[n] = GOAL_REACHED


@inlined
def conclude(world: World, fleet: Fleet, n: int, near: float) -> None:
    """Find vehicle ``n``, which has moved, on its path around ``near`` [m]; end or look."""
    clock, tracking = fleet.clock[n], fleet.tracking[n]
    before = tracking[obs.S]
    obs.track(world.paths, fleet.path[n], fleet.state[n], near, tracking)
    gain = tracking[obs.S] - before
    meta = world.paths.meta[fleet.path[n]]
    if meta[CLOSED] > 0.0:
        gain -= meta[LENGTH] * np.rint(gain / meta[LENGTH])
    clock[CLOCK_DISTANCE] += gain
    clock[CLOCK_STEPS] += 1.0
    if fleet.lead.shape[1] > 0:
        ahead.move_lead(world, fleet, n, clock[CLOCK_STEPS] * world.dt, tracking[obs.S], gain)
    find_end(world, fleet, n)
    look(world, fleet, n)


@inlined
def carry_out(world: World, fleet: Fleet, n: int, near: float) -> None:
    """Move vehicle ``n`` by one control period under its command, and conclude."""
    drive(
        world.vehicles,
        n,
        fleet.state[n],
        fleet.command[n],
        fleet.delayed[n],
        fleet.delay[n],
        world.h,
        world.substeps,
        fleet.work,
        fleet.fine[n],
    )
    conclude(world, fleet, n, near)


@inlined
def advance(world: World, fleet: Fleet, n: int, steer: float) -> None:
    """Move vehicle ``n`` by one control period under a steering command in [-1, 1]."""
    carry_out(world, fleet, n, decide(world, fleet, n, steer))
