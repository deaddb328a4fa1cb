"""The same training with several seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import ClassVar

from steersman.errors import DataError
from steersman.learning.config import TrainConfig
from steersman.learning.parallel import TrainingEvent, TrainingJob, train_all
from steersman.learning.progress import TrainResult, load_training
from steersman.seed_folders import seed_folder, seeds_in
from steersman.shown import Shown
from steersman.table_file import Columns, columns_of


@dataclass(frozen=True, repr=False)
class TrainedSeeds(Shown):
    """Trainings that differ in their seed; their table has a row for each validation of each."""

    shown_by: ClassVar[str] = "steersman.report.shown_runs:shown_seeds"

    trainings: Mapping[int, TrainResult]
    """Those that ended, by seed."""
    failed: Mapping[int, str]
    """Why the others failed, by seed."""

    @property
    def best(self) -> TrainResult:
        """The training whose policy was the best in validation.

        Raises:
            DataError: all trainings failed.
        """
        if not self.trainings:
            raise DataError("; ".join(f"seed {s}: {why}" for s, why in self.failed.items()))
        return min(self.trainings.values(), key=_score)

    @property
    def policy(self) -> FilePath:
        """The policy of the best training."""
        return self.best.policy

    def line(self) -> str:
        """The seeds and the best policy."""
        failed = f", {len(self.failed)} failed" if self.failed else ""
        best = f"; best: {self.best.line()}" if self.trainings else ""
        return f"TrainedSeeds: seeds {', '.join(map(str, self.trainings))}{failed}{best}"

    def table(self) -> Columns:
        """The columns of ``progress.csv`` behind the seed."""
        rows = [(s, row) for s, result in self.trainings.items() for row in result.rows]
        return columns_of({"seed": seed, **row._asdict()} for seed, row in rows)


def _score(result: TrainResult) -> float:
    """What selects the best policy [m]; smaller is better."""
    return float(result.card.training["validation"]["total"])


def name_of(seed: int) -> str:
    """What the training with a seed is called.

    >>> name_of(3)
    'seed 3'
    """
    return f"seed {seed}"


def load_seeds(folder: FilePath) -> TrainedSeeds:
    """The trainings with several seeds in a folder.

    Raises:
        DataError: one of them has no record or no policy yet.
        ConfigError: a ``config.yaml`` holds no training.
    """
    return TrainedSeeds({s: load_training(place) for s, place in seeds_in(folder).items()}, {})


def train_seeds(
    config: TrainConfig,
    seeds: Sequence[int],
    folder: FilePath,
    listener: Callable[[TrainingEvent], None],
    *,
    engine: str | None = None,
    jobs: int | None = None,
    overwrite: bool = False,
    resume: bool = False,
) -> TrainedSeeds:
    """Train with each seed into ``seed_N`` of the folder, ``jobs`` at a time.

    Raises:
        DataError: a folder holds a training already, or ``folder`` itself does.
        ConfigError: a training to be resumed has another configuration, or there is no such engine.
    """
    if (folder / "progress.csv").exists():
        raise DataError(f"{folder}: holds one training; give another folder for several seeds")
    tasks = [
        TrainingJob(
            name_of(seed), config.model_copy(update={"seed": seed}), seed_folder(folder, seed)
        )
        for seed in seeds
    ]
    failed = train_all(tasks, jobs, listener, engine=engine, overwrite=overwrite, resume=resume)
    ended = {s: job for s, job in zip(seeds, tasks, strict=True) if job.name not in failed}
    return TrainedSeeds(
        {s: load_training(job.out) for s, job in ended.items()},
        {s: failed[name_of(s)] for s in seeds if s not in ended},
    )
