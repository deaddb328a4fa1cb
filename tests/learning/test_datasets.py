"""Drives as data: what the policy saw, what was done, and the same again out of files."""

from __future__ import annotations

import json
import os
import shutil
import socket
from pathlib import Path as FilePath
from typing import Any

import minari
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steersman.config import build
from steersman.episode import Episode
from steersman.errors import ConfigError, DataError
from steersman.kernels import world as kernel
from steersman.learning.datasets import replay, source, store
from steersman.learning.datasets.recorder import Recorder
from steersman.learning.datasets.trajectory import Trajectory, Who, actions_for, features, steps
from steersman.learning.env import PathFollowingEnv
from steersman.learning.fleet import FleetDriver
from steersman.learning.imitation.driving import demonstrate
from steersman.learning.problem import Problem
from steersman.logs.write import write_episode
from steersman.network_file import PolicyNetwork
from steersman.rollout import RunConfig, run

from ..logs import bags
from ..loops import random_policy
from .problems import RESIDUAL, problem, tiny

HISTORY = {"kind": "extended", "history": 3, "waypoints": 4}
PROBLEMS: dict[str, dict[str, Any]] = {
    "rate": {},
    "direct": {"action": "direct", "encoding": "waypoints"},
    "history": {"encoding": HISTORY, "sensor": {"error_range": 0.1}},
    "residual": RESIDUAL,
}


def drives(wanted: Problem, n: int = 3, count: int = 130) -> tuple[list[Trajectory], list[Any]]:
    """Recorded drives under random actions, and the inputs that each vehicle's policy had."""
    driver = FleetDriver(wanted, n)
    recorder, rng = Recorder(driver), np.random.default_rng(4)
    driver.seed(7)
    for i in range(n):
        driver.reset(i)
    inputs: list[list[Any]] = [[driver.fleet.inputs[i].astype(np.float32)] for i in range(n)]
    finished = []
    for _ in range(count):
        actions = rng.uniform(-0.3, 0.3, (n, 1))
        recorder.choose(actions, actions, np.zeros(n))
        driver.step(actions)
        recorder.stepped()
        for i in range(n):
            inputs[i].append(driver.fleet.inputs[i].astype(np.float32))
        for i in np.flatnonzero(driver.fleet.ended != kernel.RUNNING).tolist():
            finished.append(np.array(inputs[i]))
            driver.reset(i)
            inputs[i] = [driver.fleet.inputs[i].astype(np.float32)]
    return recorder.take(), finished + [np.array(rows) for rows in inputs if len(rows) > 1]


@pytest.mark.parametrize("name", PROBLEMS)
def test_features_are_those_that_the_policy_had(name: str) -> None:
    wanted = problem(**PROBLEMS[name])
    recorded, inputs = drives(wanted)
    assert steps(recorded) == 3 * 130
    assert len(recorded) == len(inputs) > 3
    for one, seen in zip(recorded, inputs, strict=True):
        assert np.array_equal(features(wanted, one.rows, one.steer), seen)


@pytest.mark.parametrize("name", PROBLEMS)
def test_actions_lead_to_the_steering(name: str) -> None:
    wanted = problem(**PROBLEMS[name])
    recorded, _ = drives(wanted)
    for one in recorded:
        inside = np.abs(one.steer) < 1.0
        again = actions_for(wanted, one.rows, one.steer, one.steer)
        assert again[inside] == pytest.approx(one.actions[inside], abs=1e-9)
        demonstrated = actions_for(wanted, one.rows, one.steer, one.demonstrated_steer)
        assert demonstrated == pytest.approx(one.demonstrated, abs=1e-9)


def test_episodes_end_as_the_environment_says() -> None:
    wanted = problem(corridor=0.4, spread={"offset": 0.35})
    recorded, _ = drives(wanted)
    assert {one.terminated for one in recorded} == {True, False}
    for one in recorded:
        assert (abs(one.places[-1, 0]) > 0.4) == one.terminated
        assert np.all(np.abs(one.places[:-1, 0]) <= 0.4)


def test_demonstrations() -> None:
    wanted = problem()
    recorded = demonstrate(wanted, 400, 3, vehicles=4)
    assert steps(recorded) == 400
    again = demonstrate(wanted, 400, 3, vehicles=4)
    other = demonstrate(wanted, 400, 4, vehicles=4)
    assert all(np.array_equal(a.rows, b.rows) for a, b in zip(recorded, again, strict=True))
    assert not np.array_equal(recorded[0].rows, other[0].rows)
    for one in recorded:
        assert set(one.driver.tolist()) == {Who.DEMONSTRATOR}
        assert np.all(np.isnan(one.own))
    gaps = np.concatenate([one.actions - one.demonstrated for one in recorded])
    assert 0.05 < np.std(gaps) < 0.3  # the noise
    exact = demonstrate(wanted, 40, 3, vehicles=4, sigma=0.0)
    assert all(np.array_equal(one.actions, one.demonstrated) for one in exact)
    with pytest.raises(ConfigError, match="is false; set it to true"):
        demonstrate(problem(demonstration={"enabled": False}), 40, 0)


# ---------------------------------------------------------------------------------------- Minari


@pytest.fixture(scope="module")
def stored() -> store.Stored:
    """A few short demonstrations."""
    wanted = problem()
    return store.Stored(wanted, demonstrate(wanted, 300, 0, vehicles=3), "mpc_pid")


@pytest.fixture(scope="module")
def dataset(stored: store.Stored, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """The demonstrations as Minari."""
    return store.write(tmp_path_factory.mktemp("minari"), "my drives!", stored)


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever wants the network fails."""

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)


def same(one: Trajectory, other: Trajectory) -> None:
    for name in Trajectory._fields:
        a, b = getattr(one, name), getattr(other, name)
        if name == "actions":
            assert np.array_equal(a.astype(np.float32), b.astype(np.float32))
        elif name == "terminated":
            assert a == b
        else:
            assert np.array_equal(a, b, equal_nan=name != "driver"), name
            assert a.dtype == b.dtype, name


def test_minari_round_trip(stored: store.Stored, dataset: FilePath) -> None:
    again = store.read(str(dataset))
    assert again.problem == stored.problem
    assert again.source == "mpc_pid"
    for one, other in zip(stored.trajectories, again.trajectories, strict=True):
        same(one, other)


def test_minari_loads_it(
    stored: store.Stored, dataset: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(dataset.parent))
    assert list(minari.list_local_datasets()) == ["my_drives-v0"]
    loaded = minari.load_dataset("my_drives-v0")
    assert (loaded.total_episodes, loaded.total_steps) == (len(stored.trajectories), 300)
    env = PathFollowingEnv(stored.problem)
    assert loaded.observation_space == env.observation_space
    assert loaded.action_space == env.action_space
    recovered = loaded.recover_environment()
    assert recovered.unwrapped.problem == stored.problem
    for episode, one in zip(loaded, stored.trajectories, strict=True):
        assert episode.observations.dtype == np.float32
        assert np.array_equal(episode.observations, features(stored.problem, one.rows, one.steer))
        assert np.array_equal(episode.actions, one.actions.astype(np.float32))
        assert np.array_equal(episode.rewards, one.rewards)
        assert not np.any(episode.terminations[:-1] | episode.truncations[:-1])
        assert bool(episode.terminations[-1]) != bool(episode.truncations[-1])
        told = episode.infos
        assert np.array_equal(told["demonstrated_action"][:-1], one.demonstrated)
        assert np.isnan(told["demonstrated_action"][-1, 0])
        assert told["driver"][:, 0].tolist() == [Who.DEMONSTRATOR] * one.steps + [-1]
        assert np.array_equal(told["lateral_error"][:, 0], one.places[:, 0])
    told = loaded.storage.metadata["steersman"]
    assert told["drivers"]["1"] == "demonstrator"
    assert len(told["observation"]) == env.observation_space.shape[0]


def test_a_stored_transition_is_one_of_the_environment(stored: store.Stored) -> None:
    env = PathFollowingEnv(stored.problem)
    first, _ = env.reset(seed=5)
    recorder = Recorder(env.driver)
    recorder.choose(np.array([0.2]), np.array([np.nan]), np.array([Who.OWN]))
    second, reward, *_ = env.step(np.array([0.2]))
    recorder.stepped()
    (one,) = recorder.take()
    assert np.array_equal(features(stored.problem, one.rows, one.steer), [first, second])
    assert one.rewards.tolist() == [reward]


def test_datasets_are_found_by_folder_and_by_id(
    dataset: FilePath, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert store.locate(str(dataset)) == dataset
    assert store.locate(str(dataset.parent)) == dataset
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(dataset.parent))
    assert store.locate("my_drives-v0") == dataset
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "elsewhere"))
    with pytest.raises(DataError, match=r"my_drives-v0: no Minari dataset, neither .*elsewhere"):
        store.locate("my_drives-v0")
    shutil.copytree(dataset, tmp_path / "two" / "a-v0")
    shutil.copytree(dataset, tmp_path / "two" / "b-v0")
    with pytest.raises(DataError, match="holds several datasets, name one: a-v0, b-v0"):
        store.locate(str(tmp_path / "two"))
    assert store.root({}) == FilePath.home() / ".minari" / "datasets"


def test_a_dataset_is_never_replaced(stored: store.Stored, dataset: FilePath) -> None:
    before = sorted(os.walk(dataset.parent))
    with pytest.raises(DataError, match="my_drives-v0: is there already; remove it"):
        store.write(dataset.parent, "my drives!", stored)
    assert sorted(os.walk(dataset.parent)) == before


def damage(place: FilePath, kind: str) -> None:
    metadata = place / "data" / "metadata.json"
    if kind == "json":
        metadata.write_text("{")
    elif kind == "foreign":
        told = json.loads(metadata.read_text())
        del told["steersman"]
        metadata.write_text(json.dumps(told))
    elif kind == "problem":
        told = json.loads(metadata.read_text())
        told["steersman"]["problem"]["sensr"] = 1
        metadata.write_text(json.dumps(told))
    elif kind == "file":
        part = next(place.glob("data/0/*.arrow"))
        part.write_bytes(part.read_bytes()[: part.stat().st_size // 2])
    else:
        shutil.rmtree(place / "data" / "1")


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("json", "cannot be read as a Minari dataset"),
        ("foreign", "is no dataset of Steersman: its observations are not known"),
        ("problem", "its problem: sensr: unknown field; did you mean 'sensor'?"),
        ("file", "data/0/part-0.arrow is missing, damaged or was changed"),
        ("episode", "data/1/part-0.arrow is missing, damaged or was changed"),
    ],
)
def test_damaged_datasets(dataset: FilePath, tmp_path: FilePath, kind: str, words: str) -> None:
    place = tmp_path / "bad"
    shutil.copytree(dataset, place)
    damage(place, kind)
    with pytest.raises(DataError) as caught:
        store.read(str(place))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@settings(max_examples=30, deadline=10_000)
@given(which=st.integers(0, 100), place=st.floats(0.0, 1.0), changes=st.binary(max_size=9))
def test_whatever_is_done_to_the_bytes(
    dataset: FilePath,
    tmp_path_factory: pytest.TempPathFactory,
    which: int,
    place: float,
    changes: bytes,
) -> None:
    """Arrow aborts the whole process on some of these, which is why files have digests."""
    folder = tmp_path_factory.mktemp("damaged") / "x"
    shutil.copytree(dataset, folder)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    file = files[which % len(files)]
    data = file.read_bytes()
    at = int(place * len(data))
    file.write_bytes(data[:at] + changes + data[at + len(changes) :])
    told = ""
    try:
        store.read(str(folder))
    except DataError as error:
        told = str(error)
    assert "\n" not in told


# ------------------------------------------------------------------------------- out of recordings


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, FilePath, Episode]:
    """A policy of random weights drives: its file, and the run."""
    training = tiny(problem={"action": "direct", "encoding": HISTORY})
    folder = tmp_path_factory.mktemp("policy")
    file = random_policy(folder, training)
    config = build(
        RunConfig,
        {
            "controller": {"kind": "policy", "file": str(file)},
            "path": {"kind": "random_road", "seed": 1},
            "speed": {"kind": "constant_speed", "speed": 8.0},
            "duration": 6.0,
            "corridor": 20.0,
        },
    )
    episode = run(config)
    episode.save(folder / "episode.npz")
    write_episode(folder / "run.mcap", episode, config.vehicle.table, config.path)
    return training.problem, folder, episode


def answers(wanted: Problem, folder: FilePath, one: Trajectory) -> Any:
    scale = wanted.layout.scale  # which is part of the exported network
    seen = (features(wanted, one.rows, one.steer)[:-1] / scale).astype(np.float32)
    network = PolicyNetwork((folder / "policy.onnx").read_bytes(), "policy", seen.shape[1])
    return np.array([network(row[None, :])[0] for row in seen])


def test_an_episode_is_seen_as_its_policy_saw_it(
    driven: tuple[Problem, FilePath, Episode],
) -> None:
    wanted, folder, episode = driven
    (one,) = source.load(wanted, [str(folder / "episode.npz")])
    assert np.array_equal(one.steer, episode["steer_command"][:-1])
    assert answers(wanted, folder, one) == pytest.approx(one.steer, abs=1e-6)
    assert np.ptp(one.steer) > 0.01
    assert set(one.driver.tolist()) == {Who.OWN}
    assert np.array_equal(one.own, one.actions)
    assert one.places[:, 0] == pytest.approx(episode["lateral_error"], abs=1e-9)
    assert one.places[:, 2] == pytest.approx(episode["s"], abs=1e-6)
    assert source.load(wanted, [str(folder)])[0].steer.tolist() == one.steer.tolist()


def test_a_recording_is_seen_as_the_policy_saw_it(
    driven: tuple[Problem, FilePath, Episode],
) -> None:
    wanted, folder, episode = driven
    (one,) = source.load(wanted, [str(folder / "run.mcap")])
    # Only the path's spline lies between; its points are a metre apart.
    assert answers(wanted, folder, one) == pytest.approx(episode["steer_command"][:-1], abs=2e-3)
    assert one.steer == pytest.approx(episode["steer_command"][:-1], abs=1e-7)
    assert set(one.driver.tolist()) == {Who.RECORDED}
    assert np.all(np.isnan(one.own)) and np.all(np.isnan(one.demonstrated))  # noqa: PT018


def test_rewards_are_the_environments() -> None:
    wanted = build(
        Problem,
        {
            "roads": [{"kind": "circle", "radius": 40.0}],
            "speeds": [{"kind": "constant_speed", "speed": 8.0}],
        },
    )
    (one,) = demonstrate(wanted, 60, 0, vehicles=1, sigma=0.0)
    config = build(
        RunConfig,
        {
            "controller": "mpc_pid",
            "path": {"kind": "circle", "radius": 40.0},
            "speed": {"kind": "constant_speed", "speed": 8.0},
            "start": one.places[0, 2],
            "duration": 3.05,
        },
    )
    episode = run(config)
    again = replay.of_episode(wanted, episode, config.path)
    assert set(again.driver.tolist()) == {Who.DEMONSTRATOR}
    assert again.steer == pytest.approx(one.steer, abs=1e-9)
    assert again.rewards == pytest.approx(one.rewards, abs=1e-9)
    assert again.rows == pytest.approx(one.rows, abs=1e-6)


def foreign(folder: FilePath, *, gap: bool = False, path: bool = True, command: bool = True) -> Any:
    """A person drives a circle of 40 m at 20 Hz, told by Autoware's messages at other times."""
    messages = bags.drive(120)
    if gap:
        messages = messages[:40] + messages[70:]
    if path:
        ring = [(40.0 * np.sin(a), 40.0 * (1.0 - np.cos(a))) for a in np.linspace(0.0, 3.0, 120)]
        messages.append(("/plan", "nav_msgs/msg/Path", 10**18, bags.path(10**18, ring)))
    if command:
        for k in range(300):
            ns = 10**18 + 100_000_000 + k * 20_000_000
            told = bags.control(ns, 0.075 + 0.001 * (k % 2))
            messages.append(("/cmd", "autoware_control_msgs/msg/Control", ns, told))
    return bags.write(folder, messages)


def test_a_person_as_demonstrator(tmp_path: FilePath) -> None:
    wanted = problem()
    (one,) = source.load(wanted, [str(foreign(tmp_path))])
    assert one.steps == 117  # from the first command on
    assert one.places[:, 0] == pytest.approx(np.zeros(118), abs=1e-3)
    assert one.rows[5:, 6] == pytest.approx(np.full(113, 1.0 / 40.0), abs=1e-3)
    angles = [wanted.vehicle.steer_for_wheel_angle(a, 8.0) for a in (0.075, 0.076)]
    assert min(angles) - 1e-6 <= one.steer.min() <= one.steer.max() <= max(angles) + 1e-6
    assert set(one.driver.tolist()) == {Who.RECORDED}
    assert one.rows[1:, 5] == pytest.approx(one.steer)  # without a measured angle


def test_the_centre_of_mass_of_who_told_of_the_rear_axle(tmp_path: FilePath) -> None:
    file = str(foreign(tmp_path))
    (rear,), (ahead,) = (source.load(problem(), [file], ahead=x) for x in (0.0, 1.5))
    # It goes around on a wider circle, and sideways.
    wider = np.hypot(40.0, 1.5) - 40.0
    assert ahead.places[:, 0] == pytest.approx(np.full(118, -wider), abs=2e-3)
    assert ahead.rows[:, 3] == pytest.approx(rear.rows[:, 3] + 1.5 * 0.2)
    assert ahead.steer.tolist() == rear.steer.tolist()


def test_a_gap_begins_a_new_drive(tmp_path: FilePath) -> None:
    found = source.load(problem(), [str(foreign(tmp_path, gap=True))])
    assert [one.steps for one in found] == [37, 49]


@pytest.mark.parametrize(
    ("lacks", "words"),
    [
        ("path", "holds no nav_msgs/msg/Path; its topics: /cmd"),
        ("command", "holds no steering command (autoware_control_msgs"),
    ],
)
def test_recordings_that_say_too_little(tmp_path: FilePath, lacks: str, words: str) -> None:
    file = foreign(tmp_path, **{lacks: False})
    with pytest.raises(DataError) as caught:
        source.load(problem(), [str(file)])
    assert words in str(caught.value)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"plant": {"dt": 0.1}}, "problem.plant.dt: 0.1, but the data were recorded with 0.05"),
        ({"sensor": {"spacing": 1.5}}, "problem.sensor.spacing: 1.5, but the data were"),
        ({"vehicle": "bmw_320i"}, "problem.vehicle.max_wheel_angle: 1.066, but the data are of"),
        ({"sensor": {"count": 30}}, "holds 15 waypoints, problem.sensor.count is 30"),
    ],
)
def test_data_of_another_problem(dataset: FilePath, change: Any, words: str) -> None:
    with pytest.raises((ConfigError, DataError)) as caught:
        source.load(problem(**change), [str(dataset)])
    assert words in str(caught.value)
    assert str(dataset) in str(caught.value)
