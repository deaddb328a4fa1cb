"""Search the hyper-parameters of a training: Optuna proposes, poor trials are stopped early.

Every trial trains with each of several seeds and is judged by the mean of their validation scores.
All trials drive the same validation drives, so a score over that of any reference (its regret)
ranks trials as the score does. At each rung, a share of the training's steps, a trial is stopped
unless it is among the best of those that came so far (asynchronous successive halving: L. Li et
al., "A System for Massively Parallel Hyperparameter Tuning", MLSys 2020); a trial that goes on does
so from its checkpoints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path as FilePath
from typing import Any, ClassVar, Literal, NamedTuple

from steersman.config import build, dump, to_yaml
from steersman.engine.jobs import Workers
from steersman.engine.work import Job, Tell
from steersman.errors import TrainingDiverged
from steersman.files import alone, make_folder, write_text
from steersman.learning import checkpoint
from steersman.learning.config import TrainConfig
from steersman.learning.parallel import TRAINING
from steersman.provenance import provenance
from steersman.ranges import SettingRange, search_range
from steersman.seed_folders import seed_folder
from steersman.stored import ShownResult, SourcedResult, StoredResult
from steersman.studies.folder import open_study, same_study, sampler
from steersman.studies.ranges import GainRange
from steersman.studies.search_space import SearchConfig, applied, tied
from steersman.table_file import Columns, columns_of

# Called with the trial, what it trains now in words, and the best score so far [m].
Progress = Callable[[int, str, float], None]


class SearchTrial(StoredResult):
    """A trial of a search."""

    number: int
    state: Literal["finished", "stopped", "diverged"]
    settings: dict[str, str]
    """As they are written in an assignment."""
    score_m: float | None
    """Mean over seeds of the best validation score [m], after ``steps``; None if one diverged."""
    steps: int
    """Environment steps that each seed trained."""
    scores_m: list[float | None]
    """Of each seed."""


class SearchResult(ShownResult, SourcedResult):
    """The content of ``search.json``; its table has a row for each trial."""

    shown_by: ClassVar[str] = "steersman.report.shown_runs:shown_search"

    best: SearchTrial
    trials: list[SearchTrial]
    seeds: list[int]
    rungs: list[int]
    ranges: dict[str, str]
    pressed: list[str]
    """Settings whose best value lies within a twentieth of an end of its range, as of a tuning."""

    def remarks(self) -> list[str]:
        """Trials that cannot be told apart, and best values at an end of their ranges."""
        best = self.best.settings
        ends = {n: _pressed(search_range(n, self.ranges[n]), best[n]) for n in self.pressed}
        return tied((t.number, t.steps, t.score_m, t.settings) for t in self.trials) + [
            f"{name}: the best value, {float(best[name]):.4g}, is at the {end} end of"
            f" {self.ranges[name]}; a wider range may help"
            for name, end in ends.items()
        ]

    def line(self) -> str:
        """The best trial."""
        best = ", ".join(f"{name}={value}" for name, value in self.best.settings.items())
        score = "" if self.best.score_m is None else f", score {1e3 * self.best.score_m:.3g} mm"
        return f"SearchResult: {len(self.trials)} trials, best {best}{score}"

    def table(self) -> Columns:
        """All trials in the order in which they began."""
        return columns_of(trial.plain() for trial in self.trials)


class _TrialTraining(NamedTuple):
    config: TrainConfig
    out: FilePath
    until: int | None


@alone("out")
def search(
    config: SearchConfig,
    out: FilePath,
    progress: Progress | None = None,
    *,
    engine: str | None = None,
    jobs: int | None = None,
) -> SearchResult:
    """Search; ``best.yaml`` in ``out`` is the best training's configuration.

    Trainings are in ``trial_N/seed_M``; ``search.json`` has all trials. The same call goes on
    where an interrupted one stopped, and ends as if it had not been.

    Args:
        config: what is searched, and how.
        out: folder of the search.
        progress: called after each rung of each trial.
        engine: of :class:`steersman.engine.jobs.Workers`; the result does not depend on it.
        jobs: trainings at a time; None: one for each core.

    Raises:
        ConfigError: ``out`` holds another search, or nothing can be searched.
        DataError: the folder cannot be written.
        TrainingDiverged: all trials diverged.
    """
    make_folder(out)
    same_study(config, out, ("trials",))
    study = open_study(out / "study.jsonl", "search")
    threads = config.training.threads
    with Workers(engine, jobs, apart=True, threads=threads, needs=TRAINING) as workers:
        hunt = _Search(config, out.resolve(), study, workers, progress)
        for first in range(0, config.trials, config.together):
            hunt.batch(range(first, min(first + config.together, config.trials)))
    result = hunt.result()
    result.write(out / "search.json")
    best = applied(dump(config.training) or {}, result.best.settings)
    write_text(out / "best.yaml", to_yaml(build(TrainConfig, best)))
    return result


class _Search:
    """A search in its folder."""

    def __init__(
        self,
        config: SearchConfig,
        out: FilePath,
        study: Any,
        workers: Workers,
        progress: Progress | None,
    ) -> None:
        from optuna.pruners import SuccessiveHalvingPruner
        from optuna.trial import TrialState

        self.config, self.out, self.study, self.workers = config, out, study, workers
        self.progress, self.states = progress, TrialState
        self.searched, self.rungs = config.searched(), config.rungs()
        self.tree = dump(config.training) or {}
        study.pruner = SuccessiveHalvingPruner(
            min_resource=1, reduction_factor=config.reduction, min_early_stopping_rate=0
        )

    def batch(self, numbers: Sequence[int]) -> None:
        """Train the trials of these numbers, rung by rung, but those that are done."""
        running = [trial for n in numbers if (trial := self._trial(n)) is not None]
        for k, steps in enumerate(self.rungs):
            self._train(running, steps)
            running = [trial for trial in running if self._goes_on(trial, k)]

    def _trial(self, number: int) -> Any:
        """The trial of a number, begun if need be; None if it is over."""
        import optuna

        # Anew for each trial, so that an interrupted search proposes what it would have proposed.
        self.study.sampler = sampler(self.config.seed, number, constant_liar=True)
        known = self.study.get_trials(deepcopy=False)
        if number < len(known):
            if known[number].state is not self.states.RUNNING:
                return None
            trial = optuna.trial.Trial(self.study, known[number]._trial_id)
        else:
            trial = self.study.ask()
        trial.set_user_attr("settings", self._settings(trial))
        return trial

    def _settings(self, trial: Any) -> dict[str, str]:
        return {name: span.suggest(name, trial) for name, span in self.searched.items()}

    def _train(self, trials: Sequence[Any], steps: int) -> None:
        """Train every seed of the trials up to ``steps``; results go to their attributes."""
        jobs = []
        for trial in trials:
            tree = applied(self.tree, trial.user_attrs["settings"])
            for seed in self.config.seeds:
                training = build(TrainConfig, tree | {"seed": seed})
                until = None if steps == self.rungs[-1] else steps
                folder = seed_folder(self._folder(trial.number), seed)
                jobs.append(Job(f"{trial.number} {seed}", _TrialTraining(training, folder, until)))
        if not jobs:
            return
        found = self.workers.run(_trained, jobs, listener=partial(self._tell, steps))
        for trial in trials:
            scores = [found[f"{trial.number} {seed}"] for seed in self.config.seeds]
            trial.set_user_attr("scores", scores)
            trial.set_user_attr("steps", steps)

    def _tell(self, steps: int, key: str, done: int) -> None:
        if self.progress is not None:
            number, seed = key.split()
            words = f"seed {seed}, {done} of {steps} steps"
            self.progress(int(number), words, self._best())

    def _goes_on(self, trial: Any, k: int) -> bool:
        """Judge a trial after rung ``k``, and end it unless it goes on."""
        scores = trial.user_attrs["scores"]
        if None in scores:
            self._end(trial, state=self.states.FAIL)
            return False
        score = math.fsum(scores) / len(scores)
        step = self.config.reduction**k  # where the pruner has its rungs
        judged = step in self.study.get_trials(deepcopy=False)[trial.number].intermediate_values
        if not judged:
            trial.report(score, step)
        if self.rungs[k] == self.rungs[-1]:
            self._end(trial, score)
            return False
        if not judged and trial.should_prune():
            self._end(trial, state=self.states.PRUNED)
            return False
        return True

    def _end(self, trial: Any, value: float | None = None, state: Any = None) -> None:
        self.study.tell(trial, value, state=state)
        for seed in self.config.seeds:
            checkpoint.finish(seed_folder(self._folder(trial.number), seed))

    def _folder(self, number: int) -> FilePath:
        return self.out / f"trial_{number}"

    def _best(self) -> float:
        done = self.study.get_trials(deepcopy=False, states=[self.states.COMPLETE])
        return min((trial.value for trial in done), default=math.nan)

    def result(self) -> SearchResult:
        """All trials, and the best of those that trained to the end."""
        found = self.study.get_trials(deepcopy=False)[: self.config.trials]
        trials = [self._described(trial) for trial in found]
        whole = [one for one in trials if one.state == "finished"]
        if not whole:
            raise TrainingDiverged("all trials diverged; try smaller learning rates")
        best = min(whole, key=lambda one: one.score_m or 0.0)
        return SearchResult(
            best=best,
            trials=trials,
            seeds=list(self.config.seeds),
            rungs=self.rungs,
            ranges=self.config.ranges or _texts(self.searched),
            pressed=[n for n, span in self.searched.items() if _pressed(span, best.settings[n])],
            **provenance(),
        )

    def _described(self, trial: Any) -> SearchTrial:
        names: dict[Any, Literal["finished", "stopped", "diverged"]] = {
            self.states.COMPLETE: "finished",
            self.states.PRUNED: "stopped",
            self.states.FAIL: "diverged",
        }
        scores = trial.user_attrs["scores"]
        return SearchTrial(
            number=trial.number,
            state=names[trial.state],
            settings=trial.user_attrs["settings"],
            score_m=None if None in scores else math.fsum(scores) / len(scores),
            steps=trial.user_attrs["steps"],
            scores_m=scores,
        )


def _trained(order: _TrialTraining, tell: Tell) -> float | None:
    """The best validation score of a training after ``order.until`` steps [m]; None: diverged."""
    from steersman.learning.train import train

    def report(row: Any) -> None:
        tell(int(row.steps))

    try:
        found = train(order.config, order.out, report, resume=True, until=order.until)
    except TrainingDiverged:
        return None
    return float(found.card.training["validation"]["total"])


def _texts(searched: Mapping[str, SettingRange]) -> dict[str, str]:
    return {name: str(span) for name, span in searched.items()}


def _pressed(span: SettingRange, value: str) -> str:
    """The end of its range at which a value lies, ``low`` or ``high``; or nothing."""
    if span.choices:
        return ""
    return GainRange(span.low, span.high, span.log).pressed(float(value))
