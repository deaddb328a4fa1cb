"""The course of a training or an imitation: typed rows, their record, its result, its alarms."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, ClassVar, Generic, NamedTuple, TypeAlias, TypeVar

from steersman.config import build, read_yaml
from steersman.errors import DataError, TrainingDiverged, three_digits
from steersman.files import write_text
from steersman.learning.config import TrainConfig
from steersman.policy_file import PolicyCard, read_policy
from steersman.shown import Shown
from steersman.table_file import Columns, columns_of

# Training is stopped when this share of the actions was at a limit for this many validations.
_STUCK_SHARE, _STUCK_ROWS = 0.95, 3
# Values may be so many times what the reward adds up to, a margin for untrained critics.
_MARGIN = 10.0
# What is told while training goes on: validation error relative to the best, share of actions.
_WORSE, _AT_LIMIT = 2.0, 0.5
_NAN = math.nan
C = TypeVar("C")


class TrainRow(NamedTuple):
    """A line of a training's ``progress.csv``; NaN where there is no number. docs/training.md."""

    steps: float = _NAN
    updates: float = _NAN
    seconds: float = _NAN
    reward_mean: float = _NAN
    training_error_mm: float = _NAN
    off_track_resets: float = _NAN
    validation_error_mm: float = _NAN
    validation_rms_mm: float = _NAN
    validation_failures: float = _NAN
    validation_score: float = _NAN
    steer_activity: float = _NAN
    actor_loss: float = _NAN
    critic_loss: float = _NAN
    q_mean: float = _NAN
    c_track: float = _NAN
    c_diff: float = _NAN
    demo_share: float = _NAN
    saturated_share: float = _NAN
    learning_rate: float = _NAN


class ImitationRow(NamedTuple):
    """A line of an imitation's ``progress.csv``; NaN: no number. docs/imitation.md."""

    steps: float = _NAN
    updates: float = _NAN
    seconds: float = _NAN
    training_error_mm: float = _NAN
    off_track_resets: float = _NAN
    demo_share: float = _NAN
    action_difference: float = _NAN
    loss: float = _NAN
    validation_error_mm: float = _NAN
    validation_rms_mm: float = _NAN
    validation_failures: float = _NAN
    validation_score: float = _NAN
    steer_activity: float = _NAN
    learning_rate: float = _NAN


R = TypeVar("R", TrainRow, ImitationRow)


@dataclass(frozen=True, repr=False)
class LearningResult(Shown, Generic[C, R]):
    """What a training or imitation left in its folder; its table has a row for each validation."""

    shown_by: ClassVar[str] = "steersman.report.shown_runs:shown_training"

    folder: FilePath
    config: C
    rows: tuple[R, ...]
    """The record, a row for each validation."""
    best: R
    """The row of the policy that is exported."""
    policy: FilePath
    """The exported policy, ``policy.onnx``; its card is beside it."""
    card: PolicyCard
    version: int = 1

    @property
    def seconds(self) -> float:
        """Computing time [s]."""
        return self.rows[-1].seconds

    @property
    def seed(self) -> int:
        """Seed of everything random."""
        return self.card.seed

    @property
    def commit(self) -> str | None:
        """Commit of the package that exported the policy; None: not known."""
        return self.card.commit

    def line(self) -> str:
        """How far it got, the validation error of its policy, and where that is."""
        steps, error = self.rows[-1].steps, self.best.validation_error_mm
        return (
            f"Training: {steps:.0f} steps, validation error {three_digits(error)} mm; {self.policy}"
        )

    def table(self) -> Columns:
        """The columns of ``progress.csv``."""
        return columns_of(row._asdict() for row in self.rows)

    def __fspath__(self) -> str:
        """The policy's file, so that a result stands wherever a policy may be named."""
        return str(self.policy)


TrainResult: TypeAlias = LearningResult[TrainConfig, TrainRow]


def learned(folder: FilePath, config: C, row: type[R]) -> LearningResult[C, R]:
    """The result in a folder, whichever version wrote it.

    Raises:
        DataError: there is no record or no policy, or one of them cannot be read.
    """
    rows = read_rows(folder / "progress.csv", row)
    policy = folder / "policy.onnx"
    card = read_policy(policy)[1]
    updates, error = card.training["updates"], 1e3 * card.training["validation"]["mean_error"]

    def distance(one: R) -> tuple[float, float]:
        return abs(one.updates - updates), abs(one.validation_error_mm - error)

    return LearningResult(folder, config, tuple(rows), min(rows, key=distance), policy, card)


def chosen_words(result: TrainResult) -> str:
    """Which of the validated policies of a training is the exported one."""
    policy, steps = result.policy, result.card.training["steps"]
    if steps == 0:
        return f"{policy}: the base alone; nothing later was better in validation"
    if not result.rows[-1].updates:
        return f"{policy}: not trained; no update was made in {steps} steps ({_why(result.config)})"
    whole = min(steps, result.config.steps)  # every vehicle ends its step
    return f"{policy}: after {whole} of {result.config.steps} steps, the best in validation"


def _why(config: TrainConfig) -> str:
    starts = getattr(config.agent, "learning_starts", None)
    return "too few" if starts is None else f"agent.learning_starts is {starts}"


def read_rows(file: FilePath, row: type[R]) -> list[R]:
    """The rows of ``progress.csv``; columns that it lacks are NaN, others are dropped.

    Raises:
        DataError: it is missing, holds no row, or something that is no number.
    """
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            lines = list(csv.DictReader(stream))
        names = row._fields
        rows = [row(**{n: float(line[n]) for n in names if line.get(n)}) for line in lines]
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, csv.Error, ValueError) as error:
        raise DataError(f"{file}: not a record of a training ({error})") from None
    if not rows:
        raise DataError(f"{file}: holds no row")
    return rows


class Record(Generic[R]):
    """A row for each validation, in ``progress.csv`` and in ``tensorboard/``."""

    def __init__(self, out: FilePath, resumed_at: int | None, row: type[R]) -> None:
        """Begin, or go on after ``resumed_at`` steps: TensorBoard drops later events."""
        from torch.utils.tensorboard import SummaryWriter

        self.rows: list[R] = []
        self._file = out / "progress.csv"
        self._row: type[R] = row
        purge = None if resumed_at is None else resumed_at + 1
        writer: Any = SummaryWriter
        self._writer = writer(str(out / "tensorboard"), purge_step=purge)

    def add(self, row: R) -> None:
        """One more row, written at once."""
        self.rows.append(row)
        self._write()
        for name, value in row._asdict().items():
            if math.isfinite(value):
                self._writer.add_scalar(f"train/{name}", value, int(row.steps))

    def snapshot(self) -> list[dict[str, float]]:
        """The rows as plain data."""
        return [row._asdict() for row in self.rows]

    def restore(self, saved: Iterable[dict[str, float]]) -> None:
        """Go on from these rows; later ones are dropped."""
        self.rows[:] = [self._row(**row) for row in saved]
        if self.rows:
            self._write()
        else:
            self._file.unlink(missing_ok=True)

    def flush(self) -> None:
        """Bring TensorBoard's events to disk."""
        self._writer.flush()

    def close(self) -> None:
        """Close TensorBoard's file."""
        self._writer.close()

    def _write(self) -> None:
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(self._row._fields)
        table.writerows([f"{value:.8g}" for value in row] for row in self.rows)
        write_text(self._file, text.getvalue())


def check_progress(config: TrainConfig, rows: Sequence[TrainRow], largest_reward: float) -> None:
    """Stop a training that can lead nowhere.

    Args:
        config: the training.
        rows: the record so far, the last row new.
        largest_reward: largest absolute reward of a step so far.

    Raises:
        TrainingDiverged: a reward or a loss is not finite, the values are beyond anything the
            reward can add up to, or the action, unless it is parameters, stays at a limit.
    """
    row = rows[-1]
    if not math.isfinite(largest_reward):
        raise TrainingDiverged(
            f"a reward is {largest_reward}; look for a zero divisor, or the logarithm or root of a "
            "negative number, in the terms of problem.task"
        )
    if row.updates < config.agent.first_actor_update:
        return
    if not all(math.isfinite(value) for value in (row.actor_loss, row.critic_loss, row.q_mean)):
        raise TrainingDiverged(
            f"loss is not finite after {row.updates:.0f} updates; try a smaller agent.learning_rate"
        )
    bound = _MARGIN * _largest_return(config, largest_reward)
    if abs(row.q_mean) > bound:
        raise TrainingDiverged(
            f"mean Q is {row.q_mean:.3g}, beyond anything the reward can add up to "
            f"({bound:.3g}); try a smaller agent.learning_rate or agent.gamma"
        )
    stuck = [r.saturated_share > _STUCK_SHARE for r in rows[-_STUCK_ROWS:]]
    # A parameter may be best at a bound; a steering that stays at a limit drives nowhere.
    if len(stuck) == _STUCK_ROWS and all(stuck) and config.problem.action != "parameters":
        raise TrainingDiverged(
            f"the action sat at a limit for {100 * _STUCK_SHARE:g} % of the last "
            f"{_STUCK_ROWS * config.validation.interval} steps; try a smaller "
            "agent.learning_rate, or other reward coefficients"
        )


def _largest_return(config: TrainConfig, largest_reward: float) -> float:
    """What no return exceeds: the largest reward forever."""
    return max(1.0, largest_reward) / (1.0 - config.agent.gamma)


def alarms(config: TrainConfig, rows: Sequence[TrainRow], largest_reward: float) -> tuple[str, ...]:
    """What gives reason to doubt a training that goes on; the parameters of check_progress."""
    row, best = rows[-1], min(rows, key=lambda one: one.validation_error_mm)
    error, bound = row.validation_error_mm, _largest_return(config, largest_reward)
    found = {
        f"the validation error is {three_digits(error)} mm; after {best.steps:.0f} steps it was "
        f"{three_digits(best.validation_error_mm)} mm": error > _WORSE * best.validation_error_mm,
        f"{100 * row.saturated_share:.0f} % of the actions sit at a limit": row.saturated_share
        > _AT_LIMIT,
        f"mean Q is {row.q_mean:.3g}, the reward adds up to {bound:.3g} at most": abs(row.q_mean)
        > bound,
    }
    return tuple(words for words, alarming in found.items() if alarming)


def load_training(folder: FilePath) -> TrainResult:
    """The result of a training from its folder, whichever version wrote it.

    Raises:
        DataError: there is no record or no policy, or one of them cannot be read.
        ConfigError: ``config.yaml`` holds no training.
    """
    config = build(TrainConfig, read_yaml(folder / "config.yaml"))
    return learned(folder, config, TrainRow)
