"""The way back through driven control steps: from slopes of the rewards to slopes at the actions.

What the steps began with, and the Jacobians of their motion (:mod:`linearised_step`), are kept on a
:class:`Tape`. Reward and features are derived from their declarations, place and waypoints by the
geometry of the road. What has no slope here:

- pedals, sensor errors, friction and wind are data; errors of pose and waypoints act as if they
  were added to what an exact sensor gives;
- an observation that does not arrive, and the end of a drive, pass none;
- a command beyond its limits only lets a slope pass that leads back.

Source: reverse accumulation, Griewank and Walther, Evaluating Derivatives, 2nd ed., 2008, ch. 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from steersman.kernels import adjoint_parts as parts
from steersman.kernels import encode as enc
from steersman.kernels import encode_slopes as features
from steersman.kernels import linearise as lin
from steersman.kernels import observe as obs
from steersman.kernels import world as loop
from steersman.kernels.compiled import inlined, kernel
from steersman.kernels.fleet import DELAY_LINE, World
from steersman.kernels.step import Lesson
from steersman.kernels.tape import Adjoint, Slopes, Tape
from steersman.types import FloatArray


@kernel
def cut(tape: Tape, t: int, adjoint: Adjoint) -> None:
    """Before going back through step ``t``: nothing comes from behind the end of a drive."""
    for n in range(adjoint.action.shape[0]):
        if tape.ended[t, n] != loop.RUNNING:
            adjoint.state[n] = 0.0
            adjoint.delayed[n] = 0.0
            adjoint.places[n] = 0.0


@kernel
def _deliver(tape: Tape, t: int, until: int, late: int, n: int, adjoint: Adjoint) -> None:
    """Hand slopes at the observation after step ``t`` to the step after which it was measured.

    If a drive ended from then on, but before step ``until``, or if that was before the tape, the
    observation is a first one, and data.
    """
    places, size = adjoint.places[n], tape.memory.shape[2]
    source = t - late
    for k in range(max(source, 0), until):
        if tape.ended[k, n] != loop.RUNNING:
            source = -1
    for j in range(tape.rows.shape[2]):
        if source >= 0:
            adjoint.rows[source, n, j] += places[size + j]
        places[size + j] = 0.0


@kernel
def pull_inputs(
    lesson: Lesson,
    slopes: Slopes,
    tape: Tape,
    when: tuple[int, int, bool],
    inputs: Any,
    weights: FloatArray,
    adjoint: Adjoint,
) -> None:
    """From slopes at the network's inputs, before or after a step, to what they came from.

    Args:
        lesson: what is learned.
        slopes: its derivatives.
        tape: the steps.
        when: the step, the age of the observations in control periods, and whether the inputs
            are those after the step.
        inputs: (N, features).
        weights: (N, features) slopes at them; changed.
        adjoint: is added to.
    """
    t, late, after = when
    for n in range(weights.shape[0]):
        memory, row = tape.memory[t, n], tape.rows[t, n]
        if after:
            memory, row = tape.next_memory[t, n], tape.next_rows[t, n]
        if np.isnan(row[obs.O_D]):
            continue
        features.put(memory, row, adjoint.encoding)
        for j in range(lesson.scale.shape[0]):
            inside = abs(inputs[n, j]) < enc.FEATURE_LIMIT
            weights[n, j] *= lesson.scale[j] if inside else 0.0
        features.pull_features(slopes.features, weights[n], adjoint.encoding, adjoint.places[n])
        _deliver(tape, t if after else t - 1, t, late, n, adjoint)


@inlined
def _move(world: World, tape: Tape, t: int, n: int, adjoint: Adjoint) -> None:
    """From slopes at the state after step ``t`` to those at the state before, and commands."""
    whole = tape.delay[t, n] // world.substeps
    state, delayed, jacobian = adjoint.state[n], adjoint.delayed[n], tape.jacobian[t, n]
    after = adjoint.after
    for i in range(lin.N_MOVED):
        after[i], state[i] = state[i], 0.0
    for i in range(lin.N_MOVED):
        if after[i] != 0.0:
            for k in range(lin.N_MOVED):
                state[k] += after[i] * jacobian[i, k]
            delayed[whole + 1] += after[i] * jacobian[i, lin.OLD_COMMAND]
            delayed[whole] += after[i] * jacobian[i, lin.NEW_COMMAND]


@kernel
def _send(lesson: Lesson, tape: Tape, t: int, n: int, dt: float, by: float, last: float) -> float:
    """The slope at the unlimited command, from that at the command (``by``)."""
    raw = tape.actions[t, n]
    if lesson.rate_limit > 0.0:
        raw = last + raw * lesson.rate_limit * dt
    beyond = (raw > 1.0 and by < 0.0) or (raw < -1.0 and by > 0.0)
    return 0.0 if beyond else by


@kernel
def pull_step(
    world: World,
    lesson: Lesson,
    slopes: Slopes,
    tape: Tape,
    t: int,
    late: int,
    weights: FloatArray,
    adjoint: Adjoint,
) -> None:
    """Go back through step ``t``; ``weights`` (N,) are the loss's slopes at its rewards.

    Slopes at what the step left become slopes at what it began with, and ``adjoint.action``.
    """
    work, between = adjoint.encoding, adjoint.memory
    for n in range(weights.shape[0]):
        places, memory, row = adjoint.places[n], tape.memory[t, n], tape.rows[t, n]
        steer = tape.executed[t, n]
        by_steer, by_last = parts.reward(slopes, tape, t, n, world.dt, weights[n], adjoint)
        for k in range(between.shape[0]):
            between[k] = memory[k]
        seen, sees = not np.isnan(row[obs.O_D]), not np.isnan(tape.next_rows[t, n, obs.O_D])
        between[enc.LAST_COMMAND] = steer
        if seen:
            between[enc.LAST_COMMAND] = memory[enc.LAST_COMMAND]
            enc.remember(lesson.encoding, row, between, steer)
        if sees:
            features.put(tape.next_memory[t, n], tape.next_rows[t, n], work)
            features.pull_update(slopes.features, features.ADVANCE, between, work, places)
            _deliver(tape, t, t, late, n, adjoint)
        parts.sense(world, tape, t, n, adjoint)
        parts.track(world, tape, t, n, adjoint)
        _move(world, tape, t, n, adjoint)
        delayed = adjoint.delayed[n]
        if tape.sent[t, n] == steer:
            by_steer += delayed[0]
        for k in range(DELAY_LINE - 1):
            delayed[k] = delayed[k + 1]
        delayed[DELAY_LINE - 1] = 0.0
        by_steer += places[enc.LAST_COMMAND]
        places[enc.LAST_COMMAND] = by_last
        if seen:
            features.put(between, row, work)
            work[enc.LAST_COMMAND, 0] = memory[enc.LAST_COMMAND]
            features.pull_update(slopes.features, features.REMEMBER, memory, work, places)
            _deliver(tape, t - 1, t, late, n, adjoint)
        by_steer = _send(lesson, tape, t, n, world.dt, by_steer, memory[enc.LAST_COMMAND])
        adjoint.action[n] = by_steer
        if lesson.rate_limit > 0.0:
            places[enc.LAST_COMMAND] += by_steer
            adjoint.action[n] *= lesson.rate_limit * world.dt
