"""The vector environment: the same as single ones, episodes renewed as SB3 expects."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from steersman.kernels import observe
from steersman.kernels import speed as speeds
from steersman.kernels import vehicle as car
from steersman.kernels import world as kernel
from steersman.learning.env import PathFollowingEnv
from steersman.learning.fleet import FleetDriver
from steersman.learning.starts import draw_start
from steersman.learning.vec_env import PathFollowingVecEnv

from .problems import RESIDUAL, problem

STEPS = 130  # past the first time limit, at 80
SETTINGS: dict[str, dict[str, Any]] = {
    "rate": {},
    "direct": {"action": "direct", "demonstration": {"enabled": False}},
    "errors": {"sensor": {"kind": "waypoints", "error_range": 0.1}},
    "residual": {**RESIDUAL, "sensor": {"kind": "waypoints", "error_range": 0.1}},
}


def actions(n: int) -> Any:
    return np.random.default_rng(0).uniform(-0.4, 0.4, (STEPS, n, 1))


def single(env: PathFollowingEnv, moves: Any) -> list[tuple[Any, float, bool, bool]]:
    """What each step gives, with the observation that follows it (the new episode's, if any)."""
    out = []
    for move in moves:
        features, reward, ended, cut, _ = env.step(move)
        if ended or cut:
            features, _ = env.reset()
        out.append((features, reward, ended, cut))
    return out


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("n", [1, 4])
def test_agrees_with_single_environments_to_the_bit(name: str, n: int) -> None:
    task, moves = problem(**SETTINGS[name]), actions(n)
    fleet = PathFollowingVecEnv(task, n)
    fleet.seed(7)
    start = fleet.reset()
    together = [fleet.step(row) for row in moves]
    done = np.array([step[2] for step in together])
    assert done.any(axis=0).all()
    children = np.random.SeedSequence(7).spawn(n)
    for i in range(n):
        env = PathFollowingEnv(task)
        env.reset(seed=7)
        env.driver.simulation.rngs[0] = np.random.default_rng(children[i])
        first, _ = env.reset()
        assert np.array_equal(first, start[i])
        for k, (features, reward, ended, cut) in enumerate(single(env, moves[:, i])):
            observation, rewards, dones, infos = together[k]
            assert np.array_equal(features, observation[i])
            assert rewards[i] == np.float32(reward)
            assert dones[i] == (ended or cut)
            if dones[i]:
                assert infos[i]["TimeLimit.truncated"] == cut


def test_same_seed_same_everything() -> None:
    runs = []
    for seed in (5, 5, 6):
        env = PathFollowingVecEnv(problem(), 3)
        env.seed(seed)
        runs.append([env.reset(), *(env.step(row)[0] for row in actions(3))])
    assert np.array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])


def test_a_seed_counts_for_the_next_reset_alone() -> None:
    env = PathFollowingVecEnv(problem(), 2)
    env.seed(5)
    first, second = env.reset(), env.reset()
    assert not np.array_equal(first, second)
    env.seed(5)
    assert np.array_equal(env.reset(), first)
    assert np.array_equal(env.reset(), second)


def test_an_episode_that_ends_begins_anew() -> None:
    env = PathFollowingVecEnv(problem(episode_time=0.5, corridor=50.0), 2)
    env.reset()
    for _ in range(9):
        _, _, done, infos = env.step(np.zeros((2, 1)))
        assert not done.any()
        assert infos == [{}, {}]
    observation, _, done, infos = env.step(np.zeros((2, 1)))
    assert done.all()
    for i, info in enumerate(infos):
        assert info["TimeLimit.truncated"]
        assert not info["off_track"]
        assert info["episode"]["l"] == 10
        assert info["terminal_observation"].shape == observation[i].shape
        assert not np.array_equal(info["terminal_observation"], observation[i])
    assert (env.driver.fleet.clock[:, kernel.CLOCK_STEPS] == 0.0).all()
    assert env.off_track == 0


def test_leaving_the_corridor_is_no_truncation() -> None:
    env = PathFollowingVecEnv(problem(), 3)
    env.reset()
    ends = []
    for _ in range(60):
        _, _, done, infos = env.step(np.ones((3, 1)))
        ends += [infos[i] for i in np.flatnonzero(done)]
    assert ends
    assert all(info["off_track"] and not info["TimeLimit.truncated"] for info in ends)
    assert {info["end"] for info in ends} == {"off_track"}
    assert env.off_track == len(ends)


def test_a_finished_vehicle_leaves_the_others_alone() -> None:
    together = PathFollowingVecEnv(problem(), 2)
    together.seed(3)
    together.reset()
    calm = PathFollowingVecEnv(problem(), 2)
    calm.seed(3)
    calm.reset()
    for k in range(60):
        wild = together.step(np.array([[1.0], [0.0]]))
        quiet = calm.step(np.array([[0.0], [0.0]]))
        assert np.array_equal(wild[0][1], quiet[0][1]), k
    assert together.off_track > 0


def test_the_demonstrator_begins_anew_with_the_episode() -> None:
    """Its integral and its last plan belong to the episode that is over."""
    env = PathFollowingVecEnv(problem(episode_time=1.0, corridor=50.0), 2)
    env.reset()
    demonstrator = env.driver._demonstrator
    assert demonstrator is not None
    seen = []
    for _ in range(20):
        seen.append(demonstrator._states[0])
        _, _, done, _ = env.step(np.full((2, 1), 0.1))
    assert done.all()
    assert abs(seen[-1].pid.integral) > abs(seen[0].pid.integral)
    controller, fresh = demonstrator._plain
    expected, _ = controller.step(fresh, _observation(env, 0))
    assert env.driver.fleet.demo[0] == expected.steer


def _observation(env: PathFollowingVecEnv, i: int) -> Any:
    from steersman.sensing import to_observation

    return to_observation(env.driver.fleet.rows[i], 0.0, env.driver.problem.sensor.spacing)


def test_spread_varies_the_car_and_the_start() -> None:
    env = PathFollowingVecEnv(problem(), 8)
    env.reset()
    rows = env.driver.world.vehicles.rows
    assert len(set(rows[:, 0])) == 8
    assert abs(rows[:, 0] / env.driver.problem.vehicle.row()[0] - 1.0).max() <= 0.1
    offsets = env.driver.fleet.tracking[:, 1]
    assert 0.0 < abs(offsets).max() <= 0.3 + 1e-6


def _first_looks(n: int, **spread: float) -> tuple[Any, Any, Any]:
    """Cars, delays and waypoint errors of ``n`` episodes on a straight."""
    env = PathFollowingVecEnv(
        problem(
            roads=[{"kind": "straight"}],
            sensor={"kind": "waypoints", "error_range": 0.2},
            spread={"offset": 0.0, "heading": 0.0, "mass": 0.1, "delay": 0.1, **spread},
        ),
        n,
    )
    env.reset()
    driver = env.driver
    seen = driver.fleet.rows[:, observe.O_PREVIEW + 1 :: 2] - driver.fleet.tracking[:, [observe.D]]
    return driver.world.vehicles.rows[:, car.MASS], driver.fleet.delay, abs(seen).max(axis=1)


def test_a_share_of_episodes_has_the_nominal_car_and_sensor() -> None:
    mass, delay, errors = _first_looks(200, waypoints=1.0, nominal=0.3)
    nominal = mass == problem().vehicle.row()[car.MASS]
    assert 0.2 < nominal.mean() < 0.4
    assert (delay[nominal] == 0).all()
    assert delay[~nominal].max() > 5
    assert errors[nominal].max() < 1e-9
    assert errors[~nominal].min() > 0.0


def test_fast_episodes_can_be_kept_for_the_nominal_car() -> None:
    fast = {"kind": "random_profile", "a_lat_max": 12.0, "cap_low": 1.0}
    slow = fast | {"a_lat_max": 3.0}
    env = PathFollowingVecEnv(problem(speeds=[fast, slow], spread={"a_lat_max": 5.0}), 60)
    env.reset()
    driver = env.driver
    other = driver.world.vehicles.rows[:, car.MASS] != problem().vehicle.row()[car.MASS]
    scale = driver.world.speed.rows[:, speeds.CAP_SCALE]
    assert 15 < other.sum() < 45
    assert scale[other].max() < scale[~other].min()


def test_waypoint_errors_are_of_another_size_in_each_episode() -> None:
    *_, full = _first_looks(50)
    *_, some = _first_looks(50, waypoints=0.5)
    *_, every = _first_looks(50, waypoints=1.0)
    assert full.min() > 0.15
    assert full.max() <= 0.2
    assert some.min() > 0.05
    assert every.min() < 0.05


def test_sb3s_other_methods() -> None:
    env = PathFollowingVecEnv(problem(), 2)
    assert env.get_attr("steps") == [0, 0]
    env.set_attr("steps", 5)
    assert env.steps == 5
    assert env.env_is_wrapped(object) == [False, False]
    env.reset()
    assert len(env.env_method("demonstrated_actions")) == 2
    env.close()


@pytest.mark.parametrize("used", [0.6, 0.45])
def test_slippery_roads_are_driven_as_slippery_ones(used: float) -> None:
    """Friction within its range, and no more than the given share of the grip asked for."""
    spread = {"slippery": 1.0, "least_friction": 0.4, "used_grip": used}
    source = {"kind": "random_profile", "low": 5.0, "high": 25.0, "a_lat_max": 8.0}
    driver = FleetDriver(problem(spread=spread, speeds=[source], roads=["circle"]), 64)
    driver.seed(0)
    for i in range(driver.n):
        driver.reset(i)
    mu = driver.world.vehicles.rows[:, car.MU]
    own = problem().vehicle.table.rows[0, car.MU]
    assert mu.min() >= 0.4
    assert mu.max() <= own
    # Evenly in the logarithm: half of them are below the geometric mean; drawn evenly in the
    # friction itself, only a quarter would be.
    below = np.mean(mu < np.sqrt(0.4 * own))
    assert 0.38 < below < 0.62
    v = driver.fleet.state[:, car.VX]
    assert np.all(v**2 / 50.0 <= np.minimum(used * mu * 9.81, 8.0) * 1.001)
    assert v.max() > 15.0


def test_steering_differs_from_car_to_car() -> None:
    """Rates within the share, both alike; the bias as a wheel angle to either side."""
    spread = {"steer_rate": 0.8, "steer_bias": 0.02, "nominal": 0.25}
    driver = FleetDriver(problem(spread=spread), 64)
    driver.seed(0)
    for i in range(driver.n):
        driver.reset(i)
    rows, own = driver.world.vehicles.rows, problem().vehicle.table.rows[0]
    share = rows[:, car.STEER_UP] / own[car.STEER_UP]
    assert share.min() >= 0.2
    assert share.min() < 0.35
    assert 8 <= np.sum(share == 1.0) <= 24
    assert_allclose(rows[:, car.STEER_DOWN] / own[car.STEER_DOWN], share)
    angle = (rows[:, car.STEER_BIAS] - own[car.STEER_BIAS]) * own[car.MAX_STEER]
    assert np.abs(angle).max() <= 0.02
    assert angle.min() < -0.01 < 0.01 < angle.max()
    assert 8 <= np.sum(angle == 0.0) <= 24


def test_sensor_errors_are_scaled_from_drive_to_drive() -> None:
    """A drive without errors sees everything exactly; with half of them, half as much."""
    words = {
        "sensor": {"error_range": 0.1, "position_noise": 0.05, "speed_noise": 0.1},
        "disturbances": [{"kind": "sensor_bias", "v_y": 0.2}],
        "demonstration": {"enabled": False},
    }
    seen = []
    for level in (0.0, 0.5, 1.0):
        driver = FleetDriver(problem(**words), 2)
        driver.seed(0)
        driver.fleet.levels[:] = level
        for i in range(driver.n):
            driver.begin(i, draw_start(driver.problem, driver.world, np.random.default_rng(i)))
            driver.look(i)
        driver.step(np.zeros(2))
        rows = driver.fleet.rows[:, [observe.O_VX, observe.O_VY]]
        seen.append(rows - driver.fleet.state[:, [car.VX, car.VY]])
    assert_array_equal(seen[0], 0.0)
    assert_allclose(seen[1], 0.5 * seen[2], atol=1e-12)
    assert np.abs(seen[2][:, 1] - 0.2).min() > 1e-4


def test_without_slippery_roads_nothing_is_drawn_for_them() -> None:
    rows = []
    for spread in ({"mass": 0.2}, {"mass": 0.2, "slippery": 0.0, "least_friction": 0.1}):
        driver = FleetDriver(problem(spread=spread), 4)
        driver.seed(3)
        for i in range(driver.n):
            driver.reset(i)
        rows.append(driver.fleet.state.copy())
    assert_array_equal(*rows)
