"""Behaviour cloning and DAgger: drive, label, fit, validate, record, export, round by round.

Sources: Ross, Gordon and Bagnell, A reduction of imitation learning and structured prediction to
no-regret online learning, AISTATS 2011, alg. 3.1; Laskey et al., DART: noise injection for robust
imitation learning, CoRL 2017. docs/imitation.md
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path as FilePath
from typing import Any, TypeAlias

import numpy as np

from steersman.errors import TrainingDiverged
from steersman.files import alone, replacing
from steersman.learning import checkpoint
from steersman.learning.arithmetic import arithmetic
from steersman.learning.export import export_policy
from steersman.learning.imitation.config import ImitationConfig
from steersman.learning.imitation.driving import Drives
from steersman.learning.imitation.fit import Regression
from steersman.learning.imitation.sources import Driven, Given, SampleSource
from steersman.learning.least_squares import Dataset
from steersman.learning.progress import ImitationRow, LearningResult, Record, learned
from steersman.learning.snapshot import Tree
from steersman.learning.validate import Score, Validator

# Each of these draws from a generator of its own, in every round.
_INITIAL, _DRIVES, _BATCHES = range(3)
ImitationResult: TypeAlias = LearningResult[ImitationConfig, ImitationRow]


@alone("out")
def imitate(
    config: ImitationConfig,
    out: FilePath,
    reporter: Callable[[ImitationRow], None] | None = None,
    *,
    tick: Callable[[float], None] | None = None,
    notify: Callable[[str], None] | None = None,
    overwrite: bool = False,
    resume: bool = False,
) -> ImitationResult:
    """Fit a network to a demonstrator; ``result.policy`` is the exported policy.

    Writes what a training writes: ``config.yaml``, ``progress.csv``, TensorBoard events,
    ``checkpoints/``, and the best policy so far (by validation) as ``policy.onnx`` with its card;
    ``resume/`` while it runs.

    Args:
        config: what to imitate, and how.
        out: folder, made if need be.
        reporter: called after every round with the new row of ``progress.csv``.
        tick: called now and then with the rounds done, in parts of one.
        notify: called with a sentence: how the demonstrator drives, where it resumes, or why not.
        overwrite: replace an earlier training in ``out``.
        resume: go on from the last round in ``out``, or begin if there is none.

    Raises:
        DataError: ``out`` holds a training already, or cannot be written.
        ConfigError: the training to be resumed has another configuration.
        TrainingDiverged: the loss is no longer finite.
    """
    say = notify if notify is not None else _no_notice
    given = Given(config) if config.data else None  # read before the folder is touched
    finished, saved = checkpoint.begin(config, out, say, overwrite=overwrite, resume=resume)
    if finished:
        return learned(out, config, ImitationRow)
    with arithmetic(config.threads):
        source: SampleSource = given if given is not None else Driven(config)
        with closing(source):
            _Imitation(config, source, out, reporter, tick, say).run(saved)
    return learned(out, config, ImitationRow)


def _no_notice(_: Any) -> None:
    """The default of ``notify`` and ``tick``."""


class _Imitation:
    """One imitation.

    What a round does depends on the samples, the weights and the round's number. So a checkpoint
    between two rounds need not hold generators, vehicles or the demonstrator.
    """

    def __init__(
        self,
        config: ImitationConfig,
        source: SampleSource,
        out: FilePath,
        reporter: Callable[[ImitationRow], None] | None,
        tick: Callable[[float], None] | None,
        say: Callable[[str], None],
    ) -> None:
        self.config, self.source, self.out, self.say = config, source, out, say
        self.reporter, self.tick = reporter, tick if tick is not None else _no_notice
        problem = config.problem
        mirror = problem.layout.mirror
        self.regression = Regression(config.fit, mirror, problem.turned, self._seed(0, _INITIAL))
        self.validator = Validator(problem, config.validation, source.shared)
        self.data = Dataset.empty(len(mirror), len(problem.turned))
        self.best, self.off_track = math.inf, 0
        self.demonstrator: Score | None = None
        self.record: Record[ImitationRow]
        self.begun = time.process_time()

    def _seed(self, round_: int, use: int) -> np.random.SeedSequence:
        return np.random.SeedSequence([self.config.seed, round_, use])

    def run(self, saved: Tree | None) -> None:
        """All rounds that are left."""
        done = 0 if saved is None else int(saved["round"])
        per_round = self.source.per_round
        resumed = None if saved is None else done * per_round
        self.record = Record(self.out, resumed, ImitationRow)
        try:
            if saved is None:
                self.demonstrator = self.source.judge()
            else:
                self._restore(saved)
                self.say(f"{self.out}: going on after {done} of {self.config.rounds} rounds")
            self.say(self.source.announce(self.demonstrator))
            for k in range(done, self.config.rounds):
                self._round(k)
                self.record.flush()
                self._save_weights((k + 1) * per_round)
                checkpoint.save(self.out, (k + 1) * per_round, self._snapshot(k + 1))
            checkpoint.finish(self.out)
        finally:
            self.record.close()
            self.validator.close()

    def _round(self, k: int) -> None:
        config, regression = self.config, self.regression
        drives = self.source.round(
            k, regression.act, self._seed(k, _DRIVES), lambda share: self.tick(k + 0.5 * share)
        )
        self.data = self.data.joined(drives.data)
        until = (k + 1) * config.fit.updates // config.rounds
        loss = regression.fit(
            self.data,
            until,
            self._seed(k, _BATCHES),
            lambda share: self.tick(k + 0.5 + 0.5 * share),
        )
        if not math.isfinite(loss):
            raise TrainingDiverged(
                f"loss is not finite after {until} updates; try a smaller fit.learning_rate"
            )
        score = self.validator.score(regression.act)
        self.validator.keep_worst(self.out)
        self.off_track += drives.off_track
        row = self._row(k, drives, loss, score)
        self.record.add(row)
        if self.reporter is not None:
            self.reporter(row)
        if score.total < self.best:
            self.best = score.total
            self._export(k + 1, score)

    def _row(self, k: int, drives: Drives, loss: float, score: Score) -> ImitationRow:
        row = {
            "steps": (k + 1) * self.source.per_round,
            "updates": self.regression.updates,
            "seconds": time.process_time() - self.begun,
            "training_error_mm": 1e3 * drives.mean_error,
            "off_track_resets": self.off_track,
            "demo_share": drives.demonstrated,
            "action_difference": drives.difference,
            "loss": loss,
            **score.columns(),
            "learning_rate": self.regression.rate(),
        }
        return ImitationRow(**{name: float(value) for name, value in row.items()})

    def _export(self, rounds: int, score: Score) -> None:
        config = self.config
        note = {
            "method": config.method,
            **self.source.note(),
            "rounds": rounds,
            "steps": len(self.data.actions),
            "updates": self.regression.updates,
            "simulated_seconds": len(self.data.actions) * config.problem.plant.dt,
            "plant": self.validator.source,
            "validation": score.rounded(),
        }
        if self.demonstrator is not None:
            note["demonstrator_validation"] = self.demonstrator.rounded()
        export_policy(self.regression.net, config, self.out, note)

    def _save_weights(self, steps: int) -> None:
        with replacing(self.out / "checkpoints" / f"step_{steps:09d}.npz") as stream:
            np.savez(stream, **self.regression.weights())

    def _snapshot(self, rounds: int) -> dict[str, Any]:
        return {
            "round": rounds,
            "data": self.data._asdict(),
            "weights": self.regression.weights(),
            "rows": self.record.snapshot(),
            "best": self.best,
            "off_track": self.off_track,
            "demonstrator": self.demonstrator,
            "seconds": time.process_time() - self.begun,
        }

    def _restore(self, saved: Tree) -> None:
        self.data = Dataset(**saved["data"])
        self.regression.restore(saved["weights"])
        self.record.restore(saved["rows"])
        self.best, self.off_track = saved["best"], saved["off_track"]
        judged = saved["demonstrator"]
        self.demonstrator = None if judged is None else Score(*judged)
        self.begun = time.process_time() - saved["seconds"]
