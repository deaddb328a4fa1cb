"""A lap of Monza at throttle 0.4, on which nobody was trained or tuned; errors of each corner."""

from __future__ import annotations

from typing import Any

import numpy as np

from steersman.config import resolve
from steersman.episode import Episode
from steersman.paths.base import PathComponent
from steersman.studies.reproduce.drives import (
    MPC_PID,
    SCHEDULED,
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

THROTTLE = 0.4
_POINTS = 700


def length(plan: Plan) -> dict[str, Any]:
    """How far the runs on Monza go."""
    return {"laps": 1} if plan.monza_seconds is None else {"duration": plan.monza_seconds}


def monza(plan: Plan, folder: Folder) -> dict[str, Any]:
    """The lap with every agent of the full method, and with MPC-PID."""
    path = resolve("path", "monza")
    assert isinstance(path, PathComponent)
    words = {"path": "monza", "speed": throttle(THROTTLE), **length(plan)}
    agents = policies(plan, folder, [FULL_METHOD])[FULL_METHOD]
    episodes = {seed: drive(policy(file), **words) for seed, file in agents.items()}
    rows = {seed: kept(episode) for seed, episode in episodes.items()}
    out: dict[str, Any] = {
        "throttle": THROTTLE,
        "agent": over_seeds(list(rows.values())),
        "agents": {str(seed): row for seed, row in rows.items()},
    }
    corners: dict[str, list[dict[str, Any]]] = {}
    for name, controller in (("mpc_pid", MPC_PID), ("scheduled", SCHEDULED)):
        episode = drive(controller, **words)
        out[name] = kept(episode)
        corners[name] = per_corner(episode, path)
    if rows:
        chosen = median_seed(rows)
        episode = episodes[chosen]
        corners["agent"] = per_corner(episode, path)
        out["line"] = {
            "seed": chosen,
            **{
                name: thinned(episode[name], _POINTS, 2)
                for name in ("x", "y", "path_x", "path_y", "s", "lateral_error")
            },
        }
    out["corners"] = corners
    return out


def per_corner(episode: Episode, path: PathComponent) -> list[dict[str, Any]]:
    """Mean and largest |d| in each named corner; None where the car never came."""
    s, d = episode["s"], np.abs(1e3 * episode["lateral_error"])
    out = []
    for corner in path.corners():
        inside = d[(s >= corner.s_start) & (s < corner.s_end)]
        out.append(
            {
                "corner": corner.name,
                "mean_mm": float(inside.mean()) if inside.size else None,
                "max_mm": float(inside.max()) if inside.size else None,
            }
        )
    return out
