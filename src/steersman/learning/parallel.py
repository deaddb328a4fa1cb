"""Several trainings at a time, each in a process of its own.

Stable-Baselines3 draws from generators of the whole process, so trainings that shared one would
not repeat.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from steersman.engine.jobs import Workers
from steersman.engine.work import Job, Tell
from steersman.errors import DataError, SteersmanError
from steersman.files import make_folder
from steersman.learning.checkpoint import check_folder, is_finished
from steersman.learning.config import TrainConfig
from steersman.learning.progress import TrainRow

TRAINING = ("steersman.learning.train", "stable_baselines3", "torch.utils.tensorboard")
"""What a process imports that trains."""


class TrainingJob(NamedTuple):
    """A training and the folder it goes to."""

    name: str
    config: TrainConfig
    out: FilePath


class TrainingEvent(NamedTuple):
    """A message from a running training."""

    job: TrainingJob
    steps: float | None = None
    """Environment steps done."""
    row: TrainRow | None = None
    """The new row of ``progress.csv``, at a validation."""
    note: str | None = None


class _Order(NamedTuple):
    training: TrainingJob
    overwrite: bool
    resume: bool
    until: int | None


def train_all(
    trainings: Sequence[TrainingJob],
    at_once: int | None,
    listener: Callable[[TrainingEvent], None],
    *,
    engine: str | None = None,
    overwrite: bool = False,
    resume: bool = False,
    until: int | None = None,
) -> dict[str, str]:
    """Run all trainings, ``at_once`` at a time; the reasons of those that failed, by name.

    A training that fails does not stop the others. If this function is left by an exception
    (Ctrl-C), or its process dies, all trainings stop; ``resume`` goes on with them.

    Args:
        trainings: trainings with different names and folders. With a Ray cluster, all of its
            nodes need to see the folders.
        at_once: trainings at a time; None: one for each core.
        listener: called with what happens in the trainings.
        engine: of :class:`steersman.engine.jobs.Workers`.
        overwrite: whether earlier trainings in the folders are replaced.
        resume: whether trainings go on from their last checkpoints; what is finished is not begun.
        until: stop all of them with a checkpoint after so many steps; None: at their ends.

    Raises:
        DataError: a folder holds a training already.
        ConfigError: a training to be resumed has another configuration, or there is no such engine.
    """
    by_name = {each.name: each for each in trainings}
    threads = max((each.config.threads for each in trainings), default=1)
    with Workers(engine, at_once, apart=True, threads=threads, needs=TRAINING) as workers:
        for each in trainings:
            check_folder(each.config, each.out, overwrite=overwrite, resume=resume)
        jobs = []
        for each in trainings:
            if resume and is_finished(each.config, each.out):
                note = f"{each.out}: finished already"
                listener(TrainingEvent(each, steps=float(each.config.steps), note=note))
                continue
            out = make_folder(each.out).resolve()
            jobs.append(Job(each.name, _Order(each._replace(out=out), overwrite, resume, until)))
        failed: dict[str, str] = {}

        def tell(name: str, event: dict[str, Any]) -> None:
            listener(TrainingEvent(by_name[name], **event))

        for outcomes in workers.outcomes(_train, jobs, listener=tell):
            for name, _, error in outcomes:
                if error is not None:
                    failed[name] = _reason(error, by_name[name].out)
    return failed


def _train(order: _Order, tell: Tell) -> None:
    from steersman.learning.train import train

    (_, config, out), overwrite, resume, until = order
    if not out.is_dir():
        raise DataError(f"{out}: not on this machine; all nodes need to see the folder")
    train(
        config,
        out,
        lambda row: tell({"steps": row.steps, "row": row}),
        tick=lambda steps: tell({"steps": steps}),
        notify=lambda text: tell({"note": text}),
        overwrite=overwrite,
        resume=resume,
        until=until,
    )


def _reason(error: Exception, out: FilePath) -> str:
    """Why a training failed, in a line; the traceback of an unexpected error goes to ``out``."""
    if isinstance(error, SteersmanError):
        return str(error)
    log = out / "traceback.txt"
    log.write_text("\n".join(error.__notes__), encoding="utf-8")
    return f"{type(error).__name__}: {error} (see {log})"
