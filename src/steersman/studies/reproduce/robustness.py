"""Waypoints shifted at random: errors over time, and error against range."""

from __future__ import annotations

from typing import Any

import numpy as np

from steersman.studies.reproduce.drives import (
    CIRCLE,
    MPC_PID,
    drive,
    kept,
    median_seed,
    over_seeds,
    policy,
    thinned,
    throttle,
)
from steersman.studies.reproduce.plan import FULL_METHOD, Plan
from steersman.studies.reproduce.stages import Folder
from steersman.studies.reproduce.trainings import policies

THROTTLE = 0.5
_POINTS = 300


def robustness(plan: Plan, folder: Folder) -> dict[str, Any]:
    """The full method's agents and MPC-PID on the circle, with waypoint errors."""
    agents = policies(plan, folder, [FULL_METHOD])[FULL_METHOD]
    out: dict[str, Any] = {"throttle": THROTTLE, "ranges": list(plan.error_ranges)}
    for redraw in (True, False):
        name = "every_step" if redraw else "once"
        out[name] = {"agent": [], "mpc_pid": []}
        for reach in plan.error_ranges:
            words = {
                "path": CIRCLE,
                "speed": throttle(THROTTLE),
                "duration": plan.circle_seconds,
                "sensor": {"kind": "waypoints", "error_range": reach, "redraw": redraw},
            }
            rows, episodes = {}, {}
            for seed, file in agents.items():
                episodes[seed] = drive(policy(file), **words)
                rows[seed] = kept(episodes[seed])
            out[name]["agent"].append(over_seeds(list(rows.values())))
            out[name]["mpc_pid"].append(kept(drive(MPC_PID, **words)))
            if redraw and rows:
                episode = episodes[median_seed(rows)]
                out.setdefault("series", []).append(
                    {
                        "range": reach,
                        "time": thinned(episode["time"], _POINTS, 2),
                        "lateral_mm": thinned(1e3 * episode["lateral_error"], _POINTS, 1),
                        "heading_deg": thinned(np.degrees(episode["heading_error"]), _POINTS, 2),
                    }
                )
    return out
