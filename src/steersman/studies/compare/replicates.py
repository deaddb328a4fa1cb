"""Trainings repeated with several seeds: one method's runs over the same scenarios.

Sources: R. Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice",
NeurIPS 2021, for the interquartile mean and the probability of improvement. The bootstrap is
stratified by method: each draw takes whole runs of a method with replacement, because the errors
of one run on all scenarios depend on the same policy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from steersman.bench.results import BenchRow, IntervalEstimate
from steersman.bench.statistics import LEVEL, REPETITIONS, Interval
from steersman.stored import StoredResult
from steersman.types import FloatArray

# With fewer runs a percentile bootstrap over runs is too narrow to mean anything.
FEW_RUNS = 5
# Share that the interquartile mean leaves out at each end.
_QUARTER = 0.25

_Draws: TypeAlias = NDArray[np.int64] | None
Runs: TypeAlias = Mapping[str, Sequence[BenchRow]]


class ReplicatedRun(StoredResult):
    """One run of a method."""

    name: str
    rms_m: float
    """Root of the mean of the squared charged RMS errors [m]."""
    lost: int
    """Drives that ended early."""


class ReplicatedMethod(StoredResult):
    """A method's runs over the scenarios that all methods drove."""

    name: str
    runs: list[ReplicatedRun]
    shown: str
    """The run of median error, which stands for the method in every other table."""
    iqm_m: IntervalEstimate
    """Interquartile mean over runs and scenarios of the charged RMS error [m]."""


class Improvement(StoredResult):
    """How a method compares with the first."""

    name: str
    probability: IntervalEstimate
    """That a run of it has the smaller error, mean over scenarios; a tie counts one half."""


class ReplicatedComparison(StoredResult):
    """Methods compared over their runs."""

    scenarios: int
    methods: list[ReplicatedMethod]
    improvements: list[Improvement]


class _Method(NamedTuple):
    name: str
    runs: Runs
    errors: FloatArray
    """Charged RMS error [m], shape (runs, scenarios)."""


def median_run(runs: Runs) -> str:
    """The run of median error; of two in the middle the worse."""
    order = sorted(runs, key=lambda name: _rms(runs[name]))
    return order[len(order) // 2]


def compare_replicates(
    methods: Mapping[str, Runs],
    *,
    repetitions: int = REPETITIONS,
    seed: int = 0,
) -> ReplicatedComparison:
    """Compare methods over their runs; the first is what the others are compared with.

    Args:
        methods: the rows of each run, by method and run.
        repetitions: draws of the bootstrap.
        seed: of the draws.
    """
    common = _common(methods)
    found = [_Method(name, runs, _errors(runs, common)) for name, runs in methods.items()]
    rng = np.random.default_rng(seed)
    drawn = [
        rng.integers(len(m.errors), size=(repetitions, len(m.errors)))
        if len(m.errors) > 1
        else None
        for m in found
    ]
    base, *others = zip(found, drawn, strict=True)
    return ReplicatedComparison(
        scenarios=len(common),
        methods=[_described(method, draws) for method, draws in (base, *others)],
        improvements=[
            Improvement(
                name=own.name,
                probability=_interval(
                    lambda a, b, one=base[0], two=own: _improvement(one.errors[a], two.errors[b]),
                    (base[1], draws),
                    (len(base[0].errors), len(own.errors)),
                ),
            )
            for own, draws in others
        ],
    )


def _common(methods: Mapping[str, Runs]) -> list[str]:
    """The scenarios that every run drove, in the order of the first."""
    rows = [run for runs in methods.values() for run in runs.values()]
    names = set.intersection(*({row.scenario for row in run} for run in rows))
    return [row.scenario for row in rows[0] if row.scenario in names]


def _errors(runs: Runs, scenarios: Sequence[str]) -> FloatArray:
    by_run = [{row.scenario: row.charged_rms_m for row in rows} for rows in runs.values()]
    return np.array([[run[name] for name in scenarios] for run in by_run])


def _described(method: _Method, draws: _Draws) -> ReplicatedMethod:
    from scipy.stats import trim_mean  # it takes a while to import

    return ReplicatedMethod(
        name=method.name,
        runs=[
            ReplicatedRun(name=name, rms_m=_rms(rows), lost=sum(not row.completed for row in rows))
            for name, rows in method.runs.items()
        ],
        shown=median_run(method.runs),
        iqm_m=_interval(
            lambda a: float(trim_mean(method.errors[a], _QUARTER, axis=None)),
            (draws,),
            (len(method.errors),),
        ),
    )


def _rms(rows: Sequence[BenchRow]) -> float:
    return float(np.sqrt(np.mean([row.charged_rms_m**2 for row in rows])))


def _improvement(base: FloatArray, own: FloatArray) -> float:
    """Mean over scenarios of the share of pairs of runs in which ``own`` has the smaller error."""
    one, two = base[:, None, :], own[None, :, :]
    return float(np.mean((two < one) + 0.5 * (two == one)))


def _interval(
    statistic: Callable[..., float],
    draws: Sequence[_Draws],
    runs: Sequence[int],
) -> IntervalEstimate:
    """A statistic of the runs' numbers, with its interval where some method has several runs."""
    every = [np.arange(count) for count in runs]
    value = statistic(*every)
    repetitions = next((len(one) for one in draws if one is not None), 0)
    if not repetitions:
        return IntervalEstimate(value=value)
    values = [
        statistic(
            *(all_ if one is None else one[k] for one, all_ in zip(draws, every, strict=True))
        )
        for k in range(repetitions)
    ]
    low, high = np.quantile(values, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
    return IntervalEstimate.of(Interval(value, float(low), float(high)))
