"""The reward of one control step: the sum of its terms, wherever it is computed."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from steersman.kernels import observe, vehicle
from steersman.kernels.compiled import kernel
from steersman.kernels.formula import call
from steersman.types import FloatArray

# Values of RewardTable.blend: how the demonstration enters.
NO_DEMONSTRATION, FIXED, ADAPTIVE = 0, 1, 2
# Columns of what is judged; the state is that after the step.
(
    SPEED, LATERAL_ERROR, HEADING_ERROR, COURSE_ERROR, SIDE_SLIP, CURVATURE, V_X, V_Y, YAW_RATE,
    STEER, PREVIOUS_STEER, DEMONSTRATED_STEER, DT, WISHED_SPEED, A_X, GAP, RELATIVE_SPEED,
    WISHED_GAP, JERK,
) = range(19)  # fmt: skip
N_JUDGED = 19
# Columns of what comes out.
TOTAL, R_TRACK, C_TRACK, C_DIFF = range(4)


class RewardTable(NamedTuple):
    """Terms of the reward (addresses of :mod:`steersman.kernels.formula`)."""

    terms: Any
    """(terms, 2) int64: formula and place in ``own``. The first is the tracking reward; with a
    demonstration the second is its reward."""
    own: FloatArray
    """Settings of all terms behind each other."""
    blend: int
    """NO_DEMONSTRATION, FIXED or ADAPTIVE."""
    c_track: float
    """Coefficient of the first term, or its emphasis if ADAPTIVE."""
    c_diff: float
    """Coefficient of the second term, or its emphasis if ADAPTIVE."""


@kernel
def sigmoid(x: float) -> float:
    """1 / (1 + exp(-x)) without overflow."""
    if x >= 0.0:
        return 1.0 / (1.0 + math.exp(-x))
    e = math.exp(x)
    return e / (1.0 + e)


@kernel
def describe(
    state: FloatArray,
    tracking: FloatArray,
    steer: float,
    previous: float,
    demonstrated: float,
    dt: float,
    wished: float,
    out: FloatArray,
) -> None:
    """Write the step (N_JUDGED,) that led to a state and its tracking row, for :func:`judge`.

    ``steer`` is the executed command, ``previous`` the one before, ``demonstrated`` the
    demonstrator's, ``dt`` the control period [s], ``wished`` the speed wished then [m/s].
    """
    v_x, v_y = state[vehicle.VX], state[vehicle.VY]
    out[SPEED], out[SIDE_SLIP] = np.hypot(v_x, v_y), np.arctan2(v_y, v_x)
    out[V_X], out[V_Y], out[YAW_RATE] = v_x, v_y, state[vehicle.YAW_RATE]
    out[LATERAL_ERROR], out[HEADING_ERROR] = tracking[observe.D], tracking[observe.HEADING]
    out[COURSE_ERROR], out[CURVATURE] = tracking[observe.COURSE], tracking[observe.KAPPA]
    out[STEER], out[PREVIOUS_STEER], out[DEMONSTRATED_STEER] = steer, previous, demonstrated
    out[DT], out[WISHED_SPEED], out[A_X] = dt, wished, state[vehicle.AX]
    for k in range(GAP, N_JUDGED):
        out[k] = math.nan


@kernel
def _term(table: RewardTable, step: FloatArray, k: int) -> float:
    return call(table.terms[k, 0], step, step, table.own, table.terms[k, 1], 0, 0)


@kernel
def judge(table: RewardTable, step: FloatArray, out: FloatArray) -> None:
    """Write reward, tracking reward, c_track and c_diff (4,) of a step (N_JUDGED,).

    R = c_track r_track + c_diff (-r_diff) + the other terms. Adaptive coefficients are the
    sigmoids of r_track and r_diff times the emphasis, normalised to the sum one. Where the
    demonstrated steering is NaN there is no second term.
    """
    track, diff, first = _term(table, step, 0), 0.0, 1
    c_track, c_diff = table.c_track, 0.0
    if table.blend != NO_DEMONSTRATION:
        first = 2
        if not math.isnan(step[DEMONSTRATED_STEER]):  # nothing is shown in this step
            diff, c_diff = _term(table, step, 1), table.c_diff
    if table.blend == ADAPTIVE:
        c_track *= sigmoid(track)
        c_diff *= sigmoid(-diff)
        total = c_track + c_diff
        c_track, c_diff = c_track / total, c_diff / total
    reward = c_track * track + c_diff * diff
    for k in range(first, table.terms.shape[0]):
        reward += _term(table, step, k)
    out[TOTAL], out[R_TRACK], out[C_TRACK], out[C_DIFF] = reward, track, c_track, c_diff
