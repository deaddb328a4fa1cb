"""From training records to curves: one panel for each column, all trainings overlaid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from steersman.report.runs import ReportRun
from steersman.report.signals import decimate, look
from steersman.types import FloatArray

# What the curves are drawn against: the first of these that every training has.
AXES = {"steps": "environment steps", "updates": "updates", "seconds": "time [s]"}
TITLES = {
    "updates": "updates",
    "seconds": "time [s]",
    "reward_mean": "mean reward per step",
    "off_track_resets": "off-track resets",
    "training_error_mm": "error while training [mm]",
    "validation_error_mm": "validation error [mm]",
    "validation_rms_mm": "validation, RMS error [mm]",
    "validation_failures": "validation drives that failed",
    "steer_activity": "validation, RMS steering change",
    "q_mean": "mean Q value",
    "saturated_share": "share of actions at their limit",
    "actor_loss": "actor loss",
    "critic_loss": "critic loss",
    "c_track": "coefficient of tracking",
    "c_diff": "coefficient of demonstration",
    "loss": "loss",
    "action_difference": "difference from the demonstrator's action",
    "demo_share": "share of demonstrated actions",
    "learning_rate": "learning rate",
}
# What matters comes first; other columns follow in the order of the files.
FIRST = ("validation_error_mm", "reward_mean", "off_track_resets")
POINTS = 2000


def curves(runs: Sequence[ReportRun]) -> dict[str, Any] | None:
    """The data of the training plots, None if nothing was trained."""
    tables = {run.name: run.training for run in runs if run.training is not None}
    if not tables:
        return None
    axis = next((a for a in AXES if all(a in table for table in tables.values())), None)
    names = dict.fromkeys([*FIRST, *(name for table in tables.values() for name in table)])
    shown = [
        name
        for name in names
        if name not in AXES and any(_has_values(table.get(name)) for table in tables.values())
    ]
    lines = [
        {"name": name, **look(k), "panels": [_line(table, axis, n) for n in shown]}
        for k, (name, table) in enumerate(tables.items())
    ]
    return {
        "x": AXES.get(axis or "", "row"),
        "panels": [TITLES.get(name, name) for name in shown],
        "runs": lines,
    }


def _has_values(values: FloatArray | None) -> bool:
    return values is not None and bool(np.isfinite(values).any())


def _line(table: Mapping[str, FloatArray], axis: str | None, name: str) -> dict[str, Any]:
    if name not in table:
        return {"x": [], "y": []}
    y = table[name]
    x = table[axis] if axis else np.arange(y.size, dtype=np.float64)
    filled = np.isfinite(x) & np.isfinite(y)
    x, y = x[filled], y[filled]
    rows = decimate([y], POINTS)
    # Losses and rates span decades: keep five significant digits, not decimals.
    return {"x": x[rows].tolist(), "y": [float(f"{value:.5g}") for value in y[rows]]}
