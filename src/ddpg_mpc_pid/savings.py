"""What the demonstration saves, and how much smaller the spread over seeds is with it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ddpg_mpc_pid import statistics as st
from ddpg_mpc_pid.plan import METHODS, THRESHOLDS, alone_beside
from ddpg_mpc_pid.results import (
    CostSaving,
    LearningCurves,
    MethodResult,
    Numbers,
    Saving,
    SpreadSaving,
)

# What a run may spend on the way to a threshold.
COSTS = ("steps", "seconds", "off_track_resets")


def compared(methods: Mapping[str, MethodResult], steps: float, repetitions: int) -> LearningCurves:
    """The trainings of some methods, beside DDPG alone with the same action where it is one.

    Args:
        methods: what each method's seeds found, by name.
        steps: of the longest training.
        repetitions: of the bootstrap.
    """
    return LearningCurves(
        steps=steps,
        methods=dict(methods),
        savings=_savings(methods, steps, repetitions),
        spread=_spreads(methods, repetitions),
    )


def _demonstrated(methods: Mapping[str, MethodResult], least: int) -> list[tuple[str, str]]:
    """The methods to compare with DDPG alone, and that, where both have so many seeds."""
    enough = {name for name, method in methods.items() if method.seeds >= least}
    pairs = [(name, alone_beside(name, methods)) for name in methods if not METHODS[name].ablation]
    return [(name, alone) for name, alone in pairs if name != alone and {name, alone} <= enough]


def _savings(methods: Mapping[str, MethodResult], steps: float, repetitions: int) -> list[Saving]:
    """What each demonstrated method saves against DDPG alone, for each threshold and cost.

    A run that never gets there (censored) is charged all that the longest run spent, so a saving
    is a saving up to that horizon; how many got there stands beside it.
    """
    whole = [method for name, method in methods.items() if not METHODS[name].ablation]
    seconds, resets = (
        max((v for m in whole for v in getattr(m, name) if v is not None), default=0.0)
        for name in ("seconds", "resets")
    )
    horizons = dict(zip(COSTS, (steps, seconds, resets), strict=True))
    out = []
    for k, threshold in enumerate(THRESHOLDS):
        for name, beside in _demonstrated(methods, 1):
            reached = methods[beside].reach[k], methods[name].reach[k]
            costs = {
                cost: _cost([_numbers(getattr(one, cost)) for one in reached], limit, repetitions)
                for cost, limit in horizons.items()
            }
            alone, helped = (np.isfinite(_numbers(one.steps)) for one in reached)
            out.append(
                Saving(
                    threshold_m=threshold,
                    method=name,
                    alone=beside,
                    alone_reached=int(alone.sum()),
                    reached=int(helped.sum()),
                    seeds=[len(alone), len(helped)],
                    **costs,
                )
            )
    return out


def _numbers(values: Numbers) -> list[float]:
    """A value for each seed; what is unknown, since a seed never got there, is infinite."""
    return [math.inf if value is None else value for value in values]


def _cost(reached: Sequence[Sequence[float]], horizon: float, repetitions: int) -> CostSaving:
    alone, helped = reached
    saving = None  # if no seed got there, there is nothing to compare
    if np.isfinite(alone).any() or np.isfinite(helped).any():
        saving = st.bootstrap(
            lambda a, b: st.saving(a, b, horizon), alone, helped, repetitions=repetitions
        )
    return CostSaving(
        alone_median=st.quartiles(alone)[1],
        median=st.quartiles(helped)[1],
        horizon=horizon,
        saving=saving,
    )


def _spreads(methods: Mapping[str, MethodResult], repetitions: int) -> list[SpreadSaving]:
    """By how much the interquartile range over seeds is smaller than that of DDPG alone [mm]."""
    out = []
    for name, beside in _demonstrated(methods, 2):
        groups = _numbers(methods[beside].best_mm), _numbers(methods[name].best_mm)
        alone, helped = map(st.quartiles, groups)
        out.append(
            SpreadSaving(
                method=name,
                alone=beside,
                alone_mm=alone[2] - alone[0],
                range_mm=helped[2] - helped[0],
                alone_median_mm=alone[1],
                median_mm=helped[1],
                smaller_by=st.bootstrap(
                    lambda a, b: _range(a) - _range(b), *groups, repetitions=repetitions
                ),
            )
        )
    return out


def _range(values: ArrayLike) -> float:
    low, _, high = st.quartiles(values)
    return high - low
