"""Drives and what is kept of them; the paper's table (circle) and its figure of robustness."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import steersman as sm
from ddpg_mpc_pid.plan import FULL_METHOD, METHODS, Plan
from ddpg_mpc_pid.trainings import policies

MPC_PID = {"kind": "mpc_pid"}
SCHEDULED = {"kind": "mpc_pid", "scheduled": True}
CIRCLE = {"kind": "circle", "radius": 50.0}
# Throttle of the drives with waypoint errors, and points of their drawn errors.
_SHIFTED = 0.5
_POINTS = 300


def policy(file: Any) -> dict[str, Any]:
    """The controller that drives a policy."""
    return {"kind": "policy", "file": str(file)}


def throttle(at: float) -> dict[str, Any]:
    """Constant throttle."""
    return {"kind": "constant_throttle", "throttle": at}


def drive(controller: Mapping[str, Any], **words: Any) -> sm.Episode:
    """The episode of a run; what was driven until then, if the controller failed."""
    return sm.attempt({"controller": dict(controller), **words}).of_controller()


def kept(episode: sm.Episode) -> dict[str, Any]:
    """The few figures of a drive that the tables show."""
    m = sm.summarise(episode)
    return {
        "ale_mm": _mm(m["mean_abs_lateral_error_m"]),
        "steady_ale_mm": _mm(m["steady"]["mean_abs_lateral_error_m"]),
        "max_mm": _mm(m["max_abs_lateral_error_m"]),
        "aoe_deg": m["mean_abs_heading_error_deg"],
        "steady_aoe_deg": m["steady"]["mean_abs_heading_error_deg"],
        "course_deg": m["mean_abs_course_error_deg"],
        "steer_std": m["steer_std"],
        "steady_steer_std": m["steady"]["steer_std"],
        "speed": m["mean_speed_m_s"],
        "steady_speed": m["steady"]["mean_speed_m_s"],
        "seconds": m["duration_s"],
        "distance": m["distance_m"],
        "end": episode.end,
        "completed": episode.completed,
    }


def _mm(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def over_seeds(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Median and worst of every figure over the seeds, and how many drives were completed.

    The worst seed is the one that ended early or, if none did, the one with the largest error.
    """
    if not rows:
        return {"seeds": 0, "completed": 0, "median": {}, "worst": {}}
    names = [k for k, v in rows[0].items() if isinstance(v, float) or v is None]
    median = {}
    for name in names:
        values = [row[name] for row in rows if row[name] is not None]
        median[name] = float(np.median(values)) if values else None
    worst = max(rows, key=lambda row: (not row["completed"], row["ale_mm"] or math.inf))
    return {
        "seeds": len(rows),
        "completed": sum(bool(row["completed"]) for row in rows),
        "median": median,
        "worst": dict(worst),
    }


def median_seed(rows: Mapping[int, Mapping[str, Any]]) -> int:
    """The seed whose mean error is the (lower) median; runs that ended early come last."""
    order = sorted(rows, key=lambda k: (not rows[k]["completed"], rows[k]["ale_mm"] or math.inf))
    return order[(len(order) - 1) // 2]


def thinned(values: ArrayLike, points: int, digits: int) -> list[float]:
    """Every n-th value, about so many, rounded to so many decimals."""
    series = np.asarray(values)
    step = max(math.ceil(len(series) / points), 1)
    return [round(float(v), digits) for v in series[::step]]


def steady_heading_error(speed: float, radius: float = 50.0) -> float | None:
    """|heading error| [deg] of the steady turn without any lateral error; None if there is none.

    The course error is zero there, so the heading error is the side-slip.
    """
    motion = sm.VehicleMotion(sm.RunConfig().vehicle)
    if not motion.steady_turn(speed, 1.0 / radius):
        return None
    forward, left = motion.velocity
    return math.degrees(abs(math.atan2(left, forward)))


def circle(plan: Plan, runs: FilePath) -> dict[str, Any]:
    """Every method's policies and MPC-PID at the paper's throttles and at equal speeds."""
    drivers: dict[str, list[dict[str, Any]]] = {
        METHODS[name].label: [policy(file) for file in files.values()]
        for name, files in policies(plan, runs, plan.methods).items()
    }
    drivers |= {"MPC-PID": [MPC_PID], "MPC-PID, a model for each speed": [SCHEDULED]}
    tests = []
    for row in sm.PAPER_CIRCLE:
        paper = {name: getattr(row, name) for name in ("ale_mm", "aoe_deg", "steer_std")}
        tests.append((f"throttle {row.throttle}", throttle(row.throttle), paper))
        equal = {"kind": "constant_speed", "speed": row.speed}
        tests.append((f"{row.speed} m/s", equal, paper))
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


def robustness(plan: Plan, runs: FilePath) -> dict[str, Any]:
    """The full method's agents and MPC-PID on the circle, with waypoint errors."""
    agents = policies(plan, runs, [FULL_METHOD])[FULL_METHOD]
    out: dict[str, Any] = {"throttle": _SHIFTED, "ranges": list(plan.error_ranges)}
    for redraw in (True, False):
        name = "every_step" if redraw else "once"
        out[name] = {"agent": [], "mpc_pid": []}
        for reach in plan.error_ranges:
            words = {
                "path": CIRCLE,
                "speed": throttle(_SHIFTED),
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
