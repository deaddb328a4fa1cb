"""The nonlinear MPC's quadratic program: a Gauss-Newton step around a plan, condensed.

Condensing: Bock and Plitt, A multiple shooting algorithm for direct solution of optimal control
problems, IFAC World Congress 1984. The states are eliminated by simulating the plan, so that only
the N wheel angles are left.
"""

from __future__ import annotations

import math

from steersman.kernels.compiled import kernel
from steersman.kernels.nmpc_model import N_STATES, errors, move, steady_turn
from steersman.kernels.nmpc_model import N_WORK as MOVE_WORK
from steersman.kernels.vehicle import C_F, L_F
from steersman.types import FloatArray

# Terms of the cost at a step: the errors, and the wheel angle's deviation from the steady turn's.
N_TERMS = N_STATES + 1
# Rows of scratch that ``condense`` needs.
N_WORK = 4 + 3 * N_STATES + 2 * N_TERMS + MOVE_WORK


@kernel
def steady_turns(
    row: FloatArray,
    speeds: FloatArray,
    road: FloatArray,
    lacks: FloatArray,
    grips: FloatArray,
    headings: FloatArray,
    angles: FloatArray,
) -> None:
    """Heading errors (N + 1,) and wheel angles (N,) [rad] of the steady turns along a road; out."""
    for k in range(road.shape[0]):
        heading, angle = steady_turn(row, speeds[k], road[k], lacks, grips)
        headings[k] = heading
        if k < angles.shape[0]:
            angles[k] = angle


@kernel
def _carry(a: FloatArray, b: FloatArray, k: int, by_plan: FloatArray) -> None:
    """The states' derivatives by the plan (4, N) one period later, in which angle ``k`` acts."""
    for j in range(k):
        x0, x1, x2, x3 = by_plan[0, j], by_plan[1, j], by_plan[2, j], by_plan[3, j]
        for i in range(N_STATES):
            by_plan[i, j] = a[i, 0] * x0 + a[i, 1] * x1 + a[i, 2] * x2 + a[i, 3] * x3
    for i in range(N_STATES):
        by_plan[i, k] = b[i]


@kernel
def _turn(turned: FloatArray, k: int, by_plan: FloatArray, terms: FloatArray) -> None:
    """Derivatives of the cost's terms (5, N) by the plan's first ``k`` + 1 angles."""
    for j in range(k + 1):
        for i in range(N_STATES):
            total = 0.0
            for m in range(N_STATES):
                total += turned[i, m] * by_plan[m, j]
            terms[i, j] = total
        terms[N_STATES, j] = 1.0 if j == k else 0.0


@kernel
def add_step(
    weight: FloatArray,
    xi: FloatArray,
    k: int,
    terms: FloatArray,
    weighed: FloatArray,
    hessian: FloatArray,
    linear: FloatArray,
) -> float:
    """Add one step's cost xi' weight xi / 2, in the hessian its lower half alone; returns it."""
    cost = 0.0
    for j in range(k + 1):
        for i in range(N_TERMS):
            total = 0.0
            for m in range(N_TERMS):
                total += weight[i, m] * terms[m, j]
            weighed[i, j] = total
            linear[j] += total * xi[i]
    for j in range(k + 1):
        for q in range(j + 1):
            total = 0.0
            for i in range(N_TERMS):
                total += terms[i, j] * weighed[i, q]
            hessian[j, q] += total
    for i in range(N_TERMS):
        for m in range(N_TERMS):
            cost += 0.5 * weight[i, m] * xi[i] * xi[m]
    return cost


@kernel
def _add_change(
    price: float, change: float, k: int, hessian: FloatArray, linear: FloatArray
) -> float:
    """Add the cost of the deviation's change from angle ``k`` - 1 to angle ``k``; returns it."""
    hessian[k, k] += price
    linear[k] += price * change
    if k > 0:
        hessian[k - 1, k - 1] += price
        hessian[k, k - 1] -= price
        linear[k - 1] -= price * change
    return 0.5 * price * change * change


@kernel
def condense(  # noqa: PLR0917 - numba takes no keyword-only arguments
    row: FloatArray,
    speeds: FloatArray,
    road: FloatArray,
    headings: FloatArray,
    steady: FloatArray,
    lacks: FloatArray,
    grips: FloatArray,
    weight: FloatArray,
    price: float,
    terminal: FloatArray,
    start: FloatArray,
    before: float,
    most: float,
    dt: float,
    plan: FloatArray,
    low: FloatArray,
    high: FloatArray,
    hessian: FloatArray,
    linear: FloatArray,
    work: FloatArray,
) -> float:
    """Gauss-Newton QP around a plan; returns the plan's cost.

    Args:
        row: the car's parameters.
        speeds: (N + 1,) speed in each period [m/s].
        road: (N + 1,) curvature in each period [1/m].
        headings: (N + 1,) heading error of the steady turn in each period [rad].
        steady: (N,) wheel angle of the steady turn in each period [rad].
        lacks: (2,) side [m/s^2] and yaw acceleration [rad/s^2] that the model lacks.
        grips: (2,) largest side forces of the front and of the rear axle [N].
        weight: (5, 5) of the errors and of the wheel angle's deviation at each step.
        price: weight of the squared change of that deviation over a period.
        terminal: (5, 5) cost of the last errors and the last deviation.
        start: (4,) states at the start.
        before: deviation from the steady turn's wheel angle one period earlier [rad].
        most: largest wheel angle [rad].
        dt: control period [s].
        plan: (N,) wheel angles [rad], moved to where the front tyres grip; in place.
        low: (N,) least wheel angles, by the lock and by the grip of the front tyres [rad]; out.
        high: (N,) largest ones [rad]; out.
        hessian: (N, N) of the cost by the plan's change; out.
        linear: (N,) gradient; out.
        work: scratch of shape (N_WORK, max(N, 5)).
    """
    n = plan.shape[0]
    z, b, xi = work[0, :N_STATES], work[1, :N_STATES], work[2, :N_TERMS]
    a, turned = work[4:8, :N_STATES], work[8:12, :N_STATES]
    by_plan, terms, weighed = work[12:16], work[16:21], work[21:26]
    scratch = work[26:, :N_STATES]
    for i in range(N_STATES):
        z[i] = start[i]
    hessian[:, :] = 0.0
    linear[:] = 0.0
    cost, last, reach = 0.0, before, grips[0] / row[C_F]
    for k in range(n):
        points = (z[2] + row[L_F] * z[3]) / speeds[k]
        low[k] = min(max(points - reach, -most), most)
        high[k] = min(max(points + reach, -most), most)
        plan[k] = min(max(plan[k], low[k]), high[k])
        deviation = plan[k] - steady[k]
        cost += _add_change(price, deviation - last, k, hessian, linear)
        last = deviation
        move(row, speeds[k], road[k], lacks, grips, plan[k], dt, z, a, b, scratch)
        _carry(a, b, k, by_plan)
        errors(speeds[k + 1], road[k + 1], headings[k + 1], z, xi, turned)
        xi[N_STATES] = deviation
        _turn(turned, k, by_plan, terms)
        cost += add_step(terminal if k == n - 1 else weight, xi, k, terms, weighed, hessian, linear)
    for i in range(n):
        for j in range(i):
            hessian[j, i] = hessian[i, j]
    return cost


@kernel
def descend(hessian: FloatArray, linear: FloatArray, factor: FloatArray, out: FloatArray) -> bool:
    """The step ``out`` (N,) with hessian out = -linear, by Cholesky; False if that fails.

    ``hessian`` (N, N) is symmetric; ``factor`` (N, N) is scratch.
    """
    n = out.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = hessian[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                factor[i, i] = math.sqrt(total)
            else:
                factor[i, j] = total / factor[j, j]
    for i in range(n):
        total = -linear[i]
        for k in range(i):
            total -= factor[i, k] * out[k]
        out[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = out[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * out[k]
        out[i] = total / factor[i, i]
    return True


@kernel
def keeps_limits(
    plan: FloatArray, low: FloatArray, high: FloatArray, last: float, step: float
) -> bool:
    """Whether wheel angles (N,) lie within their bounds and change by at most ``step`` [rad]."""
    for i in range(plan.shape[0]):
        if not (low[i] <= plan[i] <= high[i] and abs(plan[i] - last) <= step):
            return False
        last = plan[i]
    return True
