"""The Gymnasium environment: its contract, its determinism, how episodes begin and end."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

from steersman.errors import ConfigError
from steersman.learning.demonstration import demonstrated_action
from steersman.learning.env import PathFollowingEnv
from steersman.types import Command

from ..loops import DT
from .problems import RESIDUAL, SMALL, problem

SETTINGS: dict[str, dict[str, Any]] = {
    "rate": {},
    "direct": {"action": "direct"},
    "paper": {"encoding": {"kind": "waypoints"}, "task": {"kind": "paper"}},
    "alone": {"demonstration": {"enabled": False}},
    "errors": {"sensor": {"kind": "waypoints", "error_range": 0.1}},
    "residual": RESIDUAL,
    "fixed errors": {"sensor": {"kind": "waypoints", "error_range": 0.1, "redraw": False}},
}


@pytest.fixture(params=SETTINGS)
def env(request: pytest.FixtureRequest) -> PathFollowingEnv:
    return PathFollowingEnv(problem(**SETTINGS[request.param]))


def play(env: PathFollowingEnv, seed: int, steps: int = 120) -> list[Any]:
    """Everything that random actions see, over several episodes."""
    rng = np.random.default_rng(0)
    features, _ = env.reset(seed=seed)
    out: list[Any] = [features]
    for _ in range(steps):
        features, reward, ended, cut, info = env.step(rng.uniform(-1.0, 1.0, 1))
        out += [features, reward, ended, cut, *info.values()]
        if ended or cut:
            features, _ = env.reset()
            out.append(features)
    return out


def equal(a: list[Any], b: list[Any]) -> bool:
    return len(a) == len(b) and all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_gymnasiums_checker(env: PathFollowingEnv) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gymnasium_check(env, skip_render_check=True)
    assert env.observation_space.is_bounded()


def test_sb3s_checker(env: PathFollowingEnv) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3_check(env, warn=True)
    assert env.action_space == gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)


def test_is_registered() -> None:
    env = gymnasium.make("steersman/PathFollowing-v0")
    features, info = env.reset(seed=1)
    assert env.observation_space.contains(features)
    assert abs(info["lateral_error"]) < 1.5
    assert isinstance(env.unwrapped, PathFollowingEnv)


def test_is_made_from_plain_data() -> None:
    env = gymnasium.make("steersman/PathFollowing-v0", problem={**SMALL, "action": "direct"})
    assert isinstance(env.unwrapped, PathFollowingEnv)
    assert env.unwrapped.problem == problem(action="direct")


def test_unknown_field_is_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean 'action'"):
        PathFollowingEnv({"actoin": "direct"})


def test_fields_of_the_problem_are_keywords() -> None:
    made = gymnasium.make("steersman/PathFollowing-v0", problem=SMALL, corridor=2.0).unwrapped
    assert isinstance(made, PathFollowingEnv)
    assert made.problem == problem(corridor=2.0)
    assert PathFollowingEnv(problem(), corridor=2.0).problem == problem(corridor=2.0)
    with pytest.raises(ConfigError, match="path: unknown field; did you mean"):
        gymnasium.make("steersman/PathFollowing-v0", path="circle")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("demo", r"problem: 'demo' is neither .*sm\.configure\('train', 'demo'\)\.problem"),
        ({"problem.roads": ["circle"]}, r"nested: write {'roads': \['circle'\]}"),
        ({"task.kind": "precise"}, "nested: write {'task': {'kind': 'precise'}}"),
    ],
)
def test_words_of_the_command_line_are_told_from_fields(given: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        gymnasium.make("steersman/PathFollowing-v0", problem=given)


def test_same_seed_same_episodes(env: PathFollowingEnv) -> None:
    first = play(env, 3)
    assert equal(play(env, 3), first)
    assert equal(play(PathFollowingEnv(env.problem), 3), first)
    assert not equal(play(env, 4), first)


def test_features_have_names(env: PathFollowingEnv) -> None:
    assert env.observation_space.shape == (len(env.observation_names),)
    assert all(name.endswith("]") for name in env.observation_names)
    assert len(set(env.observation_names)) == len(env.observation_names)


def test_time_truncates() -> None:
    env = PathFollowingEnv(problem(episode_time=0.5, corridor=50.0))
    env.reset(seed=0)
    steps = [env.step([0.0])[2:5] for _ in range(10)]
    assert [step[:2] for step in steps] == [(False, False)] * 9 + [(False, True)]
    assert [step[2]["end"] for step in steps] == [""] * 9 + ["duration"]


def test_end_of_the_road_truncates() -> None:
    env = PathFollowingEnv(
        problem(
            roads=[{"kind": "straight", "distance": 20.0}], start="start_area",
            spread={"offset": 0.0, "heading": 0.0}, episode_time=20.0,
        )
    )  # fmt: skip
    env.reset(seed=0)
    for _ in range(200):
        _, _, ended, cut, info = env.step([0.0])
        if ended or cut:
            break
    assert (ended, cut) == (False, True)
    assert info["s"] >= 20.0
    assert info["end"] == "end_of_path"


def test_leaving_the_corridor_terminates() -> None:
    env = PathFollowingEnv(problem())
    assert env.reset(seed=0)[1]["end"] == ""
    for _ in range(80):
        _, _, ended, cut, info = env.step([0.15])
        assert (info["end"] != "") == (ended or cut)
        if ended or cut:
            break
    assert info["end"] == "off_track"
    assert 0.0 < info["steer"] <= 1.0
    assert (ended, cut) == (True, False)
    assert abs(info["lateral_error"]) > 1.5


def test_direct_action_is_the_command_and_rate_its_slope() -> None:
    direct = PathFollowingEnv(problem(action="direct"))
    direct.reset(seed=0)
    direct.step([0.3])
    assert direct.driver.fleet.executed[0] == pytest.approx(0.3)
    rate = PathFollowingEnv(problem())
    rate.reset(seed=0)
    before = rate.driver.last_commands()[0]
    rate.step([0.5])
    assert rate.driver.fleet.executed[0] == pytest.approx(before + 0.5 * 1.5708 * DT)
    for _ in range(60):
        rate.step([1.0])
    assert rate.driver.fleet.executed[0] == 1.0


def test_executed_command_is_what_the_simulator_gets() -> None:
    """One vehicle of the fleet drives exactly as the simulator under the rollout does."""
    env = PathFollowingEnv(
        problem(spread={"offset": 0.0, "heading": 0.0, "mass": 0.0, "delay": 0.0})
    )
    env.reset(seed=2)
    driver = env.driver
    plant = env.problem.plant.make(env.problem.vehicle)
    plant._state[:] = driver.fleet.state[0]
    plant._delayed[:] = driver.fleet.delayed[0]
    rng = np.random.default_rng(1)
    for _ in range(30):
        env.step(rng.uniform(-1.0, 1.0, 1))
        row = driver.fleet.state[0]
        # The pedals reach their commands within a period, so the state tells them.
        plant.step(Command(driver.fleet.executed[0], row[9], row[10]))
        assert plant._state[:6] == pytest.approx(row[:6], abs=0.05)
        plant._state[:] = row


def test_demonstrated_action_leads_to_the_demonstrated_steering() -> None:
    env = PathFollowingEnv(problem())
    _, info = env.reset(seed=0)
    for _ in range(40):
        wanted, action = info["demo_steer"], info["demo_action"]
        before = env.driver.last_commands()[0]
        _, _, ended, cut, info = env.step([action])
        executed = env.driver.fleet.executed[0]
        limit = 1.5708 * DT
        assert executed == pytest.approx(before + np.clip(wanted - before, -limit, limit))
        if ended or cut:
            break


def test_without_a_demonstrator_nothing_is_proposed() -> None:
    env = PathFollowingEnv(problem(demonstration={"enabled": False}))
    assert "demo_steer" not in env.reset(seed=0)[1]


def test_after_the_end_nothing_is_proposed() -> None:
    env = PathFollowingEnv(problem(episode_time=0.1, corridor=50.0))
    env.reset(seed=0)
    assert "demo_steer" in env.step([0.0])[4]
    assert "demo_steer" not in env.step([0.0])[4]
    assert "demo_steer" in env.reset()[1]


def test_demonstrated_action_closed_form() -> None:
    demo, last = np.array([0.2, 0.2, -0.5]), np.array([0.2, 0.19, 0.4])
    assert np.array_equal(demonstrated_action(demo, last, 0.0, DT), demo)
    indirect = demonstrated_action(demo, last, 1.5708, DT)
    assert indirect == pytest.approx([0.0, 0.01 / (1.5708 * DT), -1.0])


@pytest.mark.parametrize("controller", ["pid", "mpc_pid"])
def test_the_demonstrator_can_drive(controller: str) -> None:
    env = PathFollowingEnv(
        problem(
            demonstration={"controller": {"kind": controller}},
            speeds=[{"kind": "constant_speed", "speed": 6.0}],
            spread={"offset": 0.1, "delay": 0.0},
        )
    )
    _, info = env.reset(seed=1)
    for _ in range(80):
        _, _, ended, cut, info = env.step([info["demo_action"]])
        if ended or cut:
            break
    assert not ended
    assert abs(info["lateral_error"]) < 1.0
