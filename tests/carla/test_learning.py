"""Training on the server: the same rewards, hundreds of steps, policies that drive."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import torch

from steersman.config import build, merge
from steersman.kernels import vehicle as car
from steersman.learning.config import TrainConfig
from steersman.learning.env import PathFollowingEnv
from steersman.learning.fleet import FleetDriver
from steersman.learning.problem import Problem
from steersman.learning.progress import TrainRow
from steersman.learning.train import train
from steersman.learning.validate import Validator
from steersman.plants.carla import CarlaConfig
from steersman.rollout import run

from .conftest import left_behind, running

PROBLEM: dict[str, Any] = {
    "roads": [{"kind": "circle", "radius": 40.0}, {"kind": "random_road", "seed": 1}],
    "speeds": [{"kind": "random_profile", "low": 5.0, "high": 12.0}],
    "episode_time": 4.0,
    "spread": {"offset": 0.3, "heading": 0.05},
}


def problem(plant: Any, **changes: Any) -> Problem:
    return build(Problem, merge(PROBLEM, {"plant": plant, **changes}))


def follow(driver: FleetDriver, steps: int) -> list[Any]:
    """Rewards, features, demonstrations and ends under the same actions, from one seed."""
    driver.seed(3)
    driver.reset(0)
    rows = []
    for u in np.random.default_rng(0).uniform(-0.3, 0.3, steps):
        driver.step(np.array([u]))
        fleet = driver.fleet
        parts = (fleet.reward[0], fleet.inputs[0], fleet.demo, fleet.ended.astype(float))
        rows.append([part.copy() for part in parts])
        if fleet.ended[0]:
            driver.reset(0)
    return rows


def test_rewards_are_the_simulators_for_the_same_actions(carla: CarlaConfig) -> None:
    server = FleetDriver(problem(carla), 1)
    try:
        found = follow(server, 200)
    finally:
        server.close()
    expected = follow(FleetDriver(problem("simulator"), 1), 200)
    ends = [row[3][0] for row in expected]
    assert [row[3][0] for row in found] == ends
    assert len(set(ends)) > 1  # some left the corridor, or time was up
    # Features magnify the lateral error, by 100 where it is small.
    for column, tolerance in enumerate((1e-3, 1e-3, 1e-4)):
        apart = [np.abs(a[column] - b[column]).max() for a, b in zip(found, expected, strict=True)]
        assert max(apart) < tolerance, column


def test_a_delay_that_differs_from_episode_to_episode(carla: CarlaConfig) -> None:
    """Commands are held back here, in whole control periods."""
    words = {"spread": {"delay": 0.15, "offset": 0.1, "heading": 0.0}, "episode_time": 1.5}
    server = FleetDriver(problem(carla, **words), 1)
    try:
        delays, moved = [], []
        server.seed(1)
        for _ in range(4):
            server.reset(0)
            delays.append(int(server.fleet.delay[0]))
            before = server.fleet.state[0, car.STEER]
            steers = []
            for _ in range(6):
                server.step(np.array([0.8]))
                steers.append(server.fleet.state[0, car.STEER])
            moved.append(int(np.argmax(np.abs(np.array(steers) - before) > 1e-3)))
    finally:
        server.close()
    assert moved == delays
    assert len(set(delays)) > 1


TRAIN: dict[str, Any] = {
    "agent": {
        "hidden": [16, 16],
        "batch": 32,
        "buffer": 2000,
        "vehicles": 1,
        "updates": 1,
        "learning_starts": 100,
    },
    "validation": {
        "roads": [{"kind": "random_road", "seed": 1000, "distance": 100.0}],
        "vehicles": 2,
        "interval": 150,
    },
    "steps": 300,
    "checkpoint_interval": 200,
}


def test_hundreds_of_steps_of_training_and_the_policy_drives(
    carla: CarlaConfig, raw: Any, tmp_path: FilePath
) -> None:
    task = merge(PROBLEM, {"plant": carla, "episode_time": 2.0})
    rows: list[TrainRow] = []
    config = build(TrainConfig, {**TRAIN, "problem": task})
    try:
        policy = train(config, tmp_path / "out", rows.append).policy
    finally:
        torch.set_flush_denormal(False)
    assert [row.steps for row in rows] == [150, 300]
    assert rows[-1].updates == pytest.approx(200, abs=1)
    assert left_behind(raw) == (False, 0)
    driver = {"kind": "policy", "file": str(policy)}
    words: dict[str, Any] = {"controller": driver, "duration": 1.0}
    assert len(run(running(plant=carla, **words))) == len(run(running(**words)))


def test_a_resumed_training_goes_on_to_the_bit(carla: CarlaConfig, tmp_path: FilePath) -> None:
    """From a checkpoint within an episode, between two validations."""
    words = {**TRAIN, "steps": 160, "checkpoint_interval": 95}
    words["agent"] = {**TRAIN["agent"], "learning_starts": 40}
    words["validation"] = {**TRAIN["validation"], "interval": 70, "vehicles": 1}
    task = merge(PROBLEM, {"plant": carla, "episode_time": 4.0})
    config = build(TrainConfig, {**words, "problem": task})
    try:
        train(config, tmp_path / "whole")
        train(config, tmp_path / "parts", until=95)
        train(config, tmp_path / "parts", resume=True)
    finally:
        torch.set_flush_denormal(False)
    whole, parts = (
        np.load(next((tmp_path / name / "checkpoints").glob("*160*")))
        for name in ("whole", "parts")
    )
    assert whole.files == parts.files
    assert all((whole[name] == parts[name]).all() for name in whole.files)


def test_validation_is_the_simulators(carla: CarlaConfig) -> None:
    """One drive after the other on the server, all at once in the kernel."""
    config = build(TrainConfig, {**TRAIN, "problem": PROBLEM}).validation
    driver = FleetDriver(problem(carla, episode_time=2.0), 1)

    def act(inputs: Any) -> Any:
        return np.tanh(inputs[:, 1])

    try:
        found = Validator(driver.problem, config, driver.mover.shared).score(act)
    finally:
        driver.close()
    expected = Validator(problem("simulator", episode_time=2.0), config).score(act)
    assert found == pytest.approx(expected, abs=1e-4)


def test_the_gymnasium_environment(carla: CarlaConfig, raw: Any) -> None:
    env = PathFollowingEnv(problem(carla))
    try:
        observation, info = env.reset(seed=5)
        assert env.observation_space.contains(observation)
        for _ in range(5):
            observation, reward, ended, cut, info = env.step(np.zeros(1, np.float32))
        assert np.isfinite(reward)
        assert not ended
        assert not cut
        assert info["speed"] > 1.0
    finally:
        env.close()
    assert left_behind(raw) == (False, 0)
