"""``steersman imitate``: what it takes from presets and files, what it prints, interruption."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import Result

from steersman.config import build, to_yaml
from steersman.learning.config import TrainConfig, load_preset
from steersman.learning.imitation.config import ImitationConfig
from steersman.learning.progress import ImitationRow

Steersman = Callable[..., Result]


@pytest.fixture
def imitated(monkeypatch: pytest.MonkeyPatch) -> list[ImitationConfig]:
    """What was asked for; nothing is learned."""
    asked: list[ImitationConfig] = []

    def imitate(
        config: ImitationConfig, out: FilePath, reporter: Any, notify: Any, **_: Any
    ) -> SimpleNamespace:
        asked.append(config)
        notify("pid itself")
        scores = {"validation_rms_mm": 30.25, "validation_failures": 1.0, "steer_activity": 0.0051}
        reporter(ImitationRow(steps=800.0, loss=0.00125, **scores))
        return SimpleNamespace(policy=out / "policy.onnx")

    monkeypatch.setattr("steersman.learning.imitation.imitate.imitate", imitate)
    return asked


def test_a_preset_of_a_training_gives_what_both_have(
    steersman: Steersman, imitated: list[ImitationConfig]
) -> None:
    result = steersman("imitate", "precision", "steps=1600", "seed=4", "--out", "new")
    assert (result.exit_code, result.stdout) == (0, "new/policy.onnx\n")
    assert result.stderr == (
        "pid itself\n"
        "800/1600 steps: RMS error 30.25 mm, failed 1, steering change 0.0051, loss 0.00125\n"
    )
    preset = build(TrainConfig, load_preset("precision"))
    asked = imitated[0]
    assert (asked.problem, asked.validation) == (preset.problem, preset.validation)
    assert (asked.trim, asked.seed, asked.steps) == (preset.trim, 4, 1600)


@pytest.mark.parametrize("kind", [TrainConfig, ImitationConfig])
def test_a_file_of_either_kind(
    steersman: Steersman, imitated: list[ImitationConfig], tmp_path: FilePath, kind: Any
) -> None:
    (tmp_path / "mine.yaml").write_text(to_yaml(kind(seed=3, trim=0.5)))
    assert steersman("imitate", "mine.yaml", "rounds=4", "--out", "new").exit_code == 0
    assert imitated == [ImitationConfig(seed=3, trim=0.5, rounds=4)]


def test_resuming_needs_no_words(
    steersman: Steersman, imitated: list[ImitationConfig], tmp_path: FilePath
) -> None:
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "config.yaml").write_text(to_yaml(ImitationConfig(seed=3)))
    assert steersman("imitate", "--out", "new", "--resume").exit_code == 0
    assert imitated == [ImitationConfig(seed=3)]


def test_interrupted(
    steersman: Steersman, monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
) -> None:
    def imitate(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("steersman.learning.imitation.imitate.imitate", imitate)
    result = steersman("imitate", "--out", "new")
    assert result.exit_code == 130
    nothing = "interrupted before the first checkpoint: there is nothing to resume in new\n"
    assert result.stderr == nothing
    (tmp_path / "new" / "resume").mkdir(parents=True)
    (tmp_path / "new" / "resume" / "step_000000001.npz").touch()
    told = steersman("imitate", "--out", "new").stderr
    assert told == "interrupted; --resume goes on from the last round in new\n"
