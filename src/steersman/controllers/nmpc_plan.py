"""A plan with tyres up to their grip: the optimal control problem and a real-time iteration.

Diehl, Bock, Schloeder, Findeisen, Nagy and Allgoewer, Real-time optimization and nonlinear model
predictive control of processes governed by differential-algebraic equations, Journal of Process
Control 12, 2002. Front force as the input: Beal and Gerdes, Model predictive control for vehicle
stabilization at the limits of handling, IEEE Trans. Control Systems Technology 21, 2013.
docs/equations/nmpc.md has the equations.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from steersman.controllers.motion_estimate import MotionEstimate
from steersman.controllers.mpc_delay_plan import Tables, Weights, largest_step
from steersman.controllers.quadratic import optimum
from steersman.kernels import mpc_delay as delay_kernel
from steersman.kernels import nmpc as kernel
from steersman.kernels.nmpc_model import N_STATES, SLOWEST, steady_turn
from steersman.types import FloatArray, Observation

# Time over which an acceleration that is measured goes on [s].
_SURGE = 0.5


class Nlp(NamedTuple):
    """The optimal control problem of one decision. Wheel angles are those of linear front tyres."""

    row: FloatArray
    """The car's parameters."""
    speeds: FloatArray
    """(N + 1,) [m/s]."""
    road: FloatArray
    """(N + 1,) curvature [1/m]."""
    headings: FloatArray
    """(N + 1,) heading error of the steady turn [rad]."""
    steady: FloatArray
    """(N,) its wheel angle [rad]."""
    lacks: FloatArray
    """(2,) side [m/s^2] and yaw acceleration [rad/s^2] that the model lacks."""
    grips: FloatArray
    """(2,) largest side forces of both axles [N]."""
    weight: FloatArray
    """(5, 5) of the errors and of the wheel angle's deviation at each step."""
    price: float
    """Weight of the squared change of that deviation over a period."""
    terminal: FloatArray
    """(5, 5) cost from the end on."""
    start: FloatArray
    """(4,) lateral and heading error, side velocity and yaw rate."""
    before: float
    """Deviation from the steady turn's wheel angle one period earlier [rad]."""
    most: float
    """Largest wheel angle [rad]."""
    dt: float
    """Control period [s]."""


class Limits(NamedTuple):
    """Of the wheel angle's changes."""

    last: float
    """Wheel angle commanded one period ago [rad]."""
    step: float
    """Largest change over a period [rad]."""


class Step(NamedTuple):
    """A plan (N,), its bounds and the QP around it."""

    plan: FloatArray
    low: FloatArray
    high: FloatArray
    hessian: FloatArray
    linear: FloatArray
    cost: float


class Ahead(NamedTuple):
    """The car when the next command will act."""

    motion: FloatArray
    """As the kernels have it."""
    v: float
    """Speed [m/s]."""


def problem(
    known: MotionEstimate,
    tables: Tables,
    weights: Weights,
    ahead: Ahead,
    observation: Observation,
    *,
    last: float,
    kappa: float,
    speeds: FloatArray | None = None,
) -> tuple[Nlp, Limits]:
    """The optimal control problem of a predicted motion.

    Args:
        known: the car's estimates.
        tables: of the linear plan; its length is that of this one.
        weights: of the cost.
        ahead: the predicted motion.
        observation: whose waypoints are the road.
        last: wheel angle commanded one period ago [rad].
        kappa: curvature at which it was to act [1/m].
        speeds: (N + 1,) in each period [m/s]; None: the measured acceleration goes on.
    """
    o, vehicle, dt, v = observation, known.vehicle, known.dt, ahead.v
    n = tables.horizon
    if speeds is None:
        goes_on = -np.expm1(-dt / _SURGE * np.arange(n + 1))
        speeds = v + known.acceleration * _SURGE * goes_on
    speeds = np.maximum(speeds, SLOWEST)
    road, start = np.empty(n + 1), float(ahead.motion[delay_kernel.WAY])
    delay_kernel.road_at(o.preview, o.spacing, o.curvature, start, speeds, dt, road)
    lacks = np.array(known.disturbance)
    row, headings, angles = vehicle.table.rows[0], np.empty(n + 1), np.empty(n)
    kernel.steady_turns(row, speeds, road, lacks, known.grips, headings, angles)
    _, held = steady_turn(row, max(v, SLOWEST), kappa, lacks, known.grips)
    nlp = Nlp(
        row,
        speeds,
        road,
        headings,
        angles,
        lacks,
        known.grips,
        _diagonal(weights),
        weights.change,
        tables.at(v).terminal,
        np.ascontiguousarray(ahead.motion[:N_STATES]),
        last - held,
        delay_kernel.wheel_angle(vehicle.table, 1.0, v),
        dt,
    )
    steer = float(ahead.motion[delay_kernel.STEER])
    return nlp, Limits(last, largest_step(vehicle, dt, steer, v))


@lru_cache(maxsize=64)
def _diagonal(weights: Weights) -> FloatArray:
    """The weights of a step's terms as a matrix, which is only read."""
    return np.diag(weights[:5])


def linearised(nlp: Nlp, plan: FloatArray) -> Step:
    """The Gauss-Newton QP around a plan (N,), which is moved to where the front tyres grip."""
    n = len(plan)
    plan, low, high, linear = plan.copy(), np.empty(n), np.empty(n), np.empty(n)
    hessian = np.empty((n, n))
    work = np.empty((kernel.N_WORK, max(n, kernel.N_TERMS)))
    cost = kernel.condense(*nlp, plan, low, high, hessian, linear, work)
    return Step(plan, low, high, hessian, linear, cost)


def improved(s: Step, limits: Limits) -> FloatArray | None:
    """The plan (N,) after a full step within the limits; None if there is none."""
    change = np.empty_like(s.plan)
    if kernel.descend(s.hessian, s.linear, np.empty_like(s.hessian), change):
        plan = s.plan + change
        if kernel.keeps_limits(plan, s.low, s.high, *limits):
            return plan
    n, (last, step) = len(s.plan), limits
    rows = np.eye(n) - np.eye(n, k=-1)
    moved = np.diff(s.plan, prepend=last)
    # The bounds may be out of reach from the last angle; a plan at the full rate meets them later.
    ramp = step * np.arange(1, n + 1)
    low, high = np.minimum(s.low, last + ramp), np.maximum(s.high, last - ramp)
    upper = np.concatenate([high - s.plan, step - moved])
    lower = np.concatenate([low - s.plan, -step - moved])
    solved = optimum(s.hessian, s.linear, rows, lower, upper)
    return None if solved is None else s.plan + solved


def iterated(
    nlp: Nlp, limits: Limits, plan: FloatArray, iterations: int
) -> tuple[FloatArray, bool]:
    """The plan (N,) after Gauss-Newton steps, and whether all of them were solved.

    ``plan`` is that of one period ago, or another one of other length, which is left out.
    """
    plan = np.append(plan[1:], plan[-1]) if len(plan) == len(nlp.steady) else nlp.steady
    for _ in range(iterations):
        better = improved(linearised(nlp, plan), limits)
        if better is None:
            return plan, False
        plan = better
    return plan, True
