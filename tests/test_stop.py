"""Standing at the end of a path: where the car stands, what a drive ends by, what is measured."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from steersman import episode as ending
from steersman.cli import app
from steersman.config import build
from steersman.controllers.pid import Pid
from steersman.episode import Episode
from steersman.kernels import world as kernel
from steersman.kernels.speed import AT_END
from steersman.learning.env import PathFollowingEnv
from steersman.metrics.base import evaluate
from steersman.metrics.stopping import stopping
from steersman.outcome import Attempt
from steersman.rollout import RunConfig, attempt

from .learning.problems import problem

SHORT = {"kind": "clothoid_road", "seed": 3, "distance": 60.0}
QUICK = {"kind": "constant_speed", "speed": 14.0, "a_lat_max": 4.0, "end": 0.0}


def driven(**words: Any) -> Attempt:
    return attempt(build(RunConfig, {"path": SHORT, "speed": QUICK, "corridor": 3.0, **words}))


def stop_error(episode: Episode) -> Any:
    return evaluate(episode, stopping())["stop_error_m"]


@pytest.mark.parametrize(
    ("path", "speed", "vehicle"),
    [
        (SHORT, QUICK, "carla_model3"),
        (SHORT, QUICK, "bmw_320i"),
        (SHORT, QUICK, "vw_t7"),
        (SHORT, QUICK | {"deceleration": 3.5}, "carla_mkz2020"),
        ("double_lane_change", {"kind": "profile", "end": 0.0, "top": 20.0}, "carla_model3"),
        ({"kind": "straight", "distance": 40.0}, QUICK | {"k_i": 0.1}, "carla_model3"),
        ({"kind": "straight", "distance": 33.3}, QUICK | {"speed": 2.0}, "carla_model3"),
    ],
)
def test_a_car_stands_at_the_end(path: Any, speed: Any, vehicle: str) -> None:
    tried = driven(path=path, speed=speed, vehicle=vehicle)
    assert (tried.outcome, tried.episode.end) == ("finished", ending.END_OF_PATH)
    assert stop_error(tried.episode) <= AT_END
    v = np.hypot(tried.episode["v_x"], tried.episode["v_y"])
    assert v[-1] < 0.05
    # It stops once, and crawls no longer than a few seconds.
    assert (v[np.argmax(v) :] < 0.4).sum() * tried.episode.dt < 6.0


@pytest.mark.parametrize("plant", ["multibody", "tum_single_track"])
def test_other_cars_stand_there_too(plant: str) -> None:
    tried = driven(plant=plant, path={"kind": "straight", "distance": 40.0})
    assert tried.outcome == "finished"
    assert stop_error(tried.episode) <= AT_END


def test_a_car_whose_brakes_are_too_weak_overruns_the_end() -> None:
    weak = {"kind": "vw_t7", "brake_force": 3000.0}
    tried = driven(vehicle=weak, speed=QUICK | {"deceleration": 6.0})
    assert (tried.outcome, tried.episode.end) == ("overran", ending.OVERRUN)
    assert not tried.episode.completed
    assert stop_error(tried.episode) is None
    left = tried.episode.path_length - tried.episode.distance
    assert -1.0 < left < -AT_END


class Hesitant(Pid):
    """Allows little speed."""

    def limits_speed(self) -> bool:
        return True

    def step(self, state: Any, observation: Any) -> Any:
        decision, state = super().step(state, observation)
        return decision._replace(speed_limit=2.0), state


def test_a_controller_that_limits_the_speed_stands_there_as_well() -> None:
    tried = attempt(
        build(RunConfig, {"path": SHORT, "speed": QUICK | {"speed": 3.0}}).model_copy(
            update={"controller": Hesitant()}
        )
    )
    assert tried.outcome == "finished"
    assert tried.episode["v_x"][40:].max() < 2.2
    assert stop_error(tried.episode) <= AT_END


def test_where_no_standstill_is_wished_none_is_measured() -> None:
    for more in ({"end": 3.0}, {"end": None}):
        tried = driven(speed=QUICK | more)
        assert tried.episode.end == ending.END_OF_PATH
        assert stop_error(tried.episode) is None
    lap = driven(path={"kind": "circle", "radius": 30.0}, laps=0.2)
    assert lap.outcome == "finished"
    assert lap.episode["v_x"][-1] > 5.0


def test_a_drive_prints_the_distance_where_standing_is_wished() -> None:
    words = ["drive", "tuned/lqr", "path=straight", "path.distance=20", "speed=constant_speed"]
    shown = [CliRunner().invoke(app, [*words, *more]).output for more in ((), ("speed.end=0",))]
    assert ["distance from the end" in each for each in shown] == [False, True]


def test_an_environment_goes_on_until_the_car_stands() -> None:
    roads = [{"kind": "straight", "distance": 25.0}]
    env = PathFollowingEnv(problem(roads=roads, speeds=[QUICK | {"speed": 6.0}], episode_time=20.0))
    env.reset(seed=0, options={"start": 0.0})
    for _ in range(400):
        *_, terminated, truncated, info = env.step(np.zeros(1))
        if terminated or truncated:
            break
    assert (terminated, truncated, info["end"]) == (False, True, ending.END_OF_PATH)
    assert kernel.OVERRAN in kernel.FAILED
