"""The best steering on the true plant, known ahead: one sweep back, one drive forth.

Differential dynamic programming with Gauss-Newton second derivatives ("iterative LQR"): Tassa,
Mansard and Todorov, "Control-limited differential dynamic programming", ICRA 2014; the plant's
Jacobian is its own (:mod:`linearise`). Pedals follow the plant's speed controller and are held in
the derivatives. Steering is counted as it acts: whole periods of delay only shift it in time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.kernels import linearise as lin
from steersman.kernels import observe as obs
from steersman.kernels import vehicle as car
from steersman.kernels import world as loop
from steersman.kernels.compiled import kernel
from steersman.kernels.dual_number import WIDTH
from steersman.kernels.fleet import Fleet, World
from steersman.types import FloatArray

# What the optimiser's state holds: the moved columns of a state row, and the last command.
LAST = lin.N_MOVED
N_SEEN = lin.N_MOVED + 1
# Columns of a patch: begin, length, distance to the next (0: there is one), factors left and right.
P_BEGIN, P_LENGTH, P_EVERY, P_LEFT, P_RIGHT = range(5)


class Trail(NamedTuple):
    """A drive of up to H control steps; rows behind its end are not used."""

    state: FloatArray
    """(H + 1, N_STATE)."""
    tracking: FloatArray
    """(H + 1, N_TRACKING)."""
    command: FloatArray
    """(H, 3) steering as it acts from within the step on, throttle, brake."""
    cars: FloatArray
    """(H, N_PARAMS) the car in the step."""


class SteerPlan(NamedTuple):
    """How the next drive steers: old steering, plus a change, plus gains on what differs."""

    change: FloatArray
    """(H,)."""
    gains: FloatArray
    """(H, N_SEEN)."""


class Air(NamedTuple):
    """What acts on the car beside its driver."""

    wind: FloatArray
    """(H or 0,) to the left [m/s]."""
    force: float
    """Side force over flow angle and squared speed [N s^2/m^2]."""
    arm: float
    """Yaw moment over side force [m]."""
    patches: FloatArray
    """(any, 5)."""


def empty_trail(steps: int) -> Trail:
    """Room for so many steps."""
    return Trail(
        np.zeros((steps + 1, car.N_STATE)),
        np.zeros((steps + 1, obs.N_TRACKING)),
        np.zeros((steps, 3)),
        np.zeros((steps, car.N_PARAMS)),
    )


@kernel
def _surround(row: FloatArray, air: Air, k: int, s: float, v_x: float) -> None:
    """Put wind and the road's friction in step ``k`` at arc length ``s`` into a car's row."""
    if air.wind.shape[0] > 0:
        wind = air.wind[k]
        load = (v_x * v_x + wind * wind) * air.force * math.atan2(wind, abs(v_x))
        row[car.SIDE_FORCE], row[car.YAW_MOMENT] = load, load * air.arm
    row[car.GRIP_LEFT] = row[car.GRIP_RIGHT] = 1.0
    for i in range(air.patches.shape[0]):
        patch = air.patches[i]
        since = s - patch[P_BEGIN]
        if patch[P_EVERY] > 0.0 and since >= 0.0:
            since %= patch[P_EVERY]
        if 0.0 <= since < patch[P_LENGTH]:
            row[car.GRIP_LEFT] *= patch[P_LEFT]
            row[car.GRIP_RIGHT] *= patch[P_RIGHT]


@kernel
def _copy(values: FloatArray, to: FloatArray) -> None:
    for i in range(values.shape[0]):
        to[i] = values[i]


@kernel
def drive(
    world: World,
    fleet: Fleet,
    air: Air,
    held: int,
    old: Trail,
    plan: SteerPlan,
    share: float,
    new: Trail,
) -> int:
    """Drive vehicle 0 from where it is to its goal; returns the steps, at most H.

    Args:
        world: constants; the car's row is rewritten.
        fleet: the vehicle at its start, with a delay below one control period; it moves.
        air: wind and friction.
        held: first steps whose steering was commanded before the start: the old one.
        old: the drive that the plan refers to.
        plan: how steering differs from it.
        share: of the plan's change that is made.
        new: the drive.
    """
    row, state, tracking = world.vehicles.rows[0], fleet.state[0], fleet.tracking[0]
    steps: int = new.command.shape[0]
    _copy(state, new.state[0])
    _copy(tracking, new.tracking[0])
    for k in range(steps):
        steer = old.command[k, 0]
        if k >= held:
            steer += share * plan.change[k]
            for i in range(lin.N_MOVED):
                steer += plan.gains[k, i] * (state[i] - old.state[k, i])
            if k > 0:
                steer += plan.gains[k, LAST] * (new.command[k - 1, 0] - old.command[k - 1, 0])
            steer = min(max(steer, -1.0), 1.0)
        _surround(row, air, k, tracking[obs.S], state[car.VX])
        near = loop.decide(world, fleet, 0, steer)
        _copy(row, new.cars[k])
        _copy(fleet.command[0], new.command[k])
        loop.carry_out(world, fleet, 0, near)
        _copy(state, new.state[k + 1])
        _copy(tracking, new.tracking[k + 1])
        if fleet.ended[0] in (loop.GOAL_REACHED, loop.TIME_UP):
            return k + 1
    return steps


class Sweep(NamedTuple):
    """Scratch of the way back."""

    value: FloatArray
    """(N_SEEN, N_SEEN + 1) second derivatives of the cost to go, and its slopes."""
    moved: FloatArray
    """(N_SEEN, N_SEEN + 1) the step's Jacobian, the command last."""
    product: FloatArray
    """(N_SEEN, N_SEEN + 1)."""
    quadratic: FloatArray
    """(N_SEEN + 1, N_SEEN + 2) second derivatives by state and command, and slopes."""
    following: FloatArray
    jacobian: FloatArray
    motion: FloatArray


def make_sweep() -> Sweep:
    """All zero."""
    return Sweep(
        np.zeros((N_SEEN, N_SEEN + 1)),
        np.zeros((N_SEEN, N_SEEN + 1)),
        np.zeros((N_SEEN, N_SEEN + 1)),
        np.zeros((N_SEEN + 1, N_SEEN + 2)),
        np.zeros(car.N_STATE),
        np.zeros((lin.N_MOVED, lin.N_COLUMNS)),
        np.zeros((lin.N_SCRATCH, WIDTH)),
    )


@kernel
def _linear(world: World, trail: Trail, k: int, late: int, work: Sweep) -> None:
    """The Jacobian of step ``k``, of the last command too."""
    older = trail.command[k - 1, 0] if k > 0 else trail.state[0, car.STEER]
    _copy(trail.cars[k], world.vehicles.rows[0])
    lin.linearise(
        world.vehicles,
        0,
        trail.state[k],
        (trail.command[k, car.CMD_THROTTLE], trail.command[k, car.CMD_BRAKE]),
        (older, trail.command[k, 0]),
        late,
        world.h,
        world.substeps,
        work.motion,
        work.following,
        work.jacobian,
    )
    work.moved[:] = 0.0
    for i in range(lin.N_MOVED):
        for j in range(lin.N_MOVED):
            work.moved[i, j] = work.jacobian[i, j]
        work.moved[i, LAST] = work.jacobian[i, lin.OLD_COMMAND]
        work.moved[i, N_SEEN] = work.jacobian[i, lin.NEW_COMMAND]
    work.moved[LAST, N_SEEN] = 1.0


@kernel
def _rate(trail: Trail, k: int, price: float, both: FloatArray) -> None:
    """Add the price of step ``k``'s change of steering to second derivatives and slopes."""
    change = price * (trail.command[k, 0] - trail.command[k - 1, 0])
    both[N_SEEN, N_SEEN] += price
    both[LAST, LAST] += price
    both[LAST, N_SEEN] -= price
    both[N_SEEN, LAST] -= price
    both[N_SEEN, N_SEEN + 1] += change
    both[LAST, N_SEEN + 1] -= change


@kernel
def _error(trail: Trail, k: int, price: float, value: FloatArray) -> None:
    """Add the price of the lateral error before step ``k`` to the cost to go."""
    place = trail.tracking[k]
    psi = trail.state[k, car.PSI] - place[obs.HEADING]
    slope = (-math.sin(psi), math.cos(psi))
    for i in range(2):
        value[i, N_SEEN] += price * place[obs.D] * slope[i]
        for j in range(2):
            value[i, j] += price * slope[i] * slope[j]


@kernel
def _through(value: FloatArray, work: Sweep) -> None:
    """The cost to go as a quadratic of state and command before the step: J' V J, J' slopes."""
    moved, product, both = work.moved, work.product, work.quadratic
    for j in range(N_SEEN + 1):
        for i in range(N_SEEN):
            product[i, j] = 0.0
            for m in range(N_SEEN):
                product[i, j] += value[i, m] * moved[m, j]
        for i in range(N_SEEN + 1):
            both[i, j] = 0.0
            for m in range(N_SEEN):
                both[i, j] += moved[m, i] * product[m, j]
        both[j, N_SEEN + 1] = 0.0
        for m in range(N_SEEN):
            both[j, N_SEEN + 1] += moved[m, j] * value[m, N_SEEN]


@kernel
def sweep(
    world: World,
    trail: Trail,
    span: tuple[int, int],
    late: int,
    prices: tuple[float, float],
    firm: float,
    work: Sweep,
    plan: SteerPlan,
) -> None:
    """Go back through a drive and fill the plan for the next one.

    Args:
        world: constants; the car's row is rewritten.
        trail: the drive.
        span: first step whose steering can be changed, and the drive's length.
        late: integration steps for which the older command of a step acts.
        prices: of the squared lateral error [1/m^2] after each step, and of the squared change of
            steering.
        firm: is added to the second derivative by the command.
        work: scratch.
        plan: is filled.
    """
    value, both, first = work.value, work.quadratic, span[0]
    value[:] = 0.0
    for k in range(span[1] - 1, first - 1, -1):
        _error(trail, k + 1, prices[0], value)
        _linear(world, trail, k, late, work)
        _through(value, work)
        if k > first:
            _rate(trail, k, prices[1], both)
        by, slope = both[N_SEEN, N_SEEN] + firm, both[N_SEEN, N_SEEN + 1]
        plan.change[k] = -slope / by
        for i in range(N_SEEN):
            plan.gains[k, i] = -both[N_SEEN, i] / by
            for j in range(N_SEEN):
                value[i, j] = both[i, j] - both[i, N_SEEN] * both[N_SEEN, j] / by
            value[i, N_SEEN] = both[i, N_SEEN + 1] - both[i, N_SEEN] * slope / by
