"""MPC-PID away from its track and speed: where it leaves the corridor, and the agent there."""

from __future__ import annotations

from typing import Any

from steersman.studies.reproduce.drives import (
    MPC_PID,
    SCHEDULED,
    drive,
    kept,
    over_seeds,
    policy,
)
from steersman.studies.reproduce.plan import FULL_METHOD, Plan
from steersman.studies.reproduce.stages import Folder
from steersman.studies.reproduce.trainings import policies

# The belief of a controller that thinks the car heavier, and its tyres softer, than they are.
WRONG = {"mass": 1.3, "yaw_inertia": 1.3, "c_f": 0.7, "c_r": 0.7}
# Corners are taken with at most this [m/s^2], well below roll-over (14.9).
CAP = 12.0
LABELS = {
    "nominal": "MPC-PID, true parameters",
    "wrong": "MPC-PID, wrong parameters",
    "corrected": "MPC-PID, model at the driven speed",
    "scheduled": "MPC-PID, a model for each speed",
}


def controllers(speed: float) -> dict[str, dict[str, Any]]:
    """MPC-PID in its variants, for a test at that speed [m/s]."""
    return {
        "nominal": MPC_PID,
        "wrong": MPC_PID | {"model_error": WRONG},
        "corrected": MPC_PID | {"v0": speed},
        "scheduled": SCHEDULED,
    }


def away(plan: Plan, folder: Folder) -> dict[str, Any]:
    """Every track at every speed: the variants of MPC-PID, and the full method's agents."""
    agents = policies(plan, folder, [FULL_METHOD])[FULL_METHOD]
    tests = []
    for track in plan.away_tracks:
        for speed in plan.away_speeds:
            words: dict[str, Any] = {
                "path": {"kind": track, "radius": 50.0} if track == "circle" else track,
                "speed": {"kind": "constant_speed", "speed": speed, "a_lat_max": CAP},
            }
            if plan.away_seconds is None:
                words["laps"] = 1
            else:
                words["duration"] = plan.away_seconds
            rows = {name: _run(c, words) for name, c in controllers(speed).items()}
            seeds = [_run(policy(file), words) for file in agents.values()]
            tests.append(
                {"track": track, "speed": speed, "mpc_pid": rows, "agent": over_seeds(seeds)}
            )
    return {"tuned": {"track": "training_circuit", "speed": 30.0 / 3.6}, "cap": CAP, "tests": tests}


def _run(controller: dict[str, Any], words: dict[str, Any]) -> dict[str, Any]:
    row = kept(drive(controller, **words))
    names = ("ale_mm", "max_mm", "steer_std", "speed", "distance", "end", "completed")
    return {name: row[name] for name in names}
