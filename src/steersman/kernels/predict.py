"""One step of the predictor for one vehicle: what will be observed when the next command acts.

The model is that of ``mpc_delay``, with linear tyres; the accelerations that it lacks are held
over the delay (Pannocchia and Rawlings, AIChE Journal 49, 2003, call it a disturbance model).
Steering by the predicted state makes a controller without delay one with it: Smith, Closer
control of loops with dead time, Chemical Engineering Progress 53, 1957; in state space Manitius
and Olbrot, IEEE Trans. Automatic Control 24, 1979. docs/equations/estimated.md has the equations.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.kernels import mpc_delay as model
from steersman.kernels import observe
from steersman.kernels.compiled import kernel
from steersman.kernels.grip import NO_LIMIT
from steersman.kernels.preview import curvature_at, point_at
from steersman.kernels.vehicle import VehicleTable
from steersman.types import FloatArray

# Columns of what is kept: whether there was an observation, its v_x, v_y, yaw rate and steering,
# the acceleration, the side and yaw acceleration that the model lacks, the delay, and how long the
# present observation is there already.
BEGUN, V_X, V_Y, RATE, STEER, SURGE, LACK, TURNING, DELAY, AGE = range(10)
N_MEMORY = 10
# Delays that the estimate tries: 0, 10, ... 500 ms [s].
RESOLUTION = 0.01
N_DELAYS = 51
# Time over which the errors of the tried delays fade [s].
_MEMORY = 2.0
# Another delay has to explain the steering this much better than the present one.
_BETTER = 0.5
# Time constant of the acceleration's estimate [s].
_SURGE_TIME = 0.15
# Bound of the estimates, beyond what a car can do [m/s^2], [rad/s^2].
_MOST = 10.0
# The model has no meaning for a car that is slower [m/s].
SLOWEST = 1.0
# Half a step along the road for its direction [m].
_HALF = 0.05


class Predictions(NamedTuple):
    """What is kept for one vehicle."""

    memory: FloatArray
    """(N_MEMORY,)"""
    commands: FloatArray
    """Normalised steering commands, newest first."""
    scores: FloatArray
    """(N_DELAYS,) squared errors of the steering that each tried delay predicts, fading."""


@kernel
def seen_from(
    preview: FloatArray, spacing: float, beside: float, motion: FloatArray, v_x: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Fill the observation row of a car that moved by ``motion`` along the waypoints."""
    way, d, heading = motion[model.WAY], motion[model.E1], motion[model.E2]
    heading = observe.wrap_angle(heading)
    x, y = point_at(preview, spacing, way)
    x_0, y_0 = point_at(preview, spacing, way - _HALF)
    x_1, y_1 = point_at(preview, spacing, way + _HALF)
    tangent = math.atan2(y_1 - y_0, x_1 - x_0)
    x, y = x - d * math.sin(tangent), y + d * math.cos(tangent)
    c, s = math.cos(tangent + heading), math.sin(tangent + heading)
    out[observe.O_D], out[observe.O_HEADING], out[observe.O_VX] = d, heading, v_x
    out[observe.O_VY], out[observe.O_RATE] = motion[model.VY], motion[model.RATE]
    out[observe.O_STEER] = motion[model.STEER]
    out[observe.O_KAPPA] = curvature_at(preview, spacing, beside, way)
    for i in range(preview.shape[0]):
        p_x, p_y = point_at(preview, spacing, way + i * spacing)
        p_x, p_y = p_x - x, p_y - y
        out[observe.O_PREVIEW + 2 * i] = c * p_x + s * p_y
        out[observe.O_PREVIEW + 2 * i + 1] = c * p_y - s * p_x


@kernel
def _bounded(value: float) -> float:
    return min(max(value, -_MOST), _MOST)


@kernel
def _learn(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: VehicleTable, spacing: float, dt: float, finds: bool, time: float, row: FloatArray,
    preview: FloatArray, kept: Predictions, motion: FloatArray, work: FloatArray,
) -> None:  # fmt: skip
    """Bring delay, acceleration and what the model lacks up to date by a new observation."""
    memory, commands, scores = kept
    if finds:
        keep = max(1.0 - dt / _MEMORY, 0.0)
        best = model.score_delays(
            table.rows[0], commands, dt, RESOLUTION, memory[STEER], row[observe.O_STEER], keep,
            scores,
        )  # fmt: skip
        present = min(int(memory[DELAY] / RESOLUTION + 0.5), N_DELAYS - 1)
        if scores[best] < _BETTER * scores[present]:
            memory[DELAY] = best * RESOLUTION
    surge = (row[observe.O_VX] - memory[V_X]) / dt - memory[SURGE]
    memory[SURGE] = _bounded(memory[SURGE] + dt / (_SURGE_TIME + dt) * surge)
    v = 0.5 * (memory[V_X] + row[observe.O_VX])
    if time <= 0.0 or v < SLOWEST:
        memory[LACK] = memory[TURNING] = 0.0
        return
    motion[model.E1] = motion[model.E2] = motion[model.WAY] = 0.0
    motion[model.VY], motion[model.RATE] = memory[V_Y], memory[RATE]
    motion[model.STEER] = memory[STEER]
    lacks = memory[LACK : TURNING + 1]
    model.over_last_period(
        table, v, preview, spacing, lacks, NO_LIMIT, commands, memory[DELAY], dt, motion, work
    )
    lacks[0] = _bounded(lacks[0] + (row[observe.O_VY] - motion[model.VY]) / (time + dt))
    lacks[1] = _bounded(lacks[1] + (row[observe.O_RATE] - motion[model.RATE]) / (time + dt))


@kernel
def step(  # noqa: PLR0917 - numba takes no keyword-only arguments
    table: VehicleTable,
    spacing: float,
    dt: float,
    finds: bool,
    time: float,
    fresh: bool,
    row: FloatArray,
    preview: FloatArray,
    kept: Predictions,
    motion: FloatArray,
    work: FloatArray,
    out: FloatArray,
) -> bool:
    """Take an observation in and write the one that is predicted.

    Returns whether all numbers are finite; if not, what is kept is to be made anew.

    Args:
        table: the nominal vehicle.
        spacing: distance between waypoints [m].
        dt: control period [s].
        finds: whether the delay is found from the measured steering.
        time: time constant of what the model lacks [s]; 0: nothing.
        fresh: whether the observation was measured since the last step.
        row: numbers of an observation row before the waypoints (O_PREVIEW,).
        preview: its waypoints (count, 2).
        kept: in place; ``commands`` without the one that is to come.
        motion: scratch (model.N_MOTION,).
        work: scratch (2, model.N_MOTION).
        out: observation row that is written.
    """
    memory, commands = kept.memory, kept.commands
    if memory[BEGUN] == 0.0:
        for i in range(commands.shape[0]):
            commands[i] = row[observe.O_STEER]
        memory[BEGUN] = 1.0
    elif not fresh:
        # No longer than there are commands: what comes after a longer gap is not predicted.
        memory[AGE] = min(memory[AGE] + dt, (commands.shape[0] - 1) * dt - memory[DELAY])
    elif memory[AGE] == 0.0:
        _learn(table, spacing, dt, finds, time, row, preview, kept, motion, work)
    if fresh:
        memory[AGE] = 0.0
        memory[V_X], memory[V_Y] = row[observe.O_VX], row[observe.O_VY]
        memory[RATE], memory[STEER] = row[observe.O_RATE], row[observe.O_STEER]
    delay = memory[DELAY] + memory[AGE]
    motion[model.E1], motion[model.E2] = row[observe.O_D], row[observe.O_HEADING]
    motion[model.VY], motion[model.RATE] = row[observe.O_VY], row[observe.O_RATE]
    motion[model.STEER], motion[model.WAY] = row[observe.O_STEER], 0.0
    v = row[observe.O_VX]
    if delay > 0.0 and v > SLOWEST:
        middle = max(v + 0.5 * memory[SURGE] * delay, SLOWEST)
        v = max(v + memory[SURGE] * delay, 0.0)
        model.through_delay(
            table, middle, preview, spacing, row[observe.O_KAPPA], memory[LACK : TURNING + 1],
            NO_LIMIT, commands, delay, dt, motion, work,
        )  # fmt: skip
        seen_from(preview, spacing, row[observe.O_KAPPA], motion, v, out)
    else:
        for i in range(observe.O_PREVIEW):
            out[i] = row[i]
        for i in range(preview.shape[0]):
            out[observe.O_PREVIEW + 2 * i] = preview[i, 0]
            out[observe.O_PREVIEW + 2 * i + 1] = preview[i, 1]
    for i in range(commands.shape[0] - 1, 0, -1):
        commands[i] = commands[i - 1]
    return math.isfinite(observe.total(out) + observe.total(memory))
