"""A plan of steering and speed with tyres up to their grip, improved by real-time iterations.

Sources: ``nmpc_plan``; grip along and across: ``kernels.grip``, ``kernels.bend_speed``.
docs/equations/joint_nmpc.md has the equations.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from steersman.controllers.delay_mpc import DelayMpcState
from steersman.controllers.grip_use import bends_in_view
from steersman.controllers.mpc_delay_plan import Weights
from steersman.controllers.nmpc_plan import Ahead, Limits, Nlp, Step, problem
from steersman.controllers.quadratic import optimum
from steersman.kernels import joint_nmpc as kernel
from steersman.kernels import joint_speeds, nmpc
from steersman.kernels import mpc_delay as delay_kernel
from steersman.kernels.bend_speed import pedal_shares
from steersman.types import FloatArray, Observation

# Lower bound of what has none.
_NO_BOUND = -1e3


class SpeedTask(NamedTuple):
    """What a plan of the speed is to do."""

    start: float
    """Speed at which it begins [m/s]."""
    faster: float
    """Speed that is wished, beyond the wished one that is observed [m/s]."""
    grip: float
    """Friction times gravity that the speed is to reckon with [m/s^2]."""
    used: float
    """Share of it for bends."""
    braking: float
    """Share of it for braking before them, and for speeding up."""
    prices: tuple[float, float]
    """Of the squared difference from the wished speed, and of the squared acceleration."""


class JointNlp(NamedTuple):
    """The optimal control problem of one decision."""

    nlp: Nlp
    friction: float
    """Of the tyres [-]."""
    start: float
    """Speed at the start [m/s]."""
    wished: FloatArray
    """(N,) speed wished after each period [m/s]."""
    prices: FloatArray
    """(2,) as in ``SpeedTask``."""
    low: FloatArray
    """(2 N,) least inputs, of which the accelerations are filled [m/s^2]."""
    high: FloatArray
    """(2 N,) largest ones."""
    caps: FloatArray
    """(N,) largest speed after each period [m/s]."""


def joint_problem(
    state: DelayMpcState,
    weights: Weights,
    ahead: Ahead,
    o: Observation,
    drive: SpeedTask,
    plan: FloatArray,
    last: float,
) -> tuple[JointNlp, Limits]:
    """The optimal control problem of a predicted motion, at the speeds of a plan (2 N,).

    ``state`` is the controller's, ``last`` the wheel angle commanded one period ago [rad]; the
    other arguments are those of ``nmpc_plan.problem``.
    """
    known, tables = state.motion, state.tables
    n, dt = tables.horizon, known.dt
    speeds = np.empty(n + 1)
    joint_speeds.speeds_of(plan, drive.start, dt, speeds)
    nlp, limits = problem(
        known, tables, weights, ahead, o, last=last, kappa=state.kappa, speeds=speeds
    )
    low, high, caps = np.empty(2 * n), np.empty(2 * n), np.empty(n)
    start = float(ahead.motion[delay_kernel.WAY])
    joint_speeds.bound_speeds(
        nlp.road, bends_in_view(o), o.spacing, start, speeds, dt, drive.grip, drive.used,
        drive.braking, pedal_shares(known.vehicle.table.rows[0]), low, high, caps,
    )  # fmt: skip
    wished = np.full(n, drive.start)
    if len(o.wished) and np.isfinite(o.wished).all():
        joint_speeds.wished_speeds(o.wished, o.spacing, start, speeds, dt, drive.faster, wished)
    joint = JointNlp(
        nlp, known.friction, drive.start, wished, np.array(drive.prices), low, high, caps
    )
    return joint, limits


def linearised(p: JointNlp, plan: FloatArray) -> Step:
    """The Gauss-Newton QP around a plan (2 N,), which is moved to where the limits are kept."""
    size, nlp = len(plan), p.nlp
    plan, low, high, linear = plan.copy(), p.low.copy(), p.high.copy(), np.empty(size)
    hessian, work = np.empty((size, size)), np.empty((kernel.N_WORK, max(size, nmpc.N_TERMS)))
    cost = kernel.condense(
        nlp.row, nlp.road, nlp.headings, nlp.steady, nlp.lacks, nlp.weight, nlp.price,
        nlp.terminal, nlp.start, nlp.before, nlp.most, nlp.dt, p.friction, p.start, p.wished,
        p.prices, plan, low, high, hessian, linear, work,
    )  # fmt: skip
    return Step(plan, low, high, hessian, linear, cost)


def improved(p: JointNlp, limits: Limits, plan: FloatArray) -> FloatArray | None:
    """The plan (2 N,) after a full Gauss-Newton step within the limits; None if there is none."""
    s, n, (last, step) = linearised(p, plan), len(plan) // 2, limits
    speeds = np.empty(n + 1)
    joint_speeds.speeds_of(s.plan, p.start, p.nlp.dt, speeds)
    # The bounds may be out of reach from the last angle; a plan at the full rate meets them later.
    ramp = step * np.arange(1, n + 1)
    s.low[::2] = np.minimum(s.low[::2], last + ramp)
    s.high[::2] = np.maximum(s.high[::2], last - ramp)
    moved = np.diff(s.plan[::2], prepend=last)
    upper = np.concatenate([s.high - s.plan, step - moved, p.caps - speeds[1:]])
    lower = np.concatenate([s.low - s.plan, -step - moved, np.full(n, _NO_BOUND)])
    solved = optimum(s.hessian, s.linear, _rows(n, p.nlp.dt), lower, upper)
    return None if solved is None else s.plan + solved


@lru_cache(maxsize=16)
def _rows(n: int, dt: float) -> FloatArray:
    """Changes of the angles and of the speeds (2 N, 2 N) by a plan's pairs; only read."""
    rows = np.zeros((2 * n, 2 * n))
    rows[:n, ::2] = np.eye(n) - np.eye(n, k=-1)
    rows[n:, 1::2] = dt * np.tri(n)
    return rows
