"""Curves of trainings: one line each, or median and range of the seeds of one training."""

from __future__ import annotations

import re
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
    "validation_score": "validation score, the less the better",
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
# A training that was made with several seeds: its folder's name, and the seed's.
_SEED = re.compile(r"(?:(?P<name>.*)/)?seed_\d+")


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
        {"name": name, **look(k), "panels": [band(same, axis, n) for n in shown]}
        for k, (name, same) in enumerate(_by_training(tables).items())
    ]
    return {
        "x": AXES.get(axis or "", "row"),
        "panels": [TITLES.get(name, name) for name in shown],
        "runs": lines,
    }


def _by_training(
    tables: Mapping[str, Mapping[str, FloatArray]],
) -> dict[str, list[Mapping[str, FloatArray]]]:
    """The records that one line shows, by its name: one, or those of a training's seeds."""
    found: dict[str | None, list[str]] = {}
    for name in tables:
        match = _SEED.fullmatch(name)
        found.setdefault(match["name"] or "" if match else None, []).append(name)
    out: dict[str, list[Mapping[str, FloatArray]]] = {}
    for training, names in found.items():
        if training is None or len(names) == 1:
            out |= {name: [tables[name]] for name in names}
        else:
            words = f"median and range of {len(names)} seeds"
            out[f"{training}: {words}" if training else words] = [tables[name] for name in names]
    return out


def _has_values(values: FloatArray | None) -> bool:
    return values is not None and bool(np.isfinite(values).any())


def band(tables: Sequence[Mapping[str, FloatArray]], axis: str | None, name: str) -> dict[str, Any]:
    """One line: ``x`` and ``y``; of several records the median, and ``low`` and ``high`` too.

    Args:
        tables: the records of one training with each of its seeds.
        axis: the column for ``x``; None: the number of the row.
        name: the column for ``y``.
    """
    lines = [line for line in (_line(table, axis, name) for table in tables) if line[0].size]
    if not lines:
        return {"x": [], "y": []}
    if len(lines) == 1:
        x, y = lines[0]
        rows = decimate([y], POINTS)
        return {"x": x[rows].tolist(), "y": _numbers(y[rows])}
    # Where all of them have values, at the places of the first.
    first, last = max(line[0][0] for line in lines), min(line[0][-1] for line in lines)
    x = lines[0][0]
    x = x[(x >= first) & (x <= last)]
    values = np.array([np.interp(x, *line) for line in lines])
    median = np.median(values, axis=0)
    rows = decimate([median], POINTS)
    return {
        "x": x[rows].tolist(),
        "y": _numbers(median[rows]),
        "low": _numbers(values.min(axis=0)[rows]),
        "high": _numbers(values.max(axis=0)[rows]),
    }


def _line(
    table: Mapping[str, FloatArray], axis: str | None, name: str
) -> tuple[FloatArray, FloatArray]:
    y = table.get(name, np.empty(0))
    x = table[axis] if axis and y.size else np.arange(y.size, dtype=np.float64)
    filled = np.isfinite(x) & np.isfinite(y)
    return x[filled], y[filled]


def _numbers(values: FloatArray) -> list[float]:
    """Losses and rates span decades: five significant digits are kept, not decimals."""
    return [float(f"{value:.5g}") for value in values]
