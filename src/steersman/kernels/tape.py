"""Control steps that were driven, as the way back needs them, and slopes on that way."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import encode_slopes as features
from steersman.kernels import linearise as lin
from steersman.kernels import observe as obs
from steersman.kernels import reward as rew
from steersman.kernels import vehicle as car
from steersman.kernels.dual_number import WIDTH
from steersman.kernels.encode_slopes import EncodingSlopes
from steersman.kernels.fleet import DELAY_LINE, Fleet
from steersman.kernels.reward import RewardTable
from steersman.types import FloatArray


class Slopes(NamedTuple):
    """Derivatives of what is learned."""

    features: EncodingSlopes
    reward: RewardTable
    """With the addresses of the terms' derivatives."""


class Tape(NamedTuple):
    """H control steps of N vehicles: first before each step, then after it.

    After the last step of a drive it is the place where that drive ended.
    """

    memory: FloatArray
    """(H, N, any) the features' memory."""
    rows: FloatArray
    """(H, N, columns) observations."""
    state: FloatArray
    tracking: FloatArray
    next_memory: FloatArray
    next_rows: FloatArray
    next_state: FloatArray
    next_tracking: FloatArray
    path: Any
    """(H, N) int64 number of the road."""
    jacobian: FloatArray
    """(H, N, N_MOVED, N_COLUMNS) derivatives of the motion, see :func:`linearise.linearise`."""
    delay: Any
    """(H, N) int64 steering delay in substeps."""
    demo: FloatArray
    """(H, N) steering of the demonstrator."""
    executed: FloatArray
    """(H, N) steering command."""
    sent: FloatArray
    """(H, N) what of it the actuator got."""
    arrives: Any
    """(H, N) int64 whether the observation after the step arrived."""
    ended: Any
    """(H, N) int64 whether the drive ended with the step."""
    actions: FloatArray
    """(H, N) in [-1, 1]."""


# Arrays of a fleet that a step finds, and those that it leaves, under the same names.
BEFORE = ("memory", "rows", "state", "tracking", "demo")
AFTER = (
    *("path", "delay", "executed", "sent", "arrives", "ended"),
    *("next_memory", "next_rows", "next_state", "next_tracking"),
)


def make_tape(fleet: Fleet, horizon: int) -> Tape:
    """An empty tape for so many steps of a fleet."""
    n = len(fleet.state)
    made = {
        "jacobian": np.zeros((horizon, n, lin.N_MOVED, lin.N_COLUMNS)),
        "actions": np.zeros((horizon, n)),
    }
    for name in (*BEFORE, *AFTER):
        like = getattr(fleet, name.removeprefix("next_"))
        made[name] = np.zeros((horizon, *like.shape), like.dtype)
    return Tape(**made)


class Adjoint(NamedTuple):
    """Slopes of the loss at what the steps hand on, and scratch."""

    state: FloatArray
    """(N, N_MOVED)."""
    delayed: FloatArray
    """(N, DELAY_LINE)."""
    places: FloatArray
    """(N, memory + columns): memory, and scratch for an observation."""
    rows: FloatArray
    """(H, N, columns): observations by the step after which they were measured."""
    action: FloatArray
    """(N,) of the step in turn: what comes out."""
    encoding: FloatArray
    """Scratch, see :func:`encode_slopes.scratch`."""
    judged: FloatArray
    """Scratch of the reward: dual numbers."""
    place: FloatArray
    """Scratch: slopes at the tracking row in turn."""
    memory: FloatArray
    """Scratch: the memory between the two halves of a step."""
    after: FloatArray
    """Scratch: slopes at a state after its step."""


# Rows of the reward's scratch behind state and tracking: the two commands, the step, the reward.
COMMANDS = car.N_STATE + obs.N_TRACKING
JUDGED = COMMANDS + 2
REWARD = JUDGED + rew.N_JUDGED


def make_adjoint(tape: Tape, slopes: Slopes) -> Adjoint:
    """All zero, for a tape."""
    horizon, n, columns = tape.rows.shape
    memory = tape.memory.shape[2]
    return Adjoint(
        state=np.zeros((n, lin.N_MOVED)),
        delayed=np.zeros((n, DELAY_LINE)),
        places=np.zeros((n, memory + columns)),
        rows=np.zeros((horizon, n, columns)),
        action=np.zeros(n),
        encoding=features.scratch(slopes.features, columns),
        judged=np.zeros((REWARD + 4, WIDTH)),
        place=np.zeros(obs.N_TRACKING),
        memory=np.zeros(memory),
        after=np.zeros(lin.N_MOVED),
    )
