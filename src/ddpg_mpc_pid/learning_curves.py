"""Learning curves over seeds, coefficients, and what the demonstration saves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddpg_mpc_pid import statistics as st
from ddpg_mpc_pid.plan import METHODS, THRESHOLDS, Plan, alone_beside
from ddpg_mpc_pid.results import (
    CostSaving,
    LearningCurves,
    MethodResult,
    Saving,
    SeedCosts,
    SeedInterval,
    SeedSpread,
    SpreadSaving,
    StudyTraining,
)

SHOWN = (
    "validation_error_mm",
    "off_track_resets",
    "actor_loss",
    "critic_loss",
    "c_track",
    "c_diff",
    "seconds",
)
# What a run may spend on the way to a threshold, and the unit.
COSTS = {"steps": "steps", "seconds": "s", "off_track_resets": "resets"}


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
    return LearningCurves(
        steps=_horizon(plan, curves, "steps"),
        methods={name: _method(name, c, plan) for name, c in curves.items()},
        savings=_savings(plan, curves),
        spread=_spreads(plan, curves),
    )


def _horizon(plan: Plan, curves: Mapping[str, Curves], cost: str) -> float:
    """What the longest run of the compared methods spent in all."""
    values = [v for name, c in curves.items() if not METHODS[name].ablation for v in c.last(cost)]
    return max(values, default=float(max(t.config.steps for t in plan.trainings())))


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


def _demonstrated(curves: Mapping[str, Curves], least: int) -> list[tuple[str, str]]:
    """The methods to compare with DDPG alone, and that, where both have so many seeds."""
    enough = {name for name, c in curves.items() if len(c.runs) >= least}
    pairs = [(name, alone_beside(name, curves)) for name in curves if not METHODS[name].ablation]
    return [(name, alone) for name, alone in pairs if name != alone and {name, alone} <= enough]


def _savings(plan: Plan, curves: Mapping[str, Curves]) -> list[Saving]:
    """What each demonstrated method saves against DDPG alone, for each threshold and cost.

    A run that never gets there (censored) is charged all that the longest run spent, so a saving
    is a saving up to that horizon; how many got there stands beside it.
    """
    out = []
    for threshold in THRESHOLDS:
        for name, beside in _demonstrated(curves, 1):
            costs = {}
            for cost in COSTS:
                alone, helped = (
                    curves[each].to_reach(1e3 * threshold, cost) for each in (beside, name)
                )
                limit = _horizon(plan, curves, cost)
                costs[cost] = CostSaving(
                    alone_median=st.quartiles(alone)[1],
                    median=st.quartiles(helped)[1],
                    horizon=limit,
                    saving=_saving(alone, helped, limit, plan),
                )
            out.append(
                Saving(
                    threshold_m=threshold,
                    method=name,
                    alone=beside,
                    alone_reached=int(np.isfinite(alone).sum()),
                    reached=int(np.isfinite(helped).sum()),
                    seeds=[len(alone), len(helped)],
                    **costs,
                )
            )
    return out


def _spreads(plan: Plan, curves: Mapping[str, Curves]) -> list[SpreadSaving]:
    """By how much the interquartile range over seeds is smaller than that of DDPG alone [mm]."""
    out = []
    for name, beside in _demonstrated(curves, 2):
        groups = curves[beside].best(), curves[name].best()
        out.append(
            SpreadSaving(
                method=name,
                alone=beside,
                alone_mm=_range(groups[0]),
                range_mm=_range(groups[1]),
                alone_median_mm=st.quartiles(groups[0])[1],
                median_mm=st.quartiles(groups[1])[1],
                smaller_by=st.bootstrap(
                    lambda a, b: _range(a) - _range(b), *groups, repetitions=plan.repetitions
                ),
            )
        )
    return out


def _range(values: Any) -> float:
    low, _, high = st.quartiles(values)
    return high - low


def _saving(
    alone: Sequence[float], helped: Sequence[float], limit: float, plan: Plan
) -> SeedInterval | None:
    if not (np.isfinite(alone).any() or np.isfinite(helped).any()):
        return None  # no seed got there: nothing to compare
    return st.bootstrap(
        lambda a, b: st.saving(a, b, limit), alone, helped, repetitions=plan.repetitions
    )
