"""The paper's table: the circle of radius 50 m, and the least heading error that physics allows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from steersman.kernels import turn
from steersman.kernels import vehicle as car
from steersman.studies.reproduce.drives import (
    CIRCLE,
    MPC_PID,
    SCHEDULED,
    drive,
    kept,
    over_seeds,
    policy,
    throttle,
)
from steersman.studies.reproduce.plan import METHODS, Plan
from steersman.studies.reproduce.stages import Folder
from steersman.studies.reproduce.trainings import policies
from steersman.vehicles import CarlaModel3

# Throttle, ALE [mm], AOE [deg], SD of normalised steering; and the speed [m/s] at which the
# paper's agent must have driven, inferred from the AOE (docs/paper.md).
PAPER = (
    (0.4, 2.83, 0.922, 0.110, 9.9),
    (0.6, 47.1, 2.12, 0.137, 18.7),
    (0.8, 85.3, 3.87, 0.139, 22.2),
    (1.0, 104.0, 5.01, 0.138, 24.2),
)


def steady_heading_error(speed: float, radius: float = 50.0) -> float | None:
    """|heading error| [deg] of the steady turn without any lateral error; None if there is none.

    The course error is zero there, so the heading error is the side-slip.
    """
    state = np.zeros(car.N_STATE)
    if not turn.steady_turn(CarlaModel3().table, 0, state, speed, 1.0 / radius):
        return None
    return math.degrees(abs(math.atan2(state[car.VY], state[car.VX])))


def circle(plan: Plan, folder: Folder) -> dict[str, Any]:
    """Every method's policies and MPC-PID at the paper's throttles and at equal speeds."""
    drivers: dict[str, list[dict[str, Any]]] = {
        METHODS[name].label: [policy(file) for file in files.values()]
        for name, files in policies(plan, folder, plan.methods).items()
    }
    drivers |= {"MPC-PID": [MPC_PID], "MPC-PID, a model for each speed": [SCHEDULED]}
    tests = []
    for at, ale, aoe, std, speed in PAPER:
        paper = {"ale_mm": ale, "aoe_deg": aoe, "steer_std": std}
        tests.append((f"throttle {at}", throttle(at), paper))
        equal = {"kind": "constant_speed", "speed": speed}
        tests.append((f"{speed} m/s", equal, paper))
    tests.sort(key=lambda test: test[0].startswith("throttle"), reverse=True)
    out = []
    for name, demand, paper in tests:
        rows = {}
        for driver, controllers in drivers.items():
            drives = [
                kept(drive(c, path=CIRCLE, speed=demand, duration=plan.circle_seconds))
                for c in controllers
            ]
            summary = over_seeds(drives)
            reached = summary["median"].get("steady_speed")
            summary["least_aoe_deg"] = steady_heading_error(reached) if reached else None
            rows[driver] = summary
        out.append({"test": name, "paper": paper, "drivers": rows})
    return {"tests": out}
