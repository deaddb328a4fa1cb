"""The quadratic program of a plan of steering and speed: a Gauss-Newton step, condensed.

As in ``kernels.nmpc``, with pairs of inputs: the wheel angle of a period and its longitudinal
acceleration, which changes the speed and takes its part of both axles' grip (friction ellipse,
``grip.axle_grips``). Derivatives by speed and acceleration are differences.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.grip import axle_grips
from steersman.kernels.nmpc import N_TERMS, add_step
from steersman.kernels.nmpc_model import N_STATES, SLOWEST, errors, move
from steersman.kernels.nmpc_model import N_WORK as MOVE_WORK
from steersman.kernels.vehicle import C_F, L_F
from steersman.types import FloatArray

# Rows of scratch that ``condense`` needs.
N_WORK = 8 + 3 * N_STATES + 2 * N_TERMS + MOVE_WORK
# Differences for derivatives by speed [m/s] and by acceleration [m/s^2].
_DIFFERENCE = 1e-3
# Nearest to the centre of curvature that the road is followed.
_NEAREST = 0.2


@kernel
def _copy(values: FloatArray, to: FloatArray) -> None:
    for i in range(N_STATES):
        to[i] = values[i]


@kernel
def _step(  # noqa: PLR0917 - numba takes no keyword-only arguments
    row: FloatArray,
    friction: float,
    v: float,
    surge: float,
    kappa: float,
    lacks: FloatArray,
    angle: float,
    dt: float,
    z: FloatArray,
    a: FloatArray,
    b: FloatArray,
    by_speed: FloatArray,
    by_surge: FloatArray,
    work: FloatArray,
) -> None:
    """Move states ``z`` on by a period, in place, with all derivatives; the speed is the mean one.

    ``a`` (4, 4) becomes that by the states, ``b``, ``by_speed`` and ``by_surge`` (4,) those by
    wheel angle, mean speed and acceleration at that speed.
    """
    before, grips, scratch = work[0, :N_STATES], work[1, :2], work[2:]
    mean = max(v + 0.5 * dt * surge, SLOWEST)
    _copy(z, before)
    grips[0], grips[1] = axle_grips(row, friction, v, surge)
    move(row, mean + _DIFFERENCE, kappa, lacks, grips, angle, dt, z, a, b, scratch)
    _copy(z, by_speed)
    _copy(before, z)
    grips[0], grips[1] = axle_grips(row, friction, v, surge + _DIFFERENCE)
    move(row, mean, kappa, lacks, grips, angle, dt, z, a, b, scratch)
    _copy(z, by_surge)
    _copy(before, z)
    grips[0], grips[1] = axle_grips(row, friction, v, surge)
    move(row, mean, kappa, lacks, grips, angle, dt, z, a, b, scratch)
    for i in range(N_STATES):
        by_speed[i] = (by_speed[i] - z[i]) / _DIFFERENCE
        by_surge[i] = (by_surge[i] - z[i]) / _DIFFERENCE


@kernel
def _carry(
    a: FloatArray,
    b: FloatArray,
    by_speed: FloatArray,
    by_surge: FloatArray,
    dt: float,
    k: int,
    by_plan: FloatArray,
) -> None:
    """The states' derivatives by the plan (4, 2 N) one period later, in which pair ``k`` acts."""
    for j in range(2 * k):
        x0, x1, x2, x3 = by_plan[0, j], by_plan[1, j], by_plan[2, j], by_plan[3, j]
        faster = dt if j % 2 == 1 else 0.0
        for i in range(N_STATES):
            by_plan[i, j] = a[i, 0] * x0 + a[i, 1] * x1 + a[i, 2] * x2 + a[i, 3] * x3
            by_plan[i, j] += faster * by_speed[i]
    for i in range(N_STATES):
        by_plan[i, 2 * k] = b[i]
        by_plan[i, 2 * k + 1] = 0.5 * dt * by_speed[i] + by_surge[i]


@kernel
def _turn(
    turned: FloatArray, by_speed: FloatArray, dt: float, k: int, by_plan: FloatArray,
    terms: FloatArray,
) -> None:  # fmt: skip
    """Derivatives of the cost's terms (5, 2 N) by the plan's first ``k`` + 1 pairs."""
    for j in range(2 * k + 2):
        faster = dt if j % 2 == 1 else 0.0
        for i in range(N_STATES):
            total = faster * by_speed[i]
            for m in range(N_STATES):
                total += turned[i, m] * by_plan[m, j]
            terms[i, j] = total
        terms[N_STATES, j] = 1.0 if j == 2 * k else 0.0


@kernel
def _add_change(
    price: float, change: float, k: int, hessian: FloatArray, linear: FloatArray
) -> float:
    """Add the cost of the change from angle ``k`` - 1 to angle ``k`` of pairs; returns it."""
    at = 2 * k
    hessian[at, at] += price
    linear[at] += price * change
    if k > 0:
        hessian[at - 2, at - 2] += price
        hessian[at, at - 2] -= price
        linear[at - 2] -= price * change
    return 0.5 * price * change * change


@kernel
def _add_speed(
    prices: FloatArray,
    slow: float,
    surge: float,
    dt: float,
    k: int,
    hessian: FloatArray,
    linear: FloatArray,
) -> float:
    """Add the costs of the speed after period ``k`` and of its acceleration; returns them."""
    for i in range(k + 1):
        linear[2 * i + 1] += prices[0] * dt * slow
        for j in range(i + 1):
            hessian[2 * i + 1, 2 * j + 1] += prices[0] * dt * dt
    hessian[2 * k + 1, 2 * k + 1] += prices[1]
    linear[2 * k + 1] += prices[1] * surge
    return float(0.5 * (prices[0] * slow * slow + prices[1] * surge * surge))


@kernel
def condense(  # noqa: PLR0917 - numba takes no keyword-only arguments
    row: FloatArray,
    road: FloatArray,
    headings: FloatArray,
    steady: FloatArray,
    lacks: FloatArray,
    weight: FloatArray,
    price: float,
    terminal: FloatArray,
    start: FloatArray,
    before: float,
    most: float,
    dt: float,
    friction: float,
    first: float,
    wished: FloatArray,
    prices: FloatArray,
    plan: FloatArray,
    low: FloatArray,
    high: FloatArray,
    hessian: FloatArray,
    linear: FloatArray,
    work: FloatArray,
) -> float:
    """Gauss-Newton QP around a plan of pairs (wheel angle, acceleration); returns its cost.

    Args:
        row: the car's parameters.
        road: (N + 1,) curvature in each period [1/m].
        headings: (N + 1,) heading error of the steady turn in each period [rad].
        steady: (N,) wheel angle of the steady turn in each period [rad].
        lacks: (2,) side [m/s^2] and yaw acceleration [rad/s^2] that the model lacks.
        weight: (5, 5) of the errors and of the wheel angle's deviation at each step.
        price: weight of the squared change of that deviation over a period.
        terminal: (5, 5) cost of the last errors and the last deviation.
        start: (4,) states at the start.
        before: deviation from the steady turn's wheel angle one period earlier [rad].
        most: largest wheel angle [rad].
        dt: control period [s].
        friction: of the tyres [-].
        first: speed at the start [m/s].
        wished: (N,) speed wished after each period [m/s].
        prices: (2,) of the squared difference from it, and of the squared acceleration.
        plan: (2 N,) wheel angles [rad] and accelerations [m/s^2] by turns, moved to where they are
            within the limits; in place.
        low: (2 N,) least inputs; those of the wheel angle are filled.
        high: (2 N,) largest ones; as ``low``.
        hessian: (2 N, 2 N) of the cost by the plan's change; out.
        linear: (2 N,) gradient; out.
        work: scratch of shape (N_WORK, max(2 N, 5)).
    """
    n = road.shape[0] - 1
    z, b, xi = work[0, :N_STATES], work[1, :N_STATES], work[2, :N_TERMS]
    by_speed, by_surge, faster = work[3, :N_STATES], work[4, :N_STATES], work[5, :N_STATES]
    a, turned, by_plan = work[6:10, :N_STATES], work[10:14, :N_STATES], work[14:18]
    terms, weighed, scratch = work[18:23], work[23:28], work[28:, :N_STATES]
    for i in range(N_STATES):
        z[i] = start[i]
        faster[i] = 0.0
    hessian[:, :] = 0.0
    linear[:] = 0.0
    cost, last, v = 0.0, before, first
    for k in range(n):
        plan[2 * k + 1] = min(max(plan[2 * k + 1], low[2 * k + 1]), high[2 * k + 1])
        surge, slow = plan[2 * k + 1], max(v, SLOWEST)
        points = (z[2] + row[L_F] * z[3]) / slow
        reach = axle_grips(row, friction, v, surge)[0] / row[C_F]
        low[2 * k] = min(max(points - reach, -most), most)
        high[2 * k] = min(max(points + reach, -most), most)
        angle = min(max(plan[2 * k], low[2 * k]), high[2 * k])
        plan[2 * k] = angle
        deviation = angle - steady[k]
        cost += _add_change(price, deviation - last, k, hessian, linear)
        last = deviation
        _step(
            row, friction, v, surge, road[k], lacks, angle, dt, z, a, b, by_speed, by_surge, scratch
        )
        _carry(a, b, by_speed, by_surge, dt, k, by_plan)
        v = max(v + dt * surge, 0.0)
        kappa = road[k + 1]
        errors(max(v, SLOWEST), kappa, headings[k + 1], z, xi, turned)
        xi[N_STATES] = deviation
        faster[1] = math.sin(z[1])
        faster[3] = -kappa * math.cos(z[1]) / max(1.0 - kappa * z[0], _NEAREST)
        _turn(turned, faster, dt, k, by_plan, terms)
        of_step = terminal if k == n - 1 else weight
        cost += add_step(of_step, xi, 2 * k + 1, terms, weighed, hessian, linear)
        cost += _add_speed(prices, v - wished[k], surge, dt, k, hessian, linear)
    for i in range(2 * n):
        for j in range(i):
            hessian[j, i] = hessian[i, j]
    return cost
