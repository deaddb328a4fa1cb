"""Agents and networks are trained."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from steersman.api.driving import Folder
from steersman.commands import Notify, Word, configuration

if TYPE_CHECKING:
    from steersman.learning.imitation.imitate import ImitationResult
    from steersman.learning.progress import ImitationRow, TrainRow
    from steersman.learning.task import Judged
    from steersman.learning.train import TrainResult


def train(
    *words: Word,
    out: Folder,
    reward: Callable[[Judged], float] | None = None,
    overwrite: bool = False,
    resume: bool = False,
    progress: Callable[[TrainRow], None] | None = None,
    tick: Callable[[int], None] | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> TrainResult:
    """Train an agent while a controller demonstrates; ``result.policy`` is the policy's file.

    ``sm.train("demo", "agent.gamma=0.9", steps=100_000, out="runs/agent")``

    Args:
        words: a preset or a YAML file, assignments, components, or a ``TrainConfig``.
        out: folder for policy, record, checkpoints and logs.
        reward: a further term of the reward as a Python function of each judged step.
        overwrite: whether an earlier training in ``out`` is replaced.
        resume: go on from the last checkpoint in ``out``.
        progress: called at every validation with the new row of ``progress.csv``.
        tick: called about twice a second with the environment steps done.
        notify: called with a sentence where something is to be said.
        settings: fields of a training (``steersman show train``).

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed, or ``out`` holds a training already.
        TrainingDiverged: losses or values are no longer finite or plausible.
    """
    from steersman.learning.train import train as run

    chosen = configuration("train", words, settings, notify)
    if reward is not None:
        chosen = chosen.rewarded(reward)
    return run(
        chosen,
        FilePath(out),
        progress,
        tick=tick,
        notify=notify,
        overwrite=overwrite,
        resume=resume,
    )


def imitate(
    *words: Word,
    out: Folder,
    overwrite: bool = False,
    resume: bool = False,
    progress: Callable[[ImitationRow], None] | None = None,
    tick: Callable[[float], None] | None = None,
    notify: Notify | None = None,
    **settings: Any,
) -> ImitationResult:
    """Fit a network to a controller's actions; ``result.policy`` is the policy's file.

    ``sm.imitate("precision", "problem.demonstration.controller=mpc_delay", out="runs/dagger")``

    Args:
        words: a training's preset or a YAML file, assignments, or an ``ImitationConfig``.
        out: folder for policy, record and logs.
        overwrite: whether an earlier training in ``out`` is replaced.
        resume: go on from the last round in ``out``.
        progress: called after every round with the new row of ``progress.csv``.
        tick: called now and then with the rounds done.
        notify: called with a sentence where something is to be said.
        settings: fields of an imitation (``steersman show imitate``).

    Raises:
        ConfigError: a word or a value is unknown or not allowed.
        DataError: a file is missing or malformed, or ``out`` holds a training already.
        TrainingDiverged: the loss is no longer finite.
    """
    from steersman.learning.imitation.imitate import imitate as run

    chosen = configuration("imitate", words, settings, notify)
    return run(
        chosen,
        FilePath(out),
        progress,
        tick=tick,
        notify=notify,
        overwrite=overwrite,
        resume=resume,
    )
