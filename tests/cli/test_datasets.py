"""``export --to minari`` and ``imitate data=``, as a user meets them."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path as FilePath

import pytest
from typer.testing import Result

from steersman.cli import dataset
from steersman.learning.datasets import store
from steersman.learning.datasets.trajectory import Who, steps
from steersman.logs.write import write_episode
from steersman.vehicles import CarlaModel3

from ..logs import bags

Steersman = Callable[..., Result]
TINY = """
problem:
  action: direct
  roads: [{kind: random_road, seed: 1, distance: 200}]
  speeds: [{kind: random_profile, low: 6, high: 9}]
  demonstration: {controller: {kind: mpc_pid, scheduled: true}}
  episode_time: 4
"""
SMALL = ("fit.hidden=[8,8]", "fit.updates=40", "fit.batch=16", "rounds=1", "method=bc")


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Demonstrations of a few seconds."""
    monkeypatch.setattr(dataset, "STEPS", 320)
    monkeypatch.delenv("MINARI_DATASETS_PATH", raising=False)


def test_demonstrations_exported_and_cloned(steersman: Steersman, tmp_path: FilePath) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    result = steersman("export", "tiny.yaml", "--to", "minari", "--out", "sets")
    assert result.stdout == "sets/tiny-v0\n"
    assert "320 steps of " in result.stderr
    assert "minari.load_dataset('tiny-v0')" in result.stderr
    stored = store.read("sets/tiny-v0")
    assert steps(stored.trajectories) == 320
    assert stored.source.startswith("mpc_pid with noise of 0.1")
    words = ("tiny.yaml", "data=sets/tiny-v0", *SMALL, "--out", "clone")
    result = steersman("imitate", *words)
    assert result.exit_code == 0
    assert "100% by demonstrator: sets/tiny-v0" in result.stderr
    assert "\n1/1 rounds: RMS error " in result.stderr
    assert result.stdout == "clone/policy.onnx\n"
    # A training's folder names its configuration, too.
    assert steersman("export", "clone", "--to", "minari", "--out", "sets").exit_code == 0
    assert store.read("sets/clone-v0").problem == stored.problem


def test_minaris_own_folder_is_respected(
    steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "home"))
    result = steersman("export", "tiny.yaml", "--to", "minari")
    assert result.stdout == f"{tmp_path}/home/tiny-v0\n"
    assert os.listdir(tmp_path / "home") == ["tiny-v0"]
    result = steersman("imitate", "tiny.yaml", "data=[tiny-v0]", *SMALL, "--out", "clone")
    assert result.exit_code == 0
    result = steersman("export", "tiny.yaml", "--to", "minari", "--out", "elsewhere")
    assert result.stdout == "elsewhere/tiny-v0\n"
    monkeypatch.delenv("MINARI_DATASETS_PATH")
    assert steersman("export", "tiny.yaml", "--to", "minari").stdout == "tiny_minari/tiny-v0\n"


def test_what_a_training_kept_is_what_is_exported(steersman: Steersman, tmp_path: FilePath) -> None:
    words = ("agent.hidden=[8,8]", "agent.vehicles=2", "agent.updates=1", "agent.batch=16")
    checks = ("validation.vehicles=1", "steps=60", "keep=true")
    (tmp_path / "tiny.yaml").write_text(TINY)
    assert steersman("train", "tiny.yaml", *words, *checks, "--out", "kept").exit_code == 0
    assert steersman("export", "kept", "--to", "minari", "--out", "sets").exit_code == 0
    stored = store.read("sets/kept-v0")
    assert stored.source == "training by ddpg"
    assert steps(stored.trajectories) == 60


def test_drives_and_recordings(steersman: Steersman, tmp_path: FilePath) -> None:
    drive = ("drive", "path=double_lane_change", "speed=constant_speed", "speed.speed=10")
    steersman(*drive, "--out", "runs/first", "--mcap", "first.mcap")
    assert steersman("export", "runs/first", "--to", "minari", "--out", "a").exit_code == 0
    assert steersman("export", "first.mcap", "--to", "minari", "--out", "b").exit_code == 0
    (one,), (other,) = (store.read(f"{x}/first-v0").trajectories for x in "ab")
    assert set(one.driver.tolist()) == {Who.DEMONSTRATOR}
    assert one.steer.tolist() == other.steer.tolist()
    assert abs(one.rows - other.rows).max() < 1e-9
    assert store.read("a/first-v0").source == "mpc_pid"
    words = ("data=[a/first-v0,first.mcap,runs/first]", *SMALL, "--out", "clone")
    result = steersman("imitate", *words)
    assert f"{3 * one.steps} steps of 3 drives, 67% by demonstrator, 33% by rec" in result.stderr


def test_a_recording_of_others(steersman: Steersman, tmp_path: FilePath) -> None:
    messages = bags.drive(60)
    messages += [
        ("/cmd", "autoware_control_msgs/msg/Lateral", ns, bags.lateral(ns, 0.075))
        for _, _, ns, _ in bags.drive(60)
    ]
    ring = bags.path(10**18, [(float(i), 0.0) for i in range(30)])
    messages.append(("/plan", "nav_msgs/msg/Path", 10**18, ring))
    bags.write(tmp_path, messages).rename(tmp_path / "human.mcap")
    result = steersman("export", "human.mcap", "--to", "minari", "--out", "sets")
    assert "steering is normalised as that of carla_model3" in result.stderr
    assert store.read("sets/human-v0").source == "recorded driver"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("export no --to minari --out o", "unknown preset 'no'"),
        ("export folder --to minari --out o", "folder: neither a drive (episode.npz) nor a train"),
        ("export bad.mcap --to minari --out o", "bad.mcap: cannot be read as a ROS 2 recording"),
        ("export tiny.yaml --to minari --out full", "full/tiny-v0: is there already; remove it"),
        ("export run.mcap --to minari --out o", "run.mcap: the episode does not say which vehicle"),
        ("imitate tiny.yaml data=no --out o", "data: learning from data is behaviour cloning"),
        ("imitate tiny.yaml data=no method=bc --out o", "no: no Minari dataset, neither a folder"),
        ("imitate tiny.yaml data=bad.mcap method=bc --out o", "bad.mcap: cannot be read as a ROS"),
        ("imitate tiny.yaml data=3 method=bc --out o", "data: 3 is not a list"),
    ],
)
@pytest.mark.usefixtures("wrong_files")
def test_wrong_words(
    steersman: Steersman, tmp_path: FilePath, words: str, expected: str, episode: object
) -> None:
    (tmp_path / "bad.mcap").write_bytes(b"no recording")
    (tmp_path / "tiny.yaml").write_text(TINY)
    (tmp_path / "full" / "tiny-v0").mkdir(parents=True)
    write_episode(tmp_path / "run.mcap", episode, CarlaModel3().table)  # type: ignore[arg-type]
    result = steersman(*words.split())
    assert result.exit_code == 2
    assert expected in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.fixture(scope="module")
def episode() -> object:
    """A run that does not say what was driven."""
    import numpy as np

    from steersman.episode import COLUMNS, Episode

    return Episode({name: np.zeros(5) for name in COLUMNS}, "laps", 1.0, 0.05, 9.0, True)


def test_without_the_extra(steersman: Steersman, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "minari", None)
    result = steersman("export", "demo", "--to", "minari")
    assert "this needs the extra 'minari': pip install " in result.stderr
    assert "'.[minari]' in a source checkout" in result.stderr
    assert result.exit_code == 2
