"""One control step of N vehicles on their paths: the one kernel under rollout and environments."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import encode as enc
from steersman.kernels import observe as obs
from steersman.kernels import reward as rew
from steersman.kernels import vehicle as car
from steersman.kernels.compiled import kernel
from steersman.kernels.encode import EncodingTable
from steersman.kernels.path import CLOSED, LENGTH, PathTable
from steersman.kernels.reward import RewardTable
from steersman.kernels.speed import SpeedTable, pedals
from steersman.kernels.vehicle import VehicleTable
from steersman.types import FloatArray

# Reasons to end an episode.
RUNNING, LEFT_CORRIDOR, ROLLED, ROAD_ENDED, TIME_UP = range(5)
# Commands that the delay line can hold.
DELAY_LINE = 16


class World(NamedTuple):
    """What does not change during a step."""

    vehicles: VehicleTable
    paths: PathTable
    speed: SpeedTable
    encoding: EncodingTable
    scale: FloatArray
    reward: RewardTable
    weights: FloatArray
    h: float
    substeps: int
    dt: float
    corridor: float
    rate_limit: float
    """Largest steering rate of the indirect action [1/s]; 0: the action is the steering."""
    authority: float = 0.0
    """Largest correction of the base's command [-]; 0: there is no base."""


class Fleet(NamedTuple):
    """What changes: a row for each vehicle."""

    state: FloatArray
    tracking: FloatArray
    rows: FloatArray
    memory: FloatArray
    inputs: FloatArray
    delayed: FloatArray
    """(N, DELAY_LINE) the last steering commands, newest first."""
    delay: Any
    """(N,) int64 steering delay in substeps."""
    path: Any
    """(N,) int64 number of the path."""
    clock: FloatArray
    """(N, 3): control steps driven, speed controller's integral, time limit [s]."""
    demo: FloatArray
    """(N,) steering that the demonstrator proposes now."""
    base: FloatArray
    """(N,) steering of the base controller now, which the actions correct."""
    executed: FloatArray
    """(N,) steering command of this step."""
    reward: FloatArray
    """(N, 4): reward, r_track, c_track, c_diff of this step."""
    ended: Any
    """(N,) int64 reason the episode ended with this step, or RUNNING."""
    work: FloatArray
    """Scratch of the integration."""
    command: FloatArray
    """Scratch: the command of the vehicle in turn."""
    judged: FloatArray
    """Scratch: the step of the vehicle in turn as the reward's terms see it."""


CLOCK_STEPS, CLOCK_INTEGRAL, CLOCK_LIMIT = range(3)


def empty_fleet(n: int, encoding: EncodingTable, waypoints: int) -> Fleet:
    """A fleet of ``n`` vehicles, all zero."""
    features = enc.feature_count(encoding)
    return Fleet(
        state=np.zeros((n, car.N_STATE)),
        tracking=np.zeros((n, obs.N_TRACKING)),
        rows=np.zeros((n, obs.O_PREVIEW + 2 * waypoints)),
        memory=np.zeros((n, enc.memory_size(encoding))),
        inputs=np.zeros((n, features)),
        delayed=np.zeros((n, DELAY_LINE)),
        delay=np.zeros(n, dtype=np.int64),
        path=np.zeros(n, dtype=np.int64),
        clock=np.zeros((n, 3)),
        demo=np.zeros(n),
        base=np.zeros(n),
        executed=np.zeros(n),
        reward=np.zeros((n, 4)),
        ended=np.zeros(n, dtype=np.int64),
        work=np.zeros((3, car.N_MOTION)),
        command=np.zeros(3),
        judged=np.zeros(rew.N_JUDGED),
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
) -> None:
    """Advance one vehicle by one control period; steering takes effect ``delay`` substeps late."""
    whole, late = _hold_back(command[car.CMD_STEER], delayed, delay, substeps)
    if late > 0:
        command[car.CMD_STEER] = delayed[whole + 1]
        car.advance(vehicles, n, state, command, h, late, work)
    command[car.CMD_STEER] = delayed[whole]
    car.advance(vehicles, n, state, command, h, substeps - late, work)


@kernel
def drive_recorded(  # noqa: PLR0917 - numba takes no keyword-only arguments
    vehicles: VehicleTable,
    n: int,
    state: FloatArray,
    command: FloatArray,
    delayed: FloatArray,
    delay: int,
    h: float,
    substeps: int,
    work: FloatArray,
    out: FloatArray,
) -> None:
    """As :func:`drive`, to the bit, keeping a_x and a_y of every substep: ``out`` (substeps, 2)."""
    whole, late = _hold_back(command[car.CMD_STEER], delayed, delay, substeps)
    for i in range(substeps):
        command[car.CMD_STEER] = delayed[whole + 1] if i < late else delayed[whole]
        car.advance(vehicles, n, state, command, h, 1, work)
        out[i, 0], out[i, 1] = state[car.AX], state[car.AY]


@kernel
def look(world: World, fleet: Fleet, n: int, shift: FloatArray) -> None:
    """Sense and encode for vehicle ``n``, whose tracking row is up to date."""
    enc_table = world.encoding
    row = fleet.rows[n]
    count = (row.shape[0] - obs.O_PREVIEW) // 2
    obs.sense(
        world.paths,
        fleet.path[n],
        fleet.state[n],
        fleet.tracking[n],
        enc_table.spacing,
        count,
        shift,
        world.weights,
        row,
    )
    enc.encode(enc_table, row, fleet.memory[n], fleet.inputs[n])
    enc.normalise(fleet.inputs[n], world.scale)


@kernel
def decide(world: World, fleet: Fleet, n: int, action: float, command: FloatArray) -> float:
    """Fill the command of vehicle ``n`` for an action in [-1, 1]; returns its steering.

    The delay line of :func:`drive` changes the steering in ``command``, so it is told apart.
    """
    state, clock, dt = fleet.state[n], fleet.clock[n], world.dt
    steer = action
    if world.rate_limit > 0.0:
        steer = fleet.memory[n, enc.LAST_COMMAND] + action * world.rate_limit * dt
    elif world.authority > 0.0:
        steer = fleet.base[n] + world.authority * action
    steer = min(max(steer, -1.0), 1.0)
    throttle, brake, clock[CLOCK_INTEGRAL] = pedals(
        world.speed,
        n,
        world.paths,
        fleet.path[n],
        clock[CLOCK_STEPS] * dt,
        fleet.tracking[n, obs.S],
        np.hypot(state[car.VX], state[car.VY]),
        clock[CLOCK_INTEGRAL],
        dt,
    )
    command[0], command[1], command[2] = steer, throttle, brake
    return steer


@kernel
def conclude(
    world: World, fleet: Fleet, n: int, steer: float, near: float, shift: FloatArray
) -> None:
    """Track, remember, judge and look, once vehicle ``n`` has moved under ``steer``.

    ``near`` is the arc length [m] where it is looked for on its path.
    """
    memory = fleet.memory[n]
    previous = memory[enc.LAST_COMMAND]
    obs.track(world.paths, fleet.path[n], fleet.state[n], near, fleet.tracking[n])
    fleet.clock[n, CLOCK_STEPS] += 1.0
    enc.remember(world.encoding, fleet.rows[n], memory, steer)
    fleet.executed[n] = steer
    _judge(world, fleet, n, steer, previous)
    look(world, fleet, n, shift)


@kernel
def expected_place(world: World, fleet: Fleet, n: int) -> float:
    """Arc length [m] that vehicle ``n`` reaches in this step at its present speed."""
    state = fleet.state[n]
    return float(fleet.tracking[n, obs.S] + np.hypot(state[car.VX], state[car.VY]) * world.dt)


@kernel
def step(world: World, fleet: Fleet, actions: FloatArray, shifts: FloatArray) -> None:
    """Move every vehicle by one control period under ``actions`` (N,) in [-1, 1].

    ``shifts`` (N, waypoints or 0, 2) are this step's waypoint errors. ``fleet.demo`` and
    ``fleet.base`` must hold the demonstrator's and the base's steering for the state before the
    step.
    """
    for n in range(actions.shape[0]):
        steer = decide(world, fleet, n, actions[n], fleet.command)
        near = expected_place(world, fleet, n)
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
        )
        conclude(world, fleet, n, steer, near, shifts[n])


@kernel
def _judge(world: World, fleet: Fleet, n: int, steer: float, previous: float) -> None:
    """Fill reward and end of vehicle ``n`` after its step."""
    state, tracking, clock = fleet.state[n], fleet.tracking[n], fleet.clock[n]
    rew.describe(state, tracking, steer, previous, fleet.demo[n], world.dt, fleet.judged)
    rew.judge(world.reward, fleet.judged, fleet.reward[n])
    meta = world.paths.meta[fleet.path[n]]
    # Not "greater than": a NaN error must end the episode too.
    inside = abs(tracking[obs.D]) <= world.corridor
    fleet.ended[n] = RUNNING
    if not inside:
        fleet.ended[n] = LEFT_CORRIDOR
    elif car.rolls_over(world.vehicles.rows[n], state[car.LOAD_AY]):
        fleet.ended[n] = ROLLED
    elif meta[CLOSED] == 0.0 and tracking[obs.S] >= meta[LENGTH]:
        fleet.ended[n] = ROAD_ENDED
    elif clock[CLOCK_STEPS] * world.dt >= clock[CLOCK_LIMIT] - 1e-9:
        fleet.ended[n] = TIME_UP
