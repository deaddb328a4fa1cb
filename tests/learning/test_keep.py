"""What a training does, kept as a dataset: all of it, also over a kill; nothing else changes."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.learning.config import TrainConfig
from steersman.learning.datasets import store
from steersman.learning.datasets.trajectory import Trajectory, Who, features, steps
from steersman.learning.running import RunningTraining
from steersman.learning.train import _Training, train

from .problems import RESIDUAL, tiny

P_ACTION = {"kind": "constant", "at": 0.4}
STEPS = 800


def config(**changes: Any) -> TrainConfig:
    demonstration = {"p_action": P_ACTION}
    problem = {"demonstration": demonstration, "episode_time": 2.0, **changes.pop("problem", {})}
    return tiny(**{"problem": problem, "checkpoint_interval": 300, "steps": STEPS, **changes})


def kept(folder: FilePath) -> list[Trajectory]:
    return store.read(str(folder / "data")).trajectories


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """A training that nothing stopped."""
    folder = tmp_path_factory.mktemp("kept")
    train(config(keep=True), folder)
    return folder


def test_every_step_is_there_and_who_drove(done: FilePath) -> None:
    found = kept(done)
    assert steps(found) == STEPS
    who = np.concatenate([one.driver for one in found])
    assert set(who.tolist()) == {Who.OWN, Who.DEMONSTRATOR}
    assert np.mean(who) == pytest.approx(0.4, abs=0.05)
    for one in found:
        shown = one.driver == Who.DEMONSTRATOR
        assert np.array_equal(one.actions[~shown], one.own[~shown])
        assert one.actions[shown] == pytest.approx(one.demonstrated[shown], abs=1e-7)
        assert np.all(np.isfinite(one.own) & np.isfinite(one.demonstrated))
    own = np.concatenate([one.own - one.actions for one in found])
    assert np.std(own[who == Who.DEMONSTRATOR]) > 0.01
    assert store.read(str(done / "data")).source == "training by ddpg"
    assert sorted(path.name for path in (done / "data").iterdir()) == ["training-v0"]


def test_it_is_what_the_replay_buffer_holds(tmp_path: FilePath) -> None:
    """The buffer learns from executed actions in the states that were kept."""
    state = RunningTraining(tmp_path, 0, STEPS, None)
    training = _Training(config(keep=True), tmp_path, lambda _: None, state)
    training.run()
    buffer = training.agent.replay_buffer  # type: ignore[attr-defined]
    position = buffer.pos
    problem = training.config.problem
    found = kept(tmp_path)
    sought = {row.tobytes() for row in buffer.observations[:position].reshape(position * 4, -1)}
    seen = np.concatenate([features(problem, one.rows, one.steer)[:-1] for one in found])
    assert {row.tobytes() for row in seen} == sought
    actions = np.concatenate([one.actions[:, 0] for one in found]).astype(np.float32)
    stored = buffer.actions[:position].ravel()
    assert np.array_equal(np.sort(actions), np.sort(stored))
    rewards = np.concatenate([one.rewards for one in found]).astype(np.float32)
    assert np.array_equal(np.sort(rewards), np.sort(buffer.rewards[:position].ravel()))
    assert sum(one.terminated for one in found) == training.env.off_track


def test_keeping_changes_nothing_else(done: FilePath, tmp_path: FilePath) -> None:
    train(config(), tmp_path)
    assert (tmp_path / "policy.onnx").read_bytes() == (done / "policy.onnx").read_bytes()
    assert not (tmp_path / "data").exists()


class Stopped(Exception):
    pass


def test_a_killed_training_keeps_the_same(done: FilePath, tmp_path: FilePath) -> None:
    def reporter(row: Any) -> None:
        raise Stopped

    with pytest.raises(Stopped):
        train(config(keep=True), tmp_path, reporter)
    train(config(keep=True), tmp_path, resume=True)
    again, whole = kept(tmp_path), kept(done)
    assert len(again) == len(whole)
    for one, other in zip(again, whole, strict=True):
        for name in Trajectory._fields:
            assert np.array_equal(
                getattr(one, name), getattr(other, name), equal_nan=name not in {"driver"}
            ), name
    assert not (tmp_path / "data" / "parts").exists()


@pytest.mark.parametrize(
    "changes",
    [
        {
            "agent": {"kind": "ppo", "hidden": [16, 16], "vehicles": 4, "n_steps": 64, "batch": 64},
            "problem": {"demonstration": {"p_action": {"kind": "constant", "at": 0.0}}},
        },
        {"problem": {**RESIDUAL, "demonstration": {"enabled": False}}},
    ],
    ids=["ppo", "residual-alone"],
)
def test_agents_whom_nobody_shows(tmp_path: FilePath, changes: dict[str, Any]) -> None:
    train(config(keep=True, **changes), tmp_path)
    found = kept(tmp_path)
    assert steps(found) >= STEPS
    for one in found:
        assert set(one.driver.tolist()) == {Who.OWN}
        assert np.array_equal(one.own, one.actions)


def test_overwriting_forgets_the_data(done: FilePath, tmp_path: FilePath) -> None:
    train(config(keep=True, steps=600), tmp_path)
    first = steps(kept(tmp_path))
    train(config(keep=True, steps=900), tmp_path, overwrite=True)
    assert (first, steps(kept(tmp_path))) == (600, 900)
