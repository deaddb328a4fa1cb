"""Small problems and trainings."""

from __future__ import annotations

from typing import Any

from steersman.config import build, merge
from steersman.learning.config import TrainConfig
from steersman.learning.problem import Problem

SMALL: dict[str, Any] = {
    "roads": [{"kind": "circle", "radius": 40.0}, {"kind": "random_road", "seed": 1}],
    "speeds": [{"kind": "random_profile", "low": 5.0, "high": 12.0}],
    "episode_time": 4.0,
    "spread": {"offset": 0.3, "heading": 0.05, "mass": 0.1, "delay": 0.05},
}
# What makes a problem residual; most tests take a base that is quickly asked.
RESIDUAL: dict[str, Any] = {"action": "residual", "base": {"kind": "mpc_delay"}, "authority": 0.1}
TINY: dict[str, Any] = {
    "problem": SMALL,
    "agent": {
        "hidden": [16, 16],
        "batch": 32,
        "buffer": 4000,
        "vehicles": 4,
        "updates": 1,
        "learning_starts": 200,
    },
    "validation": {
        "roads": [{"kind": "random_road", "seed": 1000}],
        "vehicles": 2,
        "interval": 500,
    },
    "steps": 1500,
    "checkpoint_interval": 1000,
}


def problem(**changes: Any) -> Problem:
    return build(Problem, merge(SMALL, changes))


def tiny(**changes: Any) -> TrainConfig:
    return build(TrainConfig, merge(TINY, changes))
