"""``steersman imitate``: a network that does what a controller does."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from steersman import files
from steersman.cli import settings
from steersman.cli.outcome import interrupted
from steersman.cli.output import animated, note, steps_bar, write

if TYPE_CHECKING:
    from steersman.learning.imitation.config import ImitationConfig
    from steersman.learning.imitation.imitate import ImitationResult
    from steersman.learning.progress import ImitationRow

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman imitate precision problem.demonstration.controller=mpc_delay --out runs/dagger\n"
    "  steersman imitate demo method=bc noise.at=0.1 steps=100000 --out runs/bc\n"
    "  steersman imitate runs/dagger/config.yaml fit.hidden=[256,256] --out runs/wide\n"
    "  steersman imitate --out runs/dagger --resume\n"
    "  steersman imitate demo method=bc data=human.mcap --out runs/driver\n"
    "  steersman imitate demo plant=carla plant.port=2000 steps=20000 --out runs/carla\n"
    "\n"
    "What can be set: steersman show imitate"
)


def imitate(
    out: settings.Out,
    overwrite: settings.Overwrite = False,
    resume: settings.Resume = False,
    words: settings.PresetWords = None,
) -> None:
    """Fit a network to a controller's actions, by DAgger or behaviour cloning.

    The controller is problem.demonstration.controller. Of a training's preset or configuration,
    problem, validation, seed, trim and threads are taken. Writes what steersman train writes.
    """
    import steersman as sm
    from steersman.api.driving import announce
    from steersman.api.resuming import resumed

    words = words or []
    if resume and not overwrite:
        words, _ = resumed(FilePath(out), words, None)
    config = sm.configure("imitate", *words, notify=note)
    announce(config.problem.plant, note, [config.problem.vehicle])
    folder = files.out_folder(out)
    try:
        result = imitate_with_bar(config, folder, overwrite=overwrite, resume=resume)
    except KeyboardInterrupt:
        raise interrupted(folder, [folder], "the last round") from None
    write(f"{result.policy}\n")


def imitate_with_bar(
    config: ImitationConfig, folder: FilePath, *, overwrite: bool, resume: bool
) -> ImitationResult:
    """Imitate, and show tracking error and the time left on stderr."""
    import steersman as sm

    # Data have no steps that are driven: there rounds are counted.
    steps, noun = (1, "rounds") if config.data else (config.round_steps * config.vehicles, "steps")
    with steps_bar(steps * config.rounds, "imitation", noun) as update:
        text = "imitation"

        def tell(row: ImitationRow) -> None:
            nonlocal text
            text = progress_text(row)
            done = row.steps
            if config.data:
                done = round(row.updates * config.rounds / config.fit.updates)
            update(done, text)

        def tick(rounds: float) -> None:
            update(rounds * steps, text)

        return sm.imitate(
            config,
            out=folder,
            progress=tell,
            tick=tick if animated() else None,
            notify=note,
            overwrite=overwrite,
            resume=resume,
        )


def progress_text(row: ImitationRow) -> str:
    """A row of ``progress.csv`` in a few words."""
    return (
        f"RMS error {row.validation_rms_mm:.4g} mm, failed {row.validation_failures:.0f}, "
        f"steering change {row.steer_activity:.4f}, loss {row.loss:.3g}"
    )
