"""``steersman train ... seeds=0..4``: the same training with several seeds, over the cores."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import typer

from steersman.cli.outcome import USER_ERROR, fail, interrupted
from steersman.cli.output import note, show, steps_bars, table, write
from steersman.errors import three_digits

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.parallel import TrainingEvent
    from steersman.learning.progress import TrainRow
    from steersman.learning.seeds import TrainedSeeds


def train_seeds(
    config: TrainConfig,
    chosen: Sequence[int],
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
    import steersman as sm
    from steersman.learning.seeds import name_of
    from steersman.seed_folders import seed_folder

    names = [name_of(seed) for seed in chosen]
    try:
        with steps_bars(config.steps, names) as update:
            texts = dict.fromkeys(names, "")

            def tell(event: TrainingEvent) -> None:
                name = event.job.name
                if event.note is not None:
                    note(event.note)
                if event.row is not None:
                    texts[name] = progress_text(event.row)
                if event.steps is not None:
                    update(name, event.steps, texts[name], event.row is not None)

            result = sm.train(
                config,
                out=folder,
                seeds=chosen,
                listener=tell,
                engine=engine,
                jobs=jobs,
                overwrite=overwrite,
                resume=resume,
            )
    except KeyboardInterrupt:
        folders = [seed_folder(folder, seed) for seed in chosen]
        raise interrupted(folder, folders, "the last checkpoints") from None
    _summary(result)
    for seed, fault in result.failed.items():
        fail(f"{name_of(seed)}: {fault}")
    if result.failed:
        raise typer.Exit(USER_ERROR)


def progress_text(row: TrainRow) -> str:
    """A row of ``progress.csv`` in a few words."""
    score = (
        ""
        if math.isnan(row.validation_score)
        else f"score {row.validation_score:.4g} (less is better), "
    )
    return (
        f"reward {row.reward_mean:.3g}, error {three_digits(row.validation_error_mm)} mm, {score}"
        f"off track {row.off_track_resets:.0f}"
    )


def _summary(result: TrainedSeeds) -> None:
    """Validation error of each seed's best policy, the best of all marked."""
    out = table("seed", "error [mm]", "failures", "steps", "", right=("error [mm]", "failures"))
    best = result.best if result.trainings else None
    for seed in sorted([*result.trainings, *result.failed]):
        training = result.trainings.get(seed)
        if training is None:
            out.add_row(str(seed), "-", "-", "-", "failed")
            continue
        row = training.best
        out.add_row(
            str(seed),
            f"{row.validation_error_mm:.4g}",
            f"{row.validation_failures:.0f}",
            f"{row.steps:.0f}",
            "best" if training is best else "",
        )
    show(out)
    if best is not None:
        write(f"best policy: {best.policy}\n")
