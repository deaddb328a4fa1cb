"""Monza, where nothing was trained or tuned, and MPC-PID away from its track and speed."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

import steersman as sm
from ddpg_mpc_pid.drives import (
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
from ddpg_mpc_pid.plan import FULL_METHOD, Plan
from ddpg_mpc_pid.results import AwayTest, CornerError, DrivenLap, MonzaResult, TunedFor
from ddpg_mpc_pid.trainings import policies

THROTTLE = 0.4
_POINTS = 700
# Factors of a controller's model that has the car heavier, and its tyres softer, than they are.
WRONG = {"mass": 1.3, "yaw_inertia": 1.3, "c_f": 0.7, "c_r": 0.7}
# Corners are taken with at most this [m/s^2], well below where carla_model3_v1 rolls over (14.9).
CAP = 12.0
TUNED = TunedFor(track="training_circuit", speed=30.0 / 3.6)
LABELS = {
    "nominal": "MPC-PID, true parameters",
    "wrong": "MPC-PID, wrong parameters",
    "corrected": "MPC-PID, model at the driven speed",
    "scheduled": "MPC-PID, a model for each speed",
}


def length(plan: Plan) -> dict[str, Any]:
    """How far the runs on Monza go."""
    return {"laps": 1} if plan.monza_seconds is None else {"duration": plan.monza_seconds}


def monza(plan: Plan, runs: FilePath) -> MonzaResult:
    """The lap with every agent of the full method, and with MPC-PID."""
    path = sm.make("path", "monza")
    words = {"path": "monza", "speed": throttle(THROTTLE), **length(plan)}
    agents = policies(plan, runs, [FULL_METHOD])[FULL_METHOD]
    episodes = {seed: drive(policy(file), **words) for seed, file in agents.items()}
    rows = {seed: kept(episode) for seed, episode in episodes.items()}
    others = {"mpc_pid": drive(MPC_PID, **words), "scheduled": drive(SCHEDULED, **words)}
    corners = {name: per_corner(episode, path) for name, episode in others.items()}
    line = None
    if rows:
        chosen = median_seed(rows)
        episode = episodes[chosen]
        corners["agent"] = per_corner(episode, path)
        columns = ("x", "y", "path_x", "path_y", "s", "lateral_error")
        line = DrivenLap(seed=chosen, **{c: thinned(episode[c], _POINTS, 2) for c in columns})
    return MonzaResult(
        throttle=THROTTLE,
        agent=over_seeds(list(rows.values())),
        agents={str(seed): row for seed, row in rows.items()},
        **{name: kept(episode) for name, episode in others.items()},
        corners=corners,
        line=line,
    )


def per_corner(episode: sm.Episode, path: Any) -> list[CornerError]:
    """Mean and largest |d| in each named corner; None where the car never came."""
    s, d = episode["s"], np.abs(1e3 * episode["lateral_error"])
    out = []
    for corner in path.corners():
        inside = d[(s >= corner.s_start) & (s < corner.s_end)]
        mean, largest = (inside.mean(), inside.max()) if inside.size else (None, None)
        out.append(CornerError(corner=corner.name, mean_mm=mean, max_mm=largest))
    return out


def controllers(speed: float) -> dict[str, dict[str, Any]]:
    """MPC-PID in its variants, for a test at that speed [m/s]."""
    return {
        "nominal": MPC_PID,
        "wrong": MPC_PID | {"model_error": WRONG},
        "corrected": MPC_PID | {"v0": speed},
        "scheduled": SCHEDULED,
    }


def away(plan: Plan, runs: FilePath, track: str, speed: float) -> AwayTest:
    """A track at a speed: the variants of MPC-PID, and the full method's agents."""
    words: dict[str, Any] = {
        "path": {"kind": track, "radius": 50.0} if track == "circle" else track,
        "speed": {"kind": "constant_speed", "speed": speed, "a_lat_max": CAP},
        **({"laps": 1} if plan.away_seconds is None else {"duration": plan.away_seconds}),
    }
    agents = policies(plan, runs, [FULL_METHOD])[FULL_METHOD]
    return AwayTest(
        track=track,
        speed=speed,
        mpc_pid={name: kept(drive(c, **words)) for name, c in controllers(speed).items()},
        agent=over_seeds([kept(drive(policy(file), **words)) for file in agents.values()]),
    )
