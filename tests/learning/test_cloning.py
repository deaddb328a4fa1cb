"""A policy cloned from data that were recorded: Minari datasets and recordings of drives."""

from __future__ import annotations

import csv
import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.config import build, merge
from steersman.controllers.policy import Policy
from steersman.errors import ConfigError, DataError
from steersman.learning.datasets import store
from steersman.learning.datasets.trajectory import Who
from steersman.learning.imitation.config import ImitationConfig
from steersman.learning.imitation.driving import demonstrate
from steersman.learning.imitation.imitate import imitate
from steersman.learning.imitation.sources import samples
from steersman.logs.write import write_episode
from steersman.paths.random_road import RandomRoad
from steersman.rollout import RunConfig, run

from ..loops import drive

ROADS = [
    {"kind": "random_road", "seed": seed, "distance": 250.0, "min_radius": 25.0} for seed in (1, 2)
]
CLONE: dict[str, Any] = {
    "problem": {
        "action": "direct",
        "roads": ROADS,
        "speeds": [{"kind": "random_profile", "low": 6.0, "high": 11.0}],
        "demonstration": {"controller": {"kind": "mpc_pid", "scheduled": True, "r": 1.0}},
        "spread": {"offset": 0.3, "heading": 0.05},
        "episode_time": 8.0,
    },
    "method": "bc",
    "rounds": 2,
    "fit": {"hidden": [32, 32], "batch": 128, "updates": 6000},
    "validation": {"roads": [{"kind": "random_road", "seed": 1000}], "vehicles": 4},
}


def config(**changes: Any) -> ImitationConfig:
    return build(ImitationConfig, merge(CLONE, changes))


def rows(folder: FilePath) -> list[dict[str, float]]:
    with (folder / "progress.csv").open(encoding="utf-8") as stream:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(stream)]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """MPC-PID on two roads, with a little noise."""
    problem = config().problem
    stored = store.Stored(problem, demonstrate(problem, 6000, 0, sigma=0.03), "mpc_pid")
    return store.write(tmp_path_factory.mktemp("minari"), "mpc_pid", stored)


@pytest.fixture(scope="module")
def clone(dataset: FilePath, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Fitted to the dataset alone."""
    folder = tmp_path_factory.mktemp("clone")
    told: list[str] = []
    imitate(config(data=str(dataset)), folder, notify=told.append)
    drives = len(store.read(str(dataset)).trajectories)
    assert told == [f"6000 steps of {drives} drives, 100% by demonstrator: {dataset}"]
    return folder


def follows(folder: FilePath) -> None:
    """The policy follows a road that it has not seen."""
    episode = drive(
        Policy(file=str(folder / "policy.onnx")),
        RandomRoad(seed=77, distance=200.0, min_radius=25.0),
        duration=60.0,
    )
    assert episode.end == "end_of_path"
    assert np.mean(np.abs(episode["lateral_error"])) < 0.25


def test_a_clone_of_a_dataset_follows(clone: FilePath) -> None:
    follows(clone)
    last = rows(clone)[-1]
    assert last["validation_failures"] == 0
    assert last["validation_rms_mm"] < 300.0
    assert last["action_difference"] < 0.05


def test_what_is_written_of_a_clone(clone: FilePath, dataset: FilePath) -> None:
    told = rows(clone)
    assert [row["steps"] for row in told] == [3000, 6000]
    assert np.isnan(told[0]["action_difference"])
    assert {row["demo_share"] for row in told} == {1.0}
    training = json.loads((clone / "policy.json").read_text())["training"]
    assert training["data"] == [str(dataset)]
    assert (training["method"], training["label"]) == ("bc", "demonstrated")
    assert training["simulated_seconds"] == pytest.approx(300.0)
    assert not {"demonstrator", "demonstrator_validation"} & set(training)


def test_the_same_data_give_the_same_clone(
    clone: FilePath, dataset: FilePath, tmp_path: FilePath
) -> None:
    def stop(_: dict[str, float]) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        imitate(config(data=str(dataset)), tmp_path, stop)
    told: list[str] = []
    imitate(config(data=str(dataset)), tmp_path, resume=True, notify=told.append)
    assert told[-1].startswith("6000 steps of ")
    assert (tmp_path / "policy.onnx").read_bytes() == (clone / "policy.onnx").read_bytes()


def test_which_action_is_learned(dataset: FilePath) -> None:
    stored = store.read(str(dataset))
    one = stored.trajectories[0]
    shown = samples(stored.problem, one, "demonstrated").actions[:, 0]
    done = samples(stored.problem, one, "executed").actions[:, 0]
    assert shown == pytest.approx(one.demonstrated_steer, abs=1e-7)
    assert done == pytest.approx(one.steer, abs=1e-7)
    assert np.std(shown - done) > 0.01
    nobody = one._replace(demonstrated_steer=np.full(one.steps, np.nan))
    assert np.array_equal(samples(stored.problem, nobody, "demonstrated").actions[:, 0], done)
    # The same drive in terms of another action and another encoding.
    indirect = config(problem={"action": "rate", "encoding": "waypoints"}).problem
    rates = samples(indirect, one, "executed").actions[:, 0]
    last = np.concatenate((one.rows[:1, 5], one.steer[:-1]))
    wanted = np.clip((one.steer - last) / (0.05 * indirect.rate_limit), -1.0, 1.0)
    assert rates == pytest.approx(wanted, abs=1e-7)


def test_a_recorded_driver_is_cloned(tmp_path: FilePath) -> None:
    """Somebody drives, an MCAP file is all that is left of it, and a network does the same."""
    names = []
    for k, road in enumerate(ROADS):
        run_config = build(
            RunConfig,
            {
                "path": road,
                "speed": {"kind": "constant_speed", "speed": 8.0},
                "sensor": {"position_noise": 0.15, "heading_noise": 0.02},
                "controller": {"kind": "mpc_pid", "scheduled": True, "r": 1.0},
                "seed": k,
            },
        )
        file = tmp_path / f"drive_{k}.mcap"
        write_episode(file, run(run_config), run_config.vehicle.table, run_config.path)
        names.append(str(file))
    told: list[str] = []
    imitate(config(data=names), tmp_path / "clone", notify=told.append)
    assert "100% by recorded" in told[0]
    follows(tmp_path / "clone")


def test_the_drivers_of_a_mixed_dataset_are_told(dataset: FilePath, tmp_path: FilePath) -> None:
    stored = store.read(str(dataset))
    half = [
        one._replace(driver=np.where(np.arange(one.steps) % 2 == 0, Who.OWN, one.driver))
        for one in stored.trajectories
    ]
    mixed = [one._replace(driver=one.driver.astype(np.int8)) for one in half]
    place = store.write(tmp_path, "mixed", stored._replace(trajectories=mixed))
    told: list[str] = []
    tiny = {"hidden": [8, 8], "batch": 16, "updates": 10}
    out = tmp_path / "out"
    imitate(config(data=[str(place)], rounds=1, fit=tiny), out, notify=told.append)
    assert "50% by own, 50% by demonstrator" in told[0]
    assert rows(out)[0]["demo_share"] == pytest.approx(0.5, abs=0.01)


def test_data_go_with_behaviour_cloning(dataset: FilePath) -> None:
    with pytest.raises(ConfigError, match="data: learning from data is behaviour cloning"):
        config(data=str(dataset), method="dagger")
    with pytest.raises(ConfigError, match="label: 'own' is not allowed"):
        config(data=str(dataset), label="own")
    alone = config(data=str(dataset), problem={"demonstration": {"enabled": False}})
    assert alone.data == (str(dataset),)


def test_wrong_data_leave_the_folder_alone(clone: FilePath) -> None:
    before = sorted(path.name for path in clone.iterdir())
    with pytest.raises(DataError, match="nowhere: no Minari dataset"):
        imitate(config(data="nowhere"), clone, overwrite=True)
    assert sorted(path.name for path in clone.iterdir()) == before
