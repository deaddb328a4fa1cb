"""The trials of a tuning: error against steering activity, their front, the chosen one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field

from steersman.config import Of
from steersman.controllers.base import ControllerComponent
from steersman.stored import ShownResult, SourcedResult, StoredResult
from steersman.studies.objective import TrialCost
from steersman.studies.ranges import GainRange
from steersman.table_file import Columns, columns_of

# The two figures of which a trial on the front cannot have less of both.
TRADED = ("rms_error_m", "steer_change_rms")
# Trials from which on the importance of gains is told.
_ENOUGH = 20


class TrialFigures(StoredResult):
    """The figures of :class:`TrialCost`; all but the cost are None in studies of before them."""

    number: int
    cost_m: float
    tracking_m: float | None = None
    smoothness_m: float | None = None
    failure_m: float | None = None
    rms_error_m: float | None = None
    steer_change_rms: float | None = None
    failures: int | None = None
    simulated_seconds: float | None = None
    on_front: bool = False


class TuningTrial(TrialFigures):
    """A trial with the values that it tried."""

    parameters: dict[str, float]
    chosen: bool = False


class SearchedGain(StoredResult):
    """A gain, the range in which it was searched, and how much of the cost hangs on it."""

    name: str
    low: float
    high: float
    pressed: str
    """The end of the range at which the chosen value lies, ``low`` or ``high``; or nothing."""
    importance: float | None
    """Share of what tells the best tenth of the trials from all of them; shares add up to 1."""


class TuningTrials(StoredResult):
    """The content of ``pareto.json``."""

    controller: str
    """The controller's kind."""
    traded: list[str] = Field(default_factory=lambda: list(TRADED))
    failures: int | None
    """The fewest failed drives of a trial."""
    measured: int
    """Trials with figures."""
    simulated_seconds: float
    """Of the measured trials."""
    trials: list[TuningTrial]
    gains: list[SearchedGain] = Field([])
    """Empty in studies of before them."""

    def chosen(self) -> TuningTrial:
        """The trial with the least cost."""
        return next(row for row in self.trials if row.chosen)


class TuneResult(ShownResult, SourcedResult):
    """The content of ``result.json``; its table has a row for each trial."""

    shown_by: ClassVar[str] = "steersman.report.tuning:shown_tuning"

    controller: Annotated[ControllerComponent, Of("controller")]
    """As tuned."""
    start: dict[str, Any]
    """As it was before."""
    cost_m: float
    cost_of_first_trial_m: float
    trials: int
    chosen: TrialFigures | None = None
    simulated_seconds: float | None = None
    simulated_trials: int | None = None
    plant: str | None = None
    suite: list[dict[str, Any]]
    smoothness: float
    widened: list[str] = Field([])
    """Ranges that were widened, as sentences."""
    seed: int
    history: TuningTrials | None = Field(None, exclude=True)
    """The trials, which ``pareto.json`` beside it holds."""

    @classmethod
    def read(cls, file: FilePath) -> Self:
        """The result that a file holds, with the trials of ``pareto.json`` beside it.

        Raises:
            DataError: a file is missing, not JSON, or of another form.
        """
        found, beside = super().read(file), file.with_name("pareto.json")
        if not beside.is_file():
            return found
        return found.model_copy(update={"history": TuningTrials.read(beside)})

    def line(self) -> str:
        """The controller, and its cost before and after."""
        first, last = (f"{1e3 * v:.3g} mm" for v in (self.cost_of_first_trial_m, self.cost_m))
        what = f"{self.controller.kind} after {self.trials} trials"
        return f"TuneResult: {what}, cost {last}; of the first trial {first}"

    def table(self) -> Columns:
        """All trials in the order in which they were made."""
        return columns_of(trial.plain() for trial in (self.history.trials if self.history else []))


def front(rows: Sequence[TrialFigures]) -> list[int]:
    """Places of the rows to which no other is better in one figure and as good in the other.

    A run that leaves the road steers less because it drives less, so only the rows with the
    fewest failures are compared. Rows without figures (of older studies) are left out.

    >>> def row(error, change, failures=0):
    ...     figures = {"rms_error_m": error, "steer_change_rms": change, "failures": failures}
    ...     return TrialFigures(number=0, cost_m=0.0, **figures)
    >>> bad = row(9.0, 0.1, failures=1)
    >>> front([row(1.0, 3.0), row(2.0, 1.0), row(2.0, 2.0), bad, row(None, None, None)])
    [0, 1]
    """
    known = {
        i: (row.rms_error_m, row.steer_change_rms, row.failures or 0)
        for i, row in enumerate(rows)
        if row.rms_error_m is not None and row.steer_change_rms is not None
    }
    fewest = min((failures for *_, failures in known.values()), default=0)
    kept = [i for i, figures in known.items() if figures[2] == fewest]
    found, least = [], float("inf")
    for i in sorted(kept, key=lambda i: known[i]):
        if known[i][1] < least:
            least = known[i][1]
            found.append(i)
    return sorted(found)


def trade(
    kind: str, trials: Sequence[Any], searched: Mapping[str, GainRange] | None = None
) -> TuningTrials:
    """The trials of a controller's study, from Optuna's finished trials and the ranges searched."""
    rows = [_row(trial) for trial in trials]
    chosen = min(range(len(rows)), key=lambda i: rows[i].cost_m)
    best = front(rows)
    rows = [
        row.model_copy(update={"on_front": i in best, "chosen": i == chosen})
        for i, row in enumerate(rows)
    ]
    return TuningTrials(
        controller=kind,
        failures=min((row.failures for row in rows if row.failures is not None), default=None),
        measured=sum(row.simulated_seconds is not None for row in rows),
        simulated_seconds=sum(row.simulated_seconds or 0.0 for row in rows),
        trials=rows,
        gains=_gains(rows, chosen, searched or {}),
    )


def _gains(
    rows: Sequence[TuningTrial], chosen: int, searched: Mapping[str, GainRange]
) -> list[SearchedGain]:
    shares = importances(rows, searched)
    return [
        SearchedGain(
            name=name,
            low=one.low,
            high=one.high,
            pressed=one.pressed(rows[chosen].parameters[name]),
            importance=shares.get(name),
        )
        for name, one in searched.items()
    ]


def importances(rows: Sequence[TuningTrial], searched: Mapping[str, GainRange]) -> dict[str, float]:
    """How much of the cost hangs on each gain, as shares of 1; empty where it cannot be told.

    PED-ANOVA: Watanabe, Bansal, Hutter, "PED-ANOVA: Efficiently Quantifying Hyperparameter
    Importance in Arbitrary Subspaces", IJCAI 2023; of the best tenth of the trials against all.
    """
    import warnings

    import optuna

    costs = [row.cost_m for row in rows]
    if len(rows) < _ENOUGH or len(set(costs)) == 1:
        return {}
    space: dict[str, Any] = {
        name: optuna.distributions.FloatDistribution(
            *_holding(one, [row.parameters[name] for row in rows]), log=one.log
        )
        for name, one in searched.items()
    }
    study = optuna.create_study()
    study.add_trials(
        optuna.trial.create_trial(params=row.parameters, distributions=space, value=row.cost_m)
        for row in rows
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        evaluator = optuna.importance.PedAnovaImportanceEvaluator()
    return optuna.importance.get_param_importances(study, evaluator=evaluator)


def _holding(one: GainRange, values: Sequence[float]) -> tuple[float, float]:
    """The ends of a range that holds all of these values."""
    return min(one.low, *values), max(one.high, *values)


def _row(trial: Any) -> TuningTrial:
    figures = {name: trial.user_attrs.get(name) for name in TrialCost._fields}
    figures["cost_m"] = trial.value
    return TuningTrial(number=trial.number, parameters=dict(trial.params), **figures)
