"""Rewards of the path-following task, for one vehicle and one control step."""

from __future__ import annotations

import math
from typing import NamedTuple

from steersman.kernels.compiled import kernel

# Values of RewardTable.shape, .blend.
PAPER, FINITE_SLOPE = 0, 1
NO_DEMONSTRATION, FIXED, ADAPTIVE = 0, 1, 2


class RewardTable(NamedTuple):
    """Constants of the reward."""

    shape: int
    """PAPER or FINITE_SLOPE."""
    side_slip: int
    """1: Phi is the side-slip angle (the paper's wording), 0: the course error."""
    root_error: float
    """Lateral error at which the square-root term is fully paid [m]."""
    root_weight: float
    """Weight of the square-root term."""
    linear_weight: float
    """Weight of the linear term [1/m]."""
    change: float
    """c_change, weight of half the squared change of steering."""
    blend: int
    """How the demonstration enters: NO_DEMONSTRATION, FIXED or ADAPTIVE."""
    c_track: float
    """Fixed coefficient, or emphasis of the adaptive one."""
    c_diff: float
    """Fixed coefficient, or emphasis of the adaptive one."""
    track_scale: float
    """r_track is divided by this before sigmoid and sum."""
    diff_scale: float
    """r_diff is divided by this before sigmoid and sum."""


@kernel
def sigmoid(x: float) -> float:
    """1 / (1 + exp(-x)) without overflow."""
    if x >= 0.0:
        return 1.0 / (1.0 + math.exp(-x))
    e = math.exp(x)
    return e / (1.0 + e)


@kernel
def track_reward(table: RewardTable, speed: float, d: float, course: float, slip: float) -> float:
    """Tracking reward of a state: lateral error d [m], course error and side-slip [rad].

    PAPER: |v cos Phi| - |v sin Phi| - |v||d|. FINITE_SLOPE: of the order of one, with a square
    root in |d| whose slope does not fade near zero error.
    """
    phi = slip if table.side_slip else course
    if table.shape == PAPER:
        return abs(speed * math.cos(phi)) - abs(speed * math.sin(phi)) - abs(speed * d)
    root = math.sqrt(min(abs(d) / table.root_error, 1.0))
    return 1.0 - table.root_weight * root - table.linear_weight * abs(d) - 0.5 * abs(math.sin(phi))


@kernel
def combine(
    table: RewardTable, r_track: float, steer: float, previous: float, demo: float
) -> tuple[float, float, float]:
    """Reward, and the coefficients c_track and c_diff that went into it.

    ``steer`` is the executed command, ``previous`` the one before, ``demo`` the demonstrated.
    """
    change = 0.5 * table.change * (steer - previous) * (steer - previous)
    track = r_track / table.track_scale
    if table.blend == NO_DEMONSTRATION:
        return table.c_track * track - change, table.c_track, 0.0
    diff = 0.5 * (demo - steer) * (demo - steer) / table.diff_scale
    c_track, c_diff = table.c_track, table.c_diff
    if table.blend == ADAPTIVE:
        c_track *= sigmoid(track)
        c_diff *= sigmoid(diff)
        total = c_track + c_diff
        c_track, c_diff = c_track / total, c_diff / total
    return c_track * track - c_diff * diff - change, c_track, c_diff
