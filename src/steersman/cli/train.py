"""``steersman train``: an agent that learns while a controller demonstrates."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from steersman import files
from steersman.cli import seeds, settings
from steersman.cli.outcome import interrupted
from steersman.cli.output import animated, note, steps_bar, write
from steersman.errors import ConfigError
from steersman.ranges import split_seeds

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig
    from steersman.learning.progress import TrainResult, TrainRow

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman train demo --out runs/agent\n"
    "  steersman train demo steps=100000 seed=1 agent.gamma=0.9 --out runs/agent\n"
    "  steersman train runs/agent/config.yaml seed=2 --out runs/agent2\n"
    "  steersman train demo seeds=0..4 --out runs/five\n"
    "  steersman train --out runs/agent --resume\n"
    "  steersman train demo plant=carla plant.port=2000 --out runs/carla\n"
    "\n"
    "What can be set: steersman show train"
)


def train(
    out: settings.Out,
    overwrite: settings.Overwrite = False,
    resume: settings.Resume = False,
    jobs: settings.Jobs = None,
    engine: settings.Engine = None,
    words: settings.PresetWords = None,
) -> None:
    """Train an agent and export its policy.

    Writes config.yaml, progress.csv, TensorBoard logs, checkpoints/, and the best policy so far
    as policy.onnx with its card policy.json. seeds=0..4 (or 0,3,7) trains with each of them,
    in processes of their own, into DIR/seed_0 and so on.
    """
    chosen, words = split_seeds(words or [])
    for option, value in (("--jobs", jobs), ("--engine", engine)):
        if value is not None and chosen is None:
            raise ConfigError(f"{option}: there is one training; it goes with seeds=0..4")
    import steersman as sm
    from steersman.api.driving import announce
    from steersman.api.resuming import resumed

    if resume and not overwrite:
        words, chosen = resumed(FilePath(out), words, chosen, note)
    config = sm.configure("train", *words, notify=note)
    announce(config.problem.plant, note, [config.problem.vehicle])
    folder = files.out_folder(out)
    if chosen is not None:
        seeds.train_seeds(
            config,
            chosen,
            folder,
            engine=engine,
            jobs=jobs,
            overwrite=overwrite,
            resume=resume,
        )
        return
    try:
        result = train_with_bar(config, folder, overwrite=overwrite, resume=resume)
    except KeyboardInterrupt:
        raise interrupted(folder, [folder], "the last checkpoint") from None
    write(f"{result.policy}\n")


def train_with_bar(
    config: TrainConfig, folder: FilePath, *, overwrite: bool, resume: bool = False
) -> TrainResult:
    """Train, and show reward, tracking error, off-track resets and the time left on stderr."""
    import steersman as sm

    with steps_bar(config.steps, "training") as update:
        text = "training"

        def tell(row: TrainRow) -> None:
            nonlocal text
            text = seeds.progress_text(row)
            update(row.steps, text)

        def tick(steps: int) -> None:
            update(steps, text)

        return sm.train(
            config,
            out=folder,
            progress=tell,
            tick=tick if animated() else None,
            notify=note,
            overwrite=overwrite,
            resume=resume,
        )
