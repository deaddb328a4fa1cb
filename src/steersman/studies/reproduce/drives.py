"""What the driving stages share: who drives, and what is kept of a drive."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from steersman.config import build
from steersman.episode import Episode
from steersman.metrics.base import summarise
from steersman.rollout import RunConfig, attempt
from steersman.types import FloatArray

MPC_PID = {"kind": "mpc_pid"}
SCHEDULED = {"kind": "mpc_pid", "scheduled": True}
CIRCLE = {"kind": "circle", "radius": 50.0}


def policy(file: Any) -> dict[str, Any]:
    """The controller that drives a policy."""
    return {"kind": "policy", "file": str(file)}


def throttle(at: float) -> dict[str, Any]:
    """Constant throttle."""
    return {"kind": "constant_throttle", "throttle": at}


def drive(controller: Mapping[str, Any], **words: Any) -> Episode:
    """The episode of a run; what was driven until then, if the controller failed."""
    config = build(RunConfig, {"controller": dict(controller), **words})
    return attempt(config).of_controller()


def kept(episode: Episode) -> dict[str, Any]:
    """The few figures of a drive that the tables show."""
    m = summarise(episode)
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


def thinned(values: FloatArray, points: int, digits: int) -> list[float]:
    """Every n-th value, about so many, rounded to so many decimals."""
    step = max(math.ceil(len(values) / points), 1)
    return [round(float(v), digits) for v in values[::step]]
