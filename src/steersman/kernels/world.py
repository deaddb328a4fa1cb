"""One control step of N vehicles on their roads: the compiled loop under every drive.

A rollout is a fleet of one; environments, benchmark and tuning step the same functions. A step is
:func:`decide` (pedals, actuator faults), the motion, and :func:`conclude` (place on the road, end
of the drive, what the sensors measure next). Where :mod:`steersman.disturbances` acts, it fills
arrays of the fleet between the steps.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import observe as obs
from steersman.kernels import reward as rew
from steersman.kernels import vehicle as car
from steersman.kernels.compiled import kernel
from steersman.kernels.path import CLOSED, LENGTH, PathTable
from steersman.kernels.speed import SpeedTable, pedals
from steersman.kernels.vehicle import VehicleTable
from steersman.types import FloatArray

# Reasons to end a drive; GOAL_REACHED is the end of an open road or the laps that were asked for.
RUNNING, LEFT_CORRIDOR, ROLLED, GOAL_REACHED, TIME_UP = range(5)
FAILED = LEFT_CORRIDOR, ROLLED
# Commands that the delay line can hold.
DELAY_LINE = 16
# What arrives of an observation: the measurement; the last numbers again, at the present time or
# at their own; or NaN.
MEASURED, FROZEN, DROPPED, NOTHING = range(4)
# Columns of a clock row.
CLOCK_STEPS, CLOCK_INTEGRAL, CLOCK_LIMIT, CLOCK_DISTANCE, CLOCK_GOAL = range(5)
# Distances and times that differ by less are the same, but for rounding [m], [s].
_SAME = 1e-9


class World(NamedTuple):
    """What does not change during a step."""

    vehicles: VehicleTable
    paths: PathTable
    speed: SpeedTable
    weights: FloatArray
    """(3, waypoints) of the fit through shifted waypoints, see :func:`observe.sense`."""
    spacing: float
    """Distance between waypoints [m]."""
    h: float
    """Integration step [s]."""
    substeps: int
    dt: float
    """Control period [s]."""
    corridor: float
    """Half width of the corridor [m]."""


class Fleet(NamedTuple):
    """What changes: a row for each vehicle."""

    state: FloatArray
    tracking: FloatArray
    rows: FloatArray
    """(N, O_PREVIEW + 2 waypoints) observations."""
    delayed: FloatArray
    """(N, DELAY_LINE) the last steering commands, newest first."""
    delay: Any
    """(N,) int64 steering delay in substeps."""
    path: Any
    """(N,) int64 number of the path."""
    clock: FloatArray
    """(N, 5): control steps driven, speed controller's integral, time limit [s], distance driven
    along the path [m], distance at which the drive ends [m]."""
    ended: Any
    """(N,) int64 reason the drive ended with this step, or RUNNING."""
    errors: FloatArray
    """(N, N_MEASURED or 0) errors of the next measured pose and velocities, added to the state."""
    shifts: FloatArray
    """(N, waypoints or 0, 2) errors of the next waypoints in the vehicle's frame [m]."""
    levels: FloatArray
    """(N,) factor on the waypoints' errors [-]."""
    arrives: Any
    """(N,) int64 what arrives of the next observation: MEASURED, FROZEN, DROPPED or NOTHING."""
    bounds: FloatArray
    """(N, 2) the least and the largest steering command that the actuator takes [-]."""
    sent: FloatArray
    """(N,) steering command that the actuator got in this step [-]."""
    fine: FloatArray
    """(N, substeps or 0, 2) a_x and a_y at this step's integration steps [m/s^2]."""
    memory: FloatArray
    """(N, any) what a learner's features remember; so are the next five a learner's."""
    inputs: FloatArray
    """(N, features)."""
    demo: FloatArray
    """(N,) steering that the demonstrator proposes now."""
    base: FloatArray
    """(N,) steering of the base controller now, which the actions correct."""
    executed: FloatArray
    """(N,) steering command of this step, before the actuator's faults."""
    reward: FloatArray
    """(N, 4): reward, r_track, c_track, c_diff of this step."""
    judged: FloatArray
    """Scratch: the step of the vehicle in turn as the reward's terms see it."""
    work: FloatArray
    """Scratch of the integration."""
    command: FloatArray
    """Scratch: the command of the vehicle in turn."""
    measured: FloatArray
    """Scratch: the measured state."""
    place: FloatArray
    """Scratch: the tracking row of the measured state."""


def empty_fleet(
    n: int,
    waypoints: int,
    *,
    errors: int = 0,
    shifts: int = 0,
    fine: int = 0,
    memory: int = 0,
    features: int = 0,
) -> Fleet:
    """A fleet of ``n`` vehicles, all zero; the other numbers are the widths of its arrays."""
    return Fleet(
        state=np.zeros((n, car.N_STATE)),
        tracking=np.zeros((n, obs.N_TRACKING)),
        rows=np.zeros((n, obs.O_PREVIEW + 2 * waypoints)),
        delayed=np.zeros((n, DELAY_LINE)),
        delay=np.zeros(n, dtype=np.int64),
        path=np.zeros(n, dtype=np.int64),
        clock=np.zeros((n, 5)),
        ended=np.zeros(n, dtype=np.int64),
        errors=np.zeros((n, errors)),
        shifts=np.zeros((n, shifts, 2)),
        levels=np.ones(n),
        arrives=np.zeros(n, dtype=np.int64),
        bounds=np.tile([-1.0, 1.0], (n, 1)),
        sent=np.zeros(n),
        fine=np.zeros((n, fine, 2)),
        memory=np.zeros((n, memory)),
        inputs=np.zeros((n, features)),
        demo=np.zeros(n),
        base=np.zeros(n),
        executed=np.zeros(n),
        reward=np.zeros((n, 4)),
        judged=np.zeros(rew.N_JUDGED),
        work=np.zeros((3, car.N_MOTION)),
        command=np.zeros(3),
        measured=np.zeros(car.N_STATE),
        place=np.zeros(obs.N_TRACKING),
    )


@kernel
def _hold_back(steer: float, delayed: FloatArray, delay: int, substeps: int) -> tuple[int, int]:
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
    whole, late = _hold_back(command[car.CMD_STEER], delayed, delay, substeps)
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


@kernel
def look(world: World, fleet: Fleet, n: int) -> None:
    """Measure the observation of vehicle ``n``, whose tracking row is up to date."""
    row = fleet.rows[n]
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


@kernel
def decide(world: World, fleet: Fleet, n: int, steer: float) -> float:
    """Fill the command of vehicle ``n`` for a steering; returns where the vehicle will be.

    That is the arc length [m] that it reaches in this step at its present speed.
    """
    state, clock, dt, command = fleet.state[n], fleet.clock[n], world.dt, fleet.command
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
    )
    fleet.sent[n] = min(max(steer, fleet.bounds[n, 0]), fleet.bounds[n, 1])
    command[0], command[1], command[2] = fleet.sent[n], throttle, brake
    return float(s + speed * dt)


@kernel
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
    elif clock[CLOCK_DISTANCE] >= clock[CLOCK_GOAL] - _SAME:
        fleet.ended[n] = GOAL_REACHED
    elif clock[CLOCK_STEPS] * world.dt >= clock[CLOCK_LIMIT] - _SAME:
        fleet.ended[n] = TIME_UP


@kernel
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
    find_end(world, fleet, n)
    look(world, fleet, n)


@kernel
def advance(world: World, fleet: Fleet, n: int, steer: float) -> None:
    """Move vehicle ``n`` by one control period under a steering command in [-1, 1]."""
    near = decide(world, fleet, n, steer)
    drive(
        world.vehicles,
        n,
        fleet.state[n],
        fleet.command,
        fleet.delayed[n],
        fleet.delay[n],
        world.h,
        world.substeps,
        fleet.work,
        fleet.fine[n],
    )
    conclude(world, fleet, n, near)
