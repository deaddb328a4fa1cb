"""MPC as users usually write it: CasADi's Opti and IPOPT, the model integrated step by step.

The same cost, horizon and single-track model as MPC-PID (docs/mpc_pid.md), as a nonlinear
program that is built once and solved at every step from the last solution.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from steersman.controllers.mpc_pid import MpcPid
from steersman.rollout import RunConfig
from steersman.types import Observation
from steersman.vehicles import Vehicle

ABSENT = "not measured: CasADi is not installed (pip install casadi)"
_DT = 0.05


def measure(horizon: int, seen: Sequence[Observation], config: RunConfig) -> dict[str, Any]:
    """Times of every solve [us], or a note why there are none."""
    name = f"MPC in CasADi + IPOPT, N = {horizon}"
    if find_spec("casadi") is None:
        return {"name": name, "note": ABSENT}
    solve = _problem(horizon, config.vehicle, MpcPid())
    solve(seen[0])
    times = np.empty(len(seen))
    failed = 0
    for k, observation in enumerate(seen):
        begun = time.perf_counter()
        failed += not solve(observation)
        times[k] = time.perf_counter() - begun
    out: dict[str, Any] = {"name": name, "times": 1e6 * times}
    return out | ({"failed": failed} if failed else {})


def _problem(horizon: int, car: Vehicle, gains: MpcPid) -> Any:
    import casadi as ca

    opti = ca.Opti()
    states, inputs = opti.variable(4, horizon + 1), opti.variable(1, horizon)
    start, target = opti.parameter(4), opti.parameter(horizon)
    v, m, inertia = gains.v0, car.mass, car.yaw_inertia

    def rate(x: Any, u: Any) -> Any:
        """[y, beta, psi, psi_dot] of the single-track model."""
        front = car.c_f * (u - x[1] - car.l_f * x[3] / v)
        rear = car.c_r * (-x[1] + car.l_r * x[3] / v)
        turning = (car.l_f * front - car.l_r * rear) / inertia
        return ca.vertcat(v * (x[1] + x[2]), (front + rear) / (m * v) - x[3], x[3], turning)

    cost: Any = 0
    opti.subject_to(states[:, 0] == start)
    for i in range(horizon):
        x, u = states[:, i], inputs[:, i]
        k1 = rate(x, u)
        k2 = rate(x + 0.5 * _DT * k1, u)
        k3 = rate(x + 0.5 * _DT * k2, u)
        k4 = rate(x + _DT * k3, u)
        opti.subject_to(states[:, i + 1] == x + _DT / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4))
        opti.subject_to(opti.bounded(-car.max_wheel_angle, u, car.max_wheel_angle))
        cost += gains.q * (states[0, i + 1] - target[i]) ** 2 + gains.r * u**2
    cost += gains.p * (states[0, horizon] - target[horizon - 1]) ** 2
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})

    def solve(o: Observation) -> bool:
        ahead = np.arange(1, horizon + 1) * o.v_x * _DT
        places = np.arange(len(o.preview)) * o.spacing
        opti.set_value(start, [0.0, o.v_y / max(o.v_x, 0.5), 0.0, o.yaw_rate])
        opti.set_value(target, np.interp(ahead, places, o.preview[:, 1]))
        try:
            solution = opti.solve()
        except RuntimeError:
            return False
        opti.set_initial(solution.value_variables())
        return True

    return solve
