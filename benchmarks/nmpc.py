"""The nonlinear MPC's plans against IPOPT's, on problems from drives.

    pip install casadi
    python benchmarks/nmpc.py --out results/benchmarks/nmpc.json

Every so many steps of drives, on dry and slippery roads, with disturbances of the state, the
problem of that decision is solved by IPOPT (CasADi) to convergence: same car, same integration,
same cost, same limits. Compared are the plan of one real-time iteration from the last plan, which
is what the controller drives with, and that of 30 iterations. Decisions are timed in turns with
those of `mpc_delay`, on one core.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from steersman.controllers import delay_mpc
from steersman.controllers.base import ControllerComponent
from steersman.controllers.mpc_delay import MpcDelay
from steersman.controllers.nmpc import Nmpc
from steersman.controllers.nmpc_plan import Limits, Nlp, iterated, linearised
from steersman.files import write_text
from steersman.kernels import vehicle as car
from steersman.kernels.nmpc_model import _LEAST_SLOPE, _NEAREST, _SUBSTEP
from steersman.paths.random_road import RandomRoad
from steersman.provenance import provenance
from steersman.rollout import RunConfig, run
from steersman.speed import ConstantSpeed
from steersman.types import FloatArray
from steersman.vehicles import CarlaModel3

STATES, EVERY = 300, 12
# Two drives: friction, and the lateral acceleration that the speed keeps [m/s^2].
DRIVES = ((3.0, 8.0), (0.5, 4.2))


class Case(NamedTuple):
    """A decision: its problem, and the plan it started from."""

    nlp: Nlp
    limits: Limits
    plan: FloatArray


def cases(count: int) -> list[Case]:
    """Decisions of drives, with the state moved at random, half on each friction."""
    out: list[Case] = []
    rng, true = np.random.default_rng(0), delay_mpc.iterated

    def noted(nlp: Nlp, limits: Limits, plan: FloatArray, iterations: int) -> Any:
        noted.calls += 1  # type: ignore[attr-defined] # a counter of its own
        if noted.calls % EVERY == 0 and len(plan) == len(nlp.steady):  # type: ignore[attr-defined]
            moved = nlp.start + rng.normal(0.0, [0.2, 0.03, 0.2, 0.05])
            out.append(Case(nlp._replace(start=moved), limits, plan.copy()))
        return true(nlp, limits, plan, iterations)

    noted.calls = 0  # type: ignore[attr-defined]
    delay_mpc.iterated = noted
    try:
        for i, (friction, cap) in enumerate(DRIVES):
            seed = 3000
            while len(out) < count * (i + 1) // len(DRIVES):
                run(
                    RunConfig().model_copy(
                        update={
                            "controller": Nmpc(),
                            "path": RandomRoad(seed=seed, distance=800.0),
                            "speed": ConstantSpeed(speed=18.0, a_lat_max=cap),
                            "vehicle": CarlaModel3(friction=friction),
                        }
                    )
                )
                seed += 1
            del out[count * (i + 1) // len(DRIVES) :]
    finally:
        delay_mpc.iterated = true
    return out


def ipopt(case: Case) -> tuple[FloatArray, float]:
    """IPOPT's plan (N,) and its cost."""
    import casadi as ca

    p, n = case.nlp, len(case.nlp.steady)
    row = p.row
    m, inertia, l_f, l_r = row[car.MASS], row[car.INERTIA], row[car.L_F], row[car.L_R]
    c_f, c_r = row[car.C_F], row[car.C_R]
    count = int(np.ceil(p.dt / _SUBSTEP - 1e-9))
    h = p.dt / count

    def slope(z: Any, angle: Any, v: float, kappa: float) -> Any:
        along = (v * ca.cos(z[1]) - z[2] * ca.sin(z[1])) / ca.fmax(1.0 - kappa * z[0], _NEAREST)
        front = c_f * (angle - (z[2] + l_f * z[3]) / v)
        front = ca.fmin(ca.fmax(front, -p.grips[0]), p.grips[0])
        slip = (l_r * z[3] - z[2]) / v
        left = ca.fmax(1.0 - c_r * ca.fabs(slip) / (3.0 * p.grips[1]), 0.0)
        rear = p.grips[1] * (1.0 - left**3) * ca.sign(slip)
        return ca.vertcat(
            v * ca.sin(z[1]) + z[2] * ca.cos(z[1]),
            z[3] - kappa * along,
            (front + rear) / m - v * z[3] + p.lacks[0],
            (l_f * front - l_r * rear) / inertia + p.lacks[1],
        )

    def xi(z: Any, v: float, kappa: float, heading: float) -> Any:
        along = (v * ca.cos(z[1]) - z[2] * ca.sin(z[1])) / ca.fmax(1.0 - kappa * z[0], _NEAREST)
        across = v * ca.sin(z[1]) + z[2] * ca.cos(z[1])
        return ca.vertcat(z[0], across, z[1] - heading, z[3] - kappa * along)

    plan = ca.SX.sym("plan", n)
    z, cost, last, rows, low, high = ca.DM(p.start), 0.0, p.before, [], [], []
    for k in range(n):
        v, kappa = float(p.speeds[k]), float(p.road[k])
        rows.append(plan[k] - (z[2] + l_f * z[3]) / v)
        low.append(-p.grips[0] / c_f)
        high.append(p.grips[0] / c_f)
        rows.append(plan[k] - (plan[k - 1] if k else case.limits.last))
        low.append(-case.limits.step)
        high.append(case.limits.step)
        deviation = plan[k] - p.steady[k]
        cost += 0.5 * p.price * (deviation - last) ** 2
        last = deviation
        for _ in range(count):
            middle = z + 0.5 * h * slope(z, plan[k], v, kappa)
            z = z + h * slope(middle, plan[k], v, kappa)
        terms = ca.vertcat(
            xi(z, float(p.speeds[k + 1]), float(p.road[k + 1]), float(p.headings[k + 1])), deviation
        )
        weight = ca.DM(p.terminal if k == n - 1 else p.weight)
        cost += 0.5 * ca.mtimes([terms.T, weight, terms])
    problem = {"x": plan, "f": cost, "g": ca.vertcat(*rows)}
    quiet = {
        "ipopt.print_level": 0,
        "print_time": 0,
        "ipopt.tol": 1e-9,
        "ipopt.sb": "yes",
        "ipopt.max_iter": 300,
        "ipopt.hessian_approximation": "limited-memory",
    }
    solver = ca.nlpsol("plan", "ipopt", problem, quiet)
    most = np.full(n, p.most)
    found = solver(x0=case.plan, lbx=-most, ubx=most, lbg=low, ubg=high)
    good = solver.stats()["success"]
    return np.array(found["x"]).ravel(), float(found["f"]) if good else float("nan")


def compared(case: Case) -> dict[str, float] | None:
    """Cost and first angle after one and after 30 iterations, less IPOPT's; None if that failed."""
    best, cost = ipopt(case)
    if not np.isfinite(cost):
        return None
    out = {"ipopt_cost": cost}
    for iterations in (1, 30):
        plan, solved = iterated(case.nlp, case.limits, case.plan, iterations)
        step = linearised(case.nlp, plan)
        out[f"cost_{iterations}"] = step.cost / max(cost, 1e-12) - 1.0
        out[f"angle_{iterations}"] = abs(float(step.plan[0] - best[0]))
        out[f"solved_{iterations}"] = float(solved)
    return out


def decision_times(rounds: int) -> dict[str, float]:
    """Median time of a decision [us]: of both controllers in turns, and their ratio."""
    from steersman.contracts.scenes import CAR, DT, PosedRoad, beside, observe

    path = PosedRoad()
    cars = [beside(path, 5.0 + 0.5 * i, d=0.01, velocity=(10.0, 0.0)) for i in range(100)]
    row = [observe(path, state, 5.0 + 0.5 * i) for i, state in enumerate(cars)]
    plain = {"delay": 0.0}
    rivals: dict[str, ControllerComponent] = {"nmpc": Nmpc(**plain), "mpc_delay": MpcDelay(**plain)}
    times: dict[str, list[float]] = {name: [] for name in rivals}
    for k in range(rounds + 1):
        for name, controller in rivals.items():
            state = controller.init(CAR, DT)
            for observation in row:
                begun = time.perf_counter()
                _, state = controller.step(state, observation)
                if k:
                    times[name].append(time.perf_counter() - begun)
    middle = {name: 1e6 * float(np.median(each)) for name, each in times.items()}
    least = {f"{name}_least": 1e6 * float(np.min(each)) for name, each in times.items()}
    return {**middle, **least, "ratio": middle["nmpc"] / middle["mpc_delay"]}


def quantiles(values: list[float]) -> dict[str, float]:
    """Median, 90 %, 99 % and the largest."""
    names = {"median": 50, "p90": 90, "p99": 99, "most": 100}
    return {name: float(np.percentile(values, p)) for name, p in names.items()}


def main() -> None:
    """Compare, print, and write the record."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path)
    parser.add_argument("--states", type=int, default=STATES)
    options = parser.parse_args()
    found = cases(options.states)
    rows = [compared(case) for case in found]
    good = [row for row in rows if row is not None]
    result: dict[str, Any] = {
        "states": len(found),
        "ipopt_solved": len(good),
        "decision_us": decision_times(20),
        "sliding_share": _LEAST_SLOPE,
    }
    for iterations in (1, 30):
        result[f"iterations_{iterations}"] = {
            "cost_over_ipopt_less_1": quantiles([r[f"cost_{iterations}"] for r in good]),
            "first_angle_off_rad": quantiles([r[f"angle_{iterations}"] for r in good]),
            "solved": sum(r[f"solved_{iterations}"] for r in good),
        }
    print(json.dumps(result, indent=2))  # noqa: T201 - a command
    if options.out:
        write_text(options.out, json.dumps({**result, "provenance": provenance()}, indent=2) + "\n")


if __name__ == "__main__":
    main()
