"""The files that the pages name. A page that names another one needs a line here."""

from __future__ import annotations

import shutil
from pathlib import Path as FilePath

from typer.testing import CliRunner

from steersman import tuned
from steersman.cli import app
from steersman.config import build, override, to_yaml
from steersman.episode import load_episode
from steersman.learning.config import load_preset, train_config
from steersman.learning.imitation.config import ImitationConfig
from steersman.logs.write import write_episode
from steersman.rollout import RunConfig
from steersman.vehicles import CarlaModel3

from .pages import ROOT, blocks

POLICY = ROOT / "src" / "steersman" / "policies" / "precision.onnx"
# Folders of trainings (or imitations), of trainings with several seeds, of tunings, of drives.
TRAININGS = (
    "agent",
    "agent2",
    "dagger",
    "residual",
    "mpc_weights",
    "joint",
    "demo/training",
    "bc",
    "mine",
)
SEEDS = ("five", "five_td3")
TUNINGS = ("tune", "tuned", "tune_pid", "stanley")
DRIVES = ("monza_mpc", "monza_agent", "first")


def make(folder: FilePath) -> None:
    """Write them all."""
    runs = folder / "runs"
    for name in (*TRAININGS, *(f"{name}/seed_{k}" for name in SEEDS for k in range(2))):
        (runs / name).mkdir(parents=True, exist_ok=True)
        for suffix in (".onnx", ".json"):
            shutil.copy(POLICY.with_suffix(suffix), runs / name / f"policy{suffix}")
    (runs / "agent" / "config.yaml").write_text(to_yaml(train_config(load_preset("demo"))))
    (runs / "dagger" / "config.yaml").write_text(to_yaml(ImitationConfig()))
    gains = tuned.locate("tuned/pid")
    assert gains is not None
    for name in TUNINGS:
        (runs / name).mkdir()
        shutil.copy(gains, runs / name / "tuned.yaml")
    config = build(RunConfig, override({}, ["path=monza", "controller=mpc_pid"]))
    (runs / "monza").mkdir()
    (runs / "monza" / "config.yaml").write_text(to_yaml(config))
    for number, name in enumerate(("my_road.csv", "messung.csv", "fahrt.csv")):
        (folder / name).write_text(shown("your_road.md", "text", number))
    (folder / "my_driver.py").write_text(shown("demonstration.md", "python"))
    for name in ("my_car.yaml", "car.yaml"):
        (folder / name).write_text(shown("your_car.md", "yaml"))
    for number, name in enumerate(("my_suite.yaml", "my_test.yaml"), start=1):
        (folder / name).write_text(shown("your_car.md", "yaml", number))
    for name in ("DIR", "my_maps"):
        steersman("path", "export", "circle", "--to", str(folder / name / "map.xodr"))
    for name in DRIVES:
        steersman("drive", "duration=2", "--out", str(runs / name))
    words = ("--controllers", "lqr,pid", "--jobs", "1", "--out", str(runs / "bench"))
    steersman("bench", "quick", *words)
    driven = load_episode(runs / "first" / "episode.npz")
    write_episode(folder / "run.mcap", driven, CarlaModel3().table)


def shown(page: str, language: str, number: int = 0) -> str:
    """A block of a language on a page, the first: what a reader would write into a file."""
    found = [b for b in blocks(ROOT / "docs" / page) if b.language == language]
    return found[number].body + "\n"


def steersman(*words: str) -> None:
    """Run a command that must succeed."""
    result = CliRunner().invoke(app, list(words), prog_name="steersman", catch_exceptions=False)
    assert result.exit_code == 0, result.output
