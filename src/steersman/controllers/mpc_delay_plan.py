"""One optimisation of the delay-aware MPC: the free optimum, or DAQP's within the limits."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.controllers.mpc_delay_model import Model, Weights, at_speed
from steersman.kernels import mpc_delay as kernel
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# DAQP's exit flags for "solved".
_SOLVED = (1, 2)
# As in the kernel: half-way to the centre of curvature and beyond, errors mean little.
_NEAREST = 0.2


def pose(o: Observation) -> FloatArray:
    """An observation as the kernels' motion."""
    return np.array([o.lateral_error, o.heading_error, o.v_y, o.yaw_rate, o.steer, 0.0])


class PlanProblem(NamedTuple):
    """State, road and limits at the moment at which the next command acts."""

    model: Model
    road: FloatArray
    """(N + 1,) curvature in each period from then on [1/m]."""
    xi: FloatArray
    """(4,) errors, less those of the steady turn."""
    angle_per_kappa: float
    """Wheel angle of the steady turn for a curvature of 1/m [rad m]."""
    angle_offset: float
    """Wheel angle that holds against what the model lacks [rad]."""
    most: float
    """Largest wheel angle [rad]."""
    step: float
    """Largest change of the wheel angle over a period [rad]."""

    @classmethod
    def at(
        cls,
        vehicle: Vehicle,
        dt: float,
        tables: Model,
        v: float,
        road: FloatArray,
        motion: FloatArray,
        disturbance: FloatArray,
    ) -> PlanProblem:
        """The problem of a predicted motion at speed ``v`` [m/s]."""
        model = at_speed(tables, v)
        heading, angle = model.steady
        e1, e2, v_y, rate, steer, _ = motion.tolist()
        c, s, kappa = math.cos(e2), math.sin(e2), float(road[0])
        along = (v * c - v_y * s) / max(1.0 - kappa * e1, _NEAREST)
        turned = e2 - float(heading[0]) * kappa - float(heading[1:] @ disturbance)
        xi = np.array([e1, v * s + v_y * c, turned, rate - kappa * along])
        half, now = 0.5 * vehicle.steer_rate_up * dt, min(abs(steer), 1.0)
        ends = [kernel.wheel_angle(vehicle.table, now + d, v) for d in (half, -half)]
        most = kernel.wheel_angle(vehicle.table, 1.0, v)
        offset = float(angle[1:] @ disturbance)
        return cls(model, road, xi, float(angle[0]), offset, most, ends[0] - ends[1])


def solve(
    problem: PlanProblem, weights: Weights, last_angle: float, last_kappa: float
) -> tuple[float, Status]:
    """The next wheel angle [rad].

    Args:
        problem: the optimisation.
        weights: of its cost.
        last_angle: wheel angle commanded one period ago [rad].
        last_kappa: curvature at which that was to act [1/m].
    """
    p = problem
    steady = p.angle_per_kappa * p.road[:-1] + p.angle_offset
    before = last_angle - p.angle_per_kappa * last_kappa - p.angle_offset
    plan = free_plan(p, before)
    status = Status.SOLVED
    if not kernel.within(plan, steady, last_angle, p.most, p.step):
        best = limited_plan(p, weights, before, steady, last_angle)
        if best is not None:
            plan = best
        else:
            kernel.clip(plan, steady, last_angle, p.most, p.step)
            status = Status.FALLBACK
    return float(plan[0] + steady[0]), status


def free_plan(problem: PlanProblem, before: float) -> FloatArray:
    """The optimum without limits (N,): deviations from the steady turn's wheel angle [rad].

    ``before`` is the deviation of one period ago.
    """
    p, m = problem, problem.model
    plan = np.empty(len(p.road) - 1)
    work = np.empty((2, 4))
    kernel.free_plan(
        m.a, m.b, float(m.steady[0, 0]), m.gain, m.ahead, p.road, p.xi, before, plan, work
    )
    return plan


def limited_plan(
    problem: PlanProblem, weights: Weights, before: float, steady: FloatArray, last_angle: float
) -> FloatArray | None:
    """The optimum (N,) that keeps angle and rate; None if DAQP does not say "solved"."""
    import daqp

    p, n = problem, len(steady)
    hessian, linear = condensed(p, weights, before)
    changes = np.eye(n) - np.eye(n, k=-1)
    steady_changes = changes @ steady
    steady_changes[0] -= last_angle
    upper = np.concatenate([p.most - steady, p.step - steady_changes])
    lower = np.concatenate([-p.most - steady, -p.step - steady_changes])
    plan: FloatArray
    plan, _, flag, _ = daqp.solve(hessian, linear, changes, upper, lower)
    if flag not in _SOLVED or not np.isfinite(plan).all():
        return None
    return plan


def condensed(
    problem: PlanProblem, weights: Weights, before: float
) -> tuple[FloatArray, FloatArray]:
    """Hessian (N, N) and linear term (N,) of the same cost over the deviations.

    The cost is the sum of xi(i)' Q xi(i), i = 1 .. N-1, and of the weighted deviations and changes,
    plus the terminal cost of [xi(N), u(N-1)], which holds the weight of u(N-1).
    """
    p, m, n = problem, problem.model, len(problem.road) - 1
    free, forced = p.xi, np.zeros((4, n))
    hessian, linear = np.zeros((n, n)), np.zeros(n)
    for i in range(n):
        free, forced = m.a @ free, m.a @ forced
        free[2] += float(m.steady[0, 0]) * (p.road[i] - p.road[i + 1])
        forced[:, i] += m.b
        if i < n - 1:
            weighed = forced.T * weights[:4]
            hessian += weighed @ forced
            linear += weighed @ free
    end = np.vstack([forced, np.eye(n)[-1]])
    hessian += end.T @ m.terminal @ end
    linear += end.T @ m.terminal @ np.append(free, 0.0)
    changes = np.eye(n) - np.eye(n, k=-1)
    hessian += weights.change * changes.T @ changes
    hessian[range(n - 1), range(n - 1)] += weights.angle
    linear[0] -= weights.change * before
    return hessian, linear
