"""A control step of N vehicles with the Jacobian of each one's motion, for the way back.

The motion is that of :func:`world.drive` to the bit; around it the step is that of
:mod:`steersman.kernels.step`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import linearise as lin
from steersman.kernels import vehicle as car
from steersman.kernels import world as loop
from steersman.kernels.compiled import allocating, kernel
from steersman.kernels.dual_number import WIDTH
from steersman.kernels.fleet import Fleet, World
from steersman.kernels.step import command, judge
from steersman.types import FloatArray


class Derived(NamedTuple):
    """The derivatives of the last step, and scratch."""

    jacobian: FloatArray
    """(N, N_MOVED, N_COLUMNS), see :func:`linearise.linearise`."""
    following: FloatArray
    """(N_STATE,) scratch."""
    motion: FloatArray
    """(N_SCRATCH, WIDTH) scratch."""


def make_derived(n: int) -> Derived:
    """All zero, for ``n`` vehicles."""
    return Derived(
        np.zeros((n, lin.N_MOVED, lin.N_COLUMNS)),
        np.zeros(car.N_STATE),
        np.zeros((lin.N_SCRATCH, WIDTH)),
    )


@kernel
def _drive(world: World, fleet: Fleet, n: int, derived: Derived) -> None:
    """Move vehicle ``n`` by one control period under its command."""
    state, given, line = fleet.state[n], fleet.command[n], fleet.delayed[n]
    whole, late = loop.hold_back(given[car.CMD_STEER], line, fleet.delay[n], world.substeps)
    given[car.CMD_STEER] = line[whole]
    lin.linearise(
        world.vehicles,
        n,
        state,
        (given[car.CMD_THROTTLE], given[car.CMD_BRAKE]),
        (line[whole + 1], line[whole]),
        late,
        world.h,
        world.substeps,
        derived.motion,
        derived.following,
        derived.jacobian[n],
    )
    for i in range(car.N_STATE):
        state[i] = derived.following[i]


@allocating
def learn(bound: Any, derived: Derived, actions: FloatArray) -> None:
    """:func:`steersman.kernels.step.step` under actions (N,) in [-1, 1], with derivatives."""
    world, fleet, lesson = bound.world, bound.fleet, bound.lesson
    for n in range(actions.shape[0]):
        steer, previous = command(lesson, fleet, n, actions[n], world.dt)
        near = loop.decide(world, fleet, n, steer)
        _drive(world, fleet, n, derived)
        loop.conclude(world, fleet, n, near)
        judge(lesson, fleet, n, steer, previous)
