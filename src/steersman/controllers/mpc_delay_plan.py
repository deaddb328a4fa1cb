"""The plan of the delay-aware MPC: its model's tables over speed, and one optimisation.

The plan is the optimum that no limit bounds, or the one within the limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from steersman.controllers.motion_estimate import SLOWEST
from steersman.controllers.quadratic import optimum
from steersman.controllers.riccati import riccati
from steersman.controllers.single_track import ErrorModel, discrete, error_model, steady_state
from steersman.kernels import linear_system
from steersman.kernels import mpc_delay as kernel
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Speeds of the tables [m/s]; between them everything is linear, beyond them held.
SPEED_STEP, N_SPEEDS = 0.5, 79
# As in the kernel: half-way to the centre of curvature and beyond, errors mean little.
_NEAREST = 0.2


class Weights(NamedTuple):
    """Of the squares of e1, e1', e2, e2', of the wheel angle's deviation and of its change."""

    lateral: float
    lateral_rate: float
    heading: float
    yaw_rate: float
    angle: float
    change: float


class Model(NamedTuple):
    """What the plan needs at one speed."""

    a: FloatArray
    """(4, 4) errors over a period."""
    b: FloatArray
    """(4,) effect of the wheel angle."""
    steady: FloatArray
    """(2, 3) heading error and wheel angle of the steady turn for a curvature of 1/m, a side
    acceleration of 1 m/s^2 and a yaw acceleration of 1 rad/s^2 that the model lacks."""
    gain: FloatArray
    """(5,) change of the wheel angle for each deviation, the last one that of the angle."""
    ahead: FloatArray
    """(N,) change of the wheel angle for each difference of the curvature ahead."""
    terminal: FloatArray
    """(5, 5) cost from the end of the horizon on."""


@dataclass(frozen=True, eq=False)
class Tables:
    """The models of a vehicle's nominal parameters over speed, each built when it is needed."""

    vehicle: Vehicle
    dt: float
    """Control period [s]."""
    horizon: int
    weights: Weights
    _models: list[Model | None] = field(default_factory=lambda: [None] * N_SPEEDS, repr=False)

    def at(self, v: float) -> Model:
        """The model at speed ``v`` [m/s]."""
        at = min(max((v - SLOWEST) / SPEED_STEP, 0.0), N_SPEEDS - 1.001)
        i = int(at)
        w = at - i
        pairs = zip(self.model(i), self.model(i + 1), strict=True)
        return Model(*((1.0 - w) * low + w * high for low, high in pairs))

    def fill(self) -> Tables:
        """Build the models of all speeds now, so that no step has to."""
        for i in range(N_SPEEDS):
            self.model(i)
        return self

    def model(self, i: int) -> Model:
        """The model at the speed of that number."""
        found = self._models[i]
        if found is None:
            found = self._models[i] = self.built(i)
        return found

    def built(self, i: int) -> Model:
        """The same, built anew."""
        v = SLOWEST + SPEED_STEP * i
        return build_model(self.vehicle, self.dt, self.horizon, self.weights, v)


@lru_cache(maxsize=64)
def build_tables(vehicle: Vehicle, dt: float, horizon: int, weights: Weights) -> Tables:
    """The tables of a vehicle's nominal parameters for a control period ``dt`` [s]."""
    return Tables(vehicle, dt, horizon, weights)


def build_model(vehicle: Vehicle, dt: float, horizon: int, weights: Weights, v: float) -> Model:
    """Discretise at speed ``v`` [m/s], solve the Riccati equation, look ahead along the road.

    With z = [xi, u of the last period] and the change of u as input, z(k+1) = A z(k) + B change(k)
    + E (kappa(k) - kappa(k+1)); docs/controllers.md has the derivation of the gains.
    """
    continuous = error_model(vehicle, v)
    model = discrete(continuous, dt)
    steady = _steady(continuous)
    a, b, e = np.zeros((5, 5)), np.ones(5), np.zeros(5)
    a[:4, :4], a[:4, 4], a[4, 4], b[:4] = model.a, model.b, 1.0, model.b
    e[2] = steady[0, 0]
    p = riccati(a, b, np.diag(weights[:5]), weights.change)
    k, ahead, costate = np.empty(5), np.empty(horizon), p @ e
    scale = linear_system.gain(a, b, p, weights.change, k)
    for j in range(horizon):
        ahead[j] = b @ costate / scale
        costate = a.T @ costate - k * (b @ costate)
    return Model(model.a, model.b, steady, k, ahead, p)


def _steady(model: ErrorModel) -> FloatArray:
    out = np.empty((2, 3))
    sources = (model.g, np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    for i, source in enumerate(sources):
        xi, angle = steady_state(model._replace(g=source))
        out[:, i] = xi[2], angle
    return out


def pose(o: Observation) -> FloatArray:
    """An observation as the kernels' motion."""
    return np.array([o.lateral_error, o.heading_error, o.v_y, o.yaw_rate, o.steer, 0.0])


def largest_step(vehicle: Vehicle, dt: float, steer: float, v: float) -> float:
    """Largest change of the wheel angle over ``dt`` [s] near a steering, at speed ``v`` [rad]."""
    half, now = 0.5 * vehicle.steer_rate_up * dt, min(abs(steer), 1.0)
    ends = [kernel.wheel_angle(vehicle.table, now + d, v) for d in (half, -half)]
    return ends[0] - ends[1]


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
        tables: Tables,
        v: float,
        road: FloatArray,
        motion: FloatArray,
        disturbance: FloatArray,
    ) -> PlanProblem:
        """The problem of a predicted motion at speed ``v`` [m/s]."""
        model = tables.at(v)
        heading, angle = model.steady
        e1, e2, v_y, rate, steer, _ = motion.tolist()
        c, s, kappa = math.cos(e2), math.sin(e2), float(road[0])
        along = (v * c - v_y * s) / max(1.0 - kappa * e1, _NEAREST)
        turned = e2 - float(heading[0]) * kappa - float(heading[1:] @ disturbance)
        xi = np.array([e1, v * s + v_y * c, turned, rate - kappa * along])
        step = largest_step(vehicle, dt, steer, v)
        most = kernel.wheel_angle(vehicle.table, 1.0, v)
        offset = float(angle[1:] @ disturbance)
        return cls(model, road, xi, float(angle[0]), offset, most, step)


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
    """The optimum (N,) that keeps angle and rate; None if there is none."""
    p, n = problem, len(steady)
    hessian, linear = condensed(p, weights, before)
    changes = np.eye(n) - np.eye(n, k=-1)
    steady_changes = changes @ steady
    steady_changes[0] -= last_angle
    upper = np.concatenate([p.most - steady, p.step - steady_changes])
    lower = np.concatenate([-p.most - steady, -p.step - steady_changes])
    return optimum(hessian, linear, changes, lower, upper)


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
    hessian += weights.angle * np.diag(np.arange(n) < n - 1)
    linear[0] -= weights.change * before
    return hessian, linear
