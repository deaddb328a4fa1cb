"""Learning curves over seeds, and coefficients."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ddpg_mpc_pid import statistics as st
from ddpg_mpc_pid.plan import METHODS, THRESHOLDS, Plan
from ddpg_mpc_pid.results import (
    LearningCurves,
    MethodResult,
    SeedCosts,
    SeedInterval,
    SeedSpread,
    StudyTraining,
)
from ddpg_mpc_pid.savings import COSTS, compared

SHOWN = (
    "validation_error_mm",
    "off_track_resets",
    "actor_loss",
    "critic_loss",
    "c_track",
    "c_diff",
    "seconds",
)


class Curves:
    """The records of one method's seeds."""

    def __init__(self, records: Sequence[StudyTraining]) -> None:
        """Keep the columns; empty cells are NaN."""
        self.diverged = sum(bool(r.diverged) for r in records)
        self.runs = [{k: _floats(v) for k, v in r.curve.items()} for r in records]
        self.runs = [run for run in self.runs if run["steps"].size]

    def spread(self, name: str) -> SeedSpread:
        """Median and quartiles over the seeds that have a value, at every validation."""
        rows = max((run["steps"].size for run in self.runs), default=0)
        out = []
        for k in range(rows):
            having = [run for run in self.runs if k < run["steps"].size]
            values = [run[name][k] for run in having if math.isfinite(run[name][k])]
            if values:
                out.append((having[0]["steps"][k], *st.quartiles(values), len(values)))
        steps, low, median, high, n = zip(*out, strict=True) if out else ((),) * 5
        return SeedSpread(steps=steps, low=low, median=median, high=high, n=n)

    def to_reach(self, threshold_mm: float, cost: str) -> list[float]:
        """What each seed spent until its validation error was that small; infinite: never."""
        return [
            st.first_reach(run[cost].tolist(), run["validation_error_mm"].tolist(), threshold_mm)
            for run in self.runs
        ]

    def last(self, name: str) -> list[float]:
        """The final value of each seed."""
        return [float(run[name][-1]) for run in self.runs]

    def best(self) -> list[float]:
        """The smallest validation error of each seed [mm]."""
        return [float(np.nanmin(run["validation_error_mm"])) for run in self.runs]

    def over_training(self) -> list[float]:
        """The validation error of each seed, averaged over its training [mm]."""
        return [float(np.nanmean(run["validation_error_mm"])) for run in self.runs]


def _floats(values: Sequence[float | None]) -> NDArray[np.float64]:
    return np.array([math.nan if v is None else v for v in values], dtype=np.float64)


def learning_curves(plan: Plan, trained: Mapping[str, StudyTraining]) -> LearningCurves:
    """All that is said about learning, from the records of the trainings."""
    grouped: dict[str, list[StudyTraining]] = {name: [] for name in plan.methods}
    for training in plan.trainings():
        grouped[training.method].append(trained[training.name])
    curves = {name: Curves(records) for name, records in grouped.items()}
    methods = {name: _method(name, c, plan) for name, c in curves.items()}
    return compared(methods, _longest(plan, curves), plan.repetitions)


def _longest(plan: Plan, curves: Mapping[str, Curves]) -> float:
    """Steps of the longest training of the compared methods."""
    steps = [n for name, c in curves.items() if not METHODS[name].ablation for n in c.last("steps")]
    return max(steps, default=float(max(t.config.steps for t in plan.trainings())))


def _method(name: str, curves: Curves, plan: Plan) -> MethodResult:
    best, last, method = curves.best(), curves.last("validation_error_mm"), METHODS[name]

    def interval(values: Sequence[float]) -> SeedInterval:
        return st.bootstrap(st.iqm, values, repetitions=plan.repetitions)

    return MethodResult(
        label=method.label,
        reward=method.reward,
        ablation=method.ablation,
        seeds=len(curves.runs),
        diverged=curves.diverged,
        best_mm=best,
        best_iqm=interval(best),
        best_quartiles=list(st.quartiles(best)),
        last_mm=last,
        last_iqm=interval(last),
        mean_over_training_iqm=interval(curves.over_training()),
        resets=curves.last("off_track_resets"),
        seconds=curves.last("seconds"),
        curves={column: curves.spread(column) for column in SHOWN},
        reach=[
            SeedCosts(threshold_m=at, **{cost: curves.to_reach(1e3 * at, cost) for cost in COSTS})
            for at in THRESHOLDS
        ],
    )
