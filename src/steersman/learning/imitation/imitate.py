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
from typing import Any

import numpy as np

from steersman.config import build, dump
from steersman.errors import TrainingDiverged
from steersman.files import alone, replacing
from steersman.learning import checkpoint
from steersman.learning.arithmetic import arithmetic
from steersman.learning.export import export_policy
from steersman.learning.fleet import FleetDriver
from steersman.learning.imitation.collect import Dataset, Drives, Driving, collect
from steersman.learning.imitation.config import ImitationConfig
from steersman.learning.imitation.fit import Regression
from steersman.learning.record import Record
from steersman.learning.snapshot import Tree
from steersman.learning.validate import Score, Validator

COLUMNS = (
    "steps",
    "updates",
    "seconds",
    "training_error_mm",
    "off_track_resets",
    "demo_share",
    "action_difference",
    "loss",
    "validation_error_mm",
    "validation_rms_mm",
    "validation_failures",
    "steer_activity",
    "learning_rate",
)
# Each of these draws from a generator of its own, in every round.
_INITIAL, _DRIVES, _BATCHES = range(3)


@alone("out")
def imitate(
    config: ImitationConfig,
    out: FilePath,
    reporter: Callable[[dict[str, float]], None] | None = None,
    *,
    tick: Callable[[float], None] | None = None,
    notify: Callable[[str], None] | None = None,
    overwrite: bool = False,
    resume: bool = False,
) -> FilePath:
    """Fit a network to a demonstrator and return the path of the exported policy.

    Writes what a training writes: ``config.yaml``, ``progress.csv``, TensorBoard events,
    ``checkpoints/``, and the best policy so far (by validation) as ``policy.onnx`` with its card;
    ``resume/`` while it runs.

    Args:
        config: what to imitate, and how.
        out: folder, made if need be.
        reporter: called after every round with the new row of ``progress.csv``.
        tick: called now and then with the rounds done, in parts of one.
        notify: told in a sentence how the demonstrator drives, where it resumes, or why not.
        overwrite: replace an earlier training in ``out``.
        resume: go on from the last round in ``out``, or begin if there is none.

    Raises:
        DataError: ``out`` holds a training already, or cannot be written.
        ConfigError: the training to be resumed has another configuration.
        TrainingDiverged: the loss is no longer finite.
    """
    say = notify if notify is not None else _silent
    finished, saved = checkpoint.begin(config, out, say, overwrite=overwrite, resume=resume)
    if finished:
        return out / "policy.onnx"
    with arithmetic(config.threads):
        imitation = _Imitation(config, out, reporter, tick, say)
        with closing(imitation.driver):
            return imitation.run(saved)


def imitation_config(data: dict[str, Any]) -> ImitationConfig:
    """The configuration of an imitation from plain data, defaults filled in.

    Raises:
        ConfigError: it names something unknown or holds values that are not allowed.
    """
    return build(ImitationConfig, data)


def score_text(score: Score) -> str:
    """A validation in a few words."""
    return (
        f"RMS error {1e3 * score.rms_error:.4g} mm, mean {1e3 * score.mean_error:.4g} mm, "
        f"{score.failures} failed, RMS steering change {score.steer_activity:.4f}"
    )


def _silent(_: Any) -> None:
    """Tell nobody."""


class _Imitation:
    """One imitation.

    What a round does depends on the samples, the weights and the round's number. So a checkpoint
    between two rounds need not hold generators, vehicles or the demonstrator.
    """

    def __init__(
        self,
        config: ImitationConfig,
        out: FilePath,
        reporter: Callable[[dict[str, float]], None] | None,
        tick: Callable[[float], None] | None,
        say: Callable[[str], None],
    ) -> None:
        self.config, self.out, self.say = config, out, say
        self.reporter, self.tick = reporter, tick if tick is not None else _silent
        problem = config.problem
        self.driver = FleetDriver(problem, config.vehicles)
        world = self.driver.world
        mirror = problem.encoding.mirror(world.encoding)
        self.regression = Regression(config.fit, mirror, self._seed(0, _INITIAL))
        self.validator = Validator(problem, config.validation, self.driver.mover.shared)
        self.data = Dataset.empty(len(mirror))
        self.best, self.off_track = math.inf, 0
        self.demonstrator: Score
        self.record: Record
        self.begun = time.process_time()

    def _seed(self, round_: int, use: int) -> np.random.SeedSequence:
        return np.random.SeedSequence([self.config.seed, round_, use])

    def run(self, saved: Tree | None) -> FilePath:
        """All rounds that are left."""
        done = 0 if saved is None else int(saved["round"])
        per_round = self.config.round_steps * self.config.vehicles
        resumed = None if saved is None else done * per_round
        self.record = Record(self.out, resumed, COLUMNS)
        try:
            if saved is None:
                self.demonstrator = self._judge_demonstrator()
            else:
                self._restore(saved)
                self.say(f"{self.out}: going on after {done} of {self.config.rounds} rounds")
            kind = self.config.problem.demonstration.controller.kind
            self.say(f"{kind} itself on the validation drives: {score_text(self.demonstrator)}")
            for k in range(done, self.config.rounds):
                self._round(k)
                self.record.flush()
                self._save_weights((k + 1) * per_round)
                checkpoint.save(self.out, (k + 1) * per_round, self._snapshot(k + 1))
            checkpoint.finish(self.out)
        finally:
            self.record.close()
        return self.out / "policy.onnx"

    def _judge_demonstrator(self) -> Score:
        """How the demonstrator drives the validation, through the same action as the network."""
        config = self.config
        shared = self.driver.mover.shared
        judge = Validator(config.problem, config.validation, shared, demonstrated=True)
        return judge.score_demonstrator()

    def _round(self, k: int) -> None:
        config, regression = self.config, self.regression
        drives = collect(
            self.driver,
            self._driving(k),
            config.round_steps,
            self._seed(k, _DRIVES),
            lambda share: self.tick(k + 0.5 * share),
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
        self.off_track += drives.off_track
        row = self._row(drives, loss, score)
        self.record.add(row)
        if self.reporter is not None:
            self.reporter(row)
        if score.total < self.best:
            self.best = score.total
            self._export(k + 1, score)

    def _driving(self, k: int) -> Driving:
        """Who drives in round ``k``; in the first one there is no network yet."""
        config = self.config
        total = config.round_steps * config.vehicles * config.rounds
        sigma = config.noise.value(k * total / config.rounds, total)
        beta = 1.0 if config.method == "bc" else config.beta.value(k * total / config.rounds, total)
        return Driving(self.regression.act if k else None, beta, sigma, config.noise_theta)

    def _row(self, drives: Drives, loss: float, score: Score) -> dict[str, float]:
        row = {
            "steps": len(self.data.actions),
            "updates": self.regression.updates,
            "seconds": time.process_time() - self.begun,
            "training_error_mm": 1e3 * drives.mean_error,
            "off_track_resets": self.off_track,
            "demo_share": drives.demonstrated,
            "action_difference": drives.difference,
            "loss": loss,
            "validation_error_mm": 1e3 * score.mean_error,
            "validation_rms_mm": 1e3 * score.rms_error,
            "validation_failures": score.failures,
            "steer_activity": score.steer_activity,
            "learning_rate": self.regression.rate(),
        }
        return {name: float(row[name]) for name in COLUMNS}

    def _export(self, rounds: int, score: Score) -> None:
        config = self.config
        note = {
            "method": config.method,
            "demonstrator": dump(config.problem.demonstration.controller),
            "rounds": rounds,
            "steps": len(self.data.actions),
            "updates": self.regression.updates,
            "simulated_seconds": len(self.data.actions) * self.driver.dt,
            "validation": _rounded(score),
            "demonstrator_validation": _rounded(self.demonstrator),
        }
        export_policy(self.regression.net, config, self.out, note)

    def _save_weights(self, steps: int) -> None:
        with replacing(self.out / "checkpoints" / f"step_{steps:09d}.npz") as stream:
            np.savez(stream, **self.regression.weights())

    def _snapshot(self, rounds: int) -> dict[str, Any]:
        return {
            "round": rounds,
            "data": self.data._asdict(),
            "weights": self.regression.weights(),
            "rows": self.record.rows,
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
        self.demonstrator = Score(*saved["demonstrator"])
        self.begun = time.process_time() - saved["seconds"]


def _rounded(score: Score) -> dict[str, float]:
    return {k: round(float(v), 6) for k, v in score._asdict().items()}
