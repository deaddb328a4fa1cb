"""``steersman train``: an agent that learns while a controller demonstrates."""

from __future__ import annotations

import sys
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steersman.cli import settings
from steersman.cli.outcome import INTERRUPTED
from steersman.cli.output import note, steps_bar, write

if TYPE_CHECKING:
    from steersman.learning.config import TrainConfig

EXAMPLES = (
    "\b\n"
    "Examples:\n"
    "  steersman train demo --out runs/agent\n"
    "  steersman train demo steps=100000 seed=1 agent.gamma=0.9 --out runs/agent\n"
    "  steersman train runs/agent/config.yaml seed=2 --out runs/agent2\n"
    "\n"
    "What can be set: steersman show train"
)


def train(
    out: Annotated[
        str, typer.Option("--out", metavar="DIR", help="Folder for policy, record and logs.")
    ],
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an earlier training in DIR.")
    ] = False,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[PRESET | CONFIG.yaml] [key=value ...]",
            help="A preset or a YAML file, and settings over it.",
        ),
    ] = None,
) -> None:
    """Train an agent and export its policy.

    Writes config.yaml, progress.csv, TensorBoard logs, checkpoints/, and the best policy so far
    as policy.onnx with its card policy.json.
    """
    tree = read(words or [])

    from steersman.learning.train import train_config

    config = train_config(tree)
    folder = settings.out_folder(out)
    try:
        policy = train_with_bar(config, folder, overwrite=overwrite)
    except KeyboardInterrupt:
        note(f"interrupted; what was learned until the last validation is in {folder}")
        raise typer.Exit(INTERRUPTED) from None
    write(f"{policy}\n")


def read(words: list[str]) -> dict[str, Any]:
    """The preset or file, with the assignments laid over it.

    Raises:
        ConfigError: there is no such preset, or the words contradict each other.
        DataError: the file is missing or no YAML.
    """
    name, assignments = settings.split(words)
    if name is None or _is_file(name):
        return settings.read(words)

    from steersman.config import override
    from steersman.learning.train import load_preset

    return override(load_preset(name), assignments)


def _is_file(name: str) -> bool:
    file = FilePath(name)
    return file.suffix in {".yaml", ".yml"} or file.name != name or file.exists()


def train_with_bar(config: TrainConfig, folder: FilePath, *, overwrite: bool) -> FilePath:
    """Train, and show reward, tracking error, off-track resets and the time left on stderr."""
    from steersman.learning.train import train as run

    with steps_bar(config.steps, "training") as update:
        text = "training"

        def tell(row: dict[str, float]) -> None:
            nonlocal text
            text = _progress_text(row)
            update(row["steps"], text)

        def tick(steps: int) -> None:
            update(steps, text)

        in_terminal = sys.stderr.isatty()
        return run(config, folder, tell, tick=tick if in_terminal else None, overwrite=overwrite)


def _progress_text(row: dict[str, float]) -> str:
    return (
        f"reward {row['reward_mean']:.3g}, error {row['validation_error_mm']:.3g} mm, "
        f"off track {row['off_track_resets']:.0f}"
    )
