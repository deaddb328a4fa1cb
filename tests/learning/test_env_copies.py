"""The environment drawn, copied, vectorised, and begun where one likes."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest

from steersman.config import resolve
from steersman.controllers.base import designed
from steersman.errors import ConfigError, SteersmanError
from steersman.learning.env import PathFollowingEnv
from steersman.vehicles import CarlaModel3

from ..loops import DT
from .problems import problem

ID = "steersman/PathFollowing-v0"
SHORT = {"roads": ["circle"], "episode_time": 1.0, "demonstration": {"controller": "mpc"}}


def run(env: Any, steps: int = 30) -> list[Any]:
    """What an environment gives from now on, over the end of an episode."""
    out: list[Any] = []
    for k in range(steps):
        features, reward, ended, cut, info = env.step(np.array([0.3 * np.sin(k)]))
        out += [features, reward, *info.values()]
        if ended or cut:
            out.append(env.reset()[0])
    return out


@pytest.mark.parametrize("options", [{}, {"path": "figure_eight", "speed": 7.0}], ids=str)
@pytest.mark.parametrize("how", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_alike(how: Any, options: dict[str, Any]) -> None:
    env = PathFollowingEnv(SHORT)
    env.reset(seed=3, options=options)
    run(env, 5)
    other = how(env)
    assert all(np.array_equal(a, b) for a, b in zip(run(env), run(other), strict=True))


@pytest.mark.parametrize("kind", ["mpc", "mpc_pid", "policy", "supervisor"])
def test_states_of_controllers_are_copied(kind: str) -> None:
    controller: Any = resolve("controller", kind)
    state = designed(controller, CarlaModel3(), DT)
    env = PathFollowingEnv(problem())
    env.reset(seed=0, options={"start": {"s": 5.0, "offset": 0.3}})
    seen = env.driver.simulation.observation(0)
    wanted = controller.step(state, seen)[0]
    for copied in (copy.deepcopy(state), pickle.loads(pickle.dumps(state))):
        assert controller.step(copied, seen)[0].steer == pytest.approx(wanted.steer, abs=1e-12)


def test_options_of_reset() -> None:
    env = PathFollowingEnv(problem(roads=["circle", "straight"]))
    start = {"s": 7.0, "offset": 0.25, "heading": 0.1}
    _, info = env.reset(seed=0, options={"path": "figure_eight", "start": start, "speed": 9.0})
    assert info["s"] == pytest.approx(7.0)
    assert info["lateral_error"] == pytest.approx(0.25, abs=1e-3)
    assert info["speed"] == pytest.approx(9.0)
    assert env.driver.problem.roads[0].kind == "figure_eight"
    _, info = env.reset(options={"path": "straight", "start": 3.0})
    assert (env.driver.problem, info["s"]) == (env.problem, pytest.approx(3.0))
    kinds = {env.reset() and env._fleet.path[0] for _ in range(20)}
    assert kinds == {0, 1}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"strat": 1.0}, r"options\.strat: unknown field; did you mean 'start'"),
        ({"path": "cirle"}, r"options\.path: .*did you mean 'circle'"),
        ({"speed": -1.0}, r"options\.speed: -1.0 is not allowed; must be greater than 0 \[m/s\]"),
        ({"speed": 500.0}, r"options\.speed: 500.0 is not allowed; must be at most 150"),
        ({"start": 1e6}, r"options\.start\.s: 1e\+06 is not allowed; the path is 314.2 long"),
        ({"start": {"offset": 2.0}}, r"options\.start\.offset: 2 .* half width is 1.5 \[m\]"),
    ],
)
def test_wrong_options(options: dict[str, Any], message: str) -> None:
    env = PathFollowingEnv(SHORT)
    with pytest.raises(ConfigError, match=message):
        env.reset(options=options)


@pytest.mark.parametrize("action", [np.nan, np.inf, [0.0, 1.0]], ids=str)
def test_an_action_that_is_none(action: Any) -> None:
    env = PathFollowingEnv(SHORT)
    env.reset(seed=0)
    with pytest.raises(ConfigError, match=r"action: .* one finite number in \[-1, 1\]"):
        env.step(np.array(action))


def test_vectorised_in_processes() -> None:
    both = gymnasium.make_vec(ID, 2, "async", problem=SHORT)
    features, _ = both.reset(seed=1)
    assert features.shape[0] == 2
    assert np.isfinite(both.step(np.zeros((2, 1), np.float32))[1]).all()
    both.close()


def test_pictures() -> None:
    pytest.importorskip("pygame", reason="the extra video has pygame")
    env = gymnasium.make(ID, problem=SHORT, render_mode="rgb_array")
    env.reset(seed=0, options={"start": 0.0, "speed": 10.0})
    first: Any = env.render()
    assert (first.shape, first.dtype) == ((400, 640, 3), np.uint8)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 5
    for _ in range(10):
        env.step(np.array([0.0], np.float32))
    assert (env.render() != first).mean() > 0.01  # the road moved below the car
    with pytest.raises(ConfigError, match="did you mean 'rgb_array'"):
        PathFollowingEnv(SHORT, render_mode="rgb")


def test_gymnasium_records_videos(tmp_path: Any) -> None:
    for name in ("moviepy", "pygame"):
        pytest.importorskip(name, reason="the extra video has it")
    env = gymnasium.make(ID, problem=SHORT, render_mode="rgb_array")
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "films"), disable_logger=True)
    env.reset(seed=0)
    for _ in range(25):
        env.step(np.array([0.0], np.float32))
    env.close()
    (film,) = tmp_path.rglob("*.mp4")
    assert film.stat().st_size > 1000


def test_an_environment_goes_on_after_a_reset_that_was_refused() -> None:
    env = gymnasium.make("steersman/PathFollowing-v0")
    with pytest.raises(SteersmanError):
        env.reset(options={"path": "figure_eigth"})
    env.reset(seed=0)
    env.step(np.zeros(1, dtype=np.float32))
