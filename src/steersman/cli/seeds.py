"""``steersman train ... seeds=0..4``: the same training with several seeds, over the cores."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import typer

from steersman.cli.outcome import USER_ERROR, fail, interrupted
from steersman.cli.output import note, show, steps_bars, table, write

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.parallel import TrainingEvent, TrainingJob
    from steersman.learning.progress import TrainResult, TrainRow


def train_seeds(
    config: TrainConfig,
    seeds: Sequence[int],
    folder: FilePath,
    *,
    engine: str | None = None,
    jobs: int | None = None,
    overwrite: bool,
    resume: bool,
) -> None:
    """Train with each seed into ``seed_N`` of the folder, and say how each of them did.

    Raises:
        typer.Exit: one of them failed, or Ctrl-C.
    """
    from steersman.learning.parallel import TrainingJob, train_all

    tasks = [
        TrainingJob(f"seed {s}", config.model_copy(update={"seed": s}), folder / f"seed_{s}")
        for s in seeds
    ]
    try:
        with steps_bars(config.steps, [job.name for job in tasks]) as update:
            texts = dict.fromkeys((job.name for job in tasks), "")

            def tell(event: TrainingEvent) -> None:
                name = event.job.name
                if event.note is not None:
                    note(event.note)
                if event.row is not None:
                    texts[name] = progress_text(event.row)
                if event.steps is not None:
                    update(name, event.steps, texts[name], event.row is not None)

            failed = train_all(tasks, jobs, tell, engine=engine, overwrite=overwrite, resume=resume)
    except KeyboardInterrupt:
        raise interrupted(folder, [job.out for job in tasks], "the last checkpoints") from None
    _summary(tasks, failed)
    for name, fault in failed.items():
        fail(f"{name}: {fault}")
    if failed:
        raise typer.Exit(USER_ERROR)


def progress_text(row: TrainRow) -> str:
    """A row of ``progress.csv`` in a few words."""
    return (
        f"reward {row.reward_mean:.3g}, error {row.validation_error_mm:.3g} mm, "
        f"off track {row.off_track_resets:.0f}"
    )


def _summary(tasks: Sequence[TrainingJob], failed: dict[str, str]) -> None:
    """Validation error of each seed's best policy, the best of all marked."""
    from steersman.learning.progress import load_training

    out = table("seed", "error [mm]", "failures", "steps", "", right=("error [mm]", "failures"))
    results = {job.name: load_training(job.out) for job in tasks if job.name not in failed}
    best = min(results, key=lambda name: _score(results[name]), default=None)
    for job in tasks:
        result = results.get(job.name)
        if result is None:
            out.add_row(str(job.config.seed), "-", "-", "-", "failed")
            continue
        out.add_row(
            str(job.config.seed),
            f"{result.best.validation_error_mm:.4g}",
            f"{result.best.validation_failures:.0f}",
            f"{result.best.steps:.0f}",
            "best" if job.name == best else "",
        )
    show(out)
    if best is not None:
        write(f"best policy: {results[best].policy}\n")


def _score(result: TrainResult) -> float:
    """What selects the best policy [m]; smaller is better."""
    return float(result.card.training["validation"]["total"])
