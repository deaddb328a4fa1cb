"""The estimator: biases told from the road, noise averaged, outliers left out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.config import build, resolve
from steersman.contracts.estimator import Listening, as_rows, estimates
from steersman.contracts.scenes import CAR, DT
from steersman.controllers.base import ControllerComponent
from steersman.controllers.estimated import Estimated
from steersman.controllers.lqr import Lqr
from steersman.episode import Episode
from steersman.estimators.kalman import Kalman
from steersman.estimators.single_track import SingleTrack
from steersman.kernels.predict import DELAY
from steersman.rollout import RunConfig, attempt, run
from steersman.types import FloatArray, Observation

CIRCLE = {
    "path": {"kind": "circle", "radius": 50.0},
    "speed": {"kind": "constant_speed", "speed": 18.7},
    "duration": 20.0,
}
ROAD = {
    "path": {"kind": "random_road", "seed": 2021, "distance": 300.0},
    "speed": {"kind": "constant_speed", "speed": 15.0},
    "seed": 3,
}


def driven(fields: dict[str, Any]) -> tuple[Episode, list[Observation], list[float]]:
    """A drive of LQR behind the estimator; observations as the sensor gave them."""
    listening = Listening(controller=Estimated())
    config = build(RunConfig, fields).model_copy(update={"controller": listening})
    episode = attempt(config).episode
    return episode, *listening.record()


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.square(values).mean()))


@pytest.mark.parametrize(
    "bias", [{"v_y": 0.1}, {"v_y": -0.1}, {"v_x_scale": 0.05}, {"yaw_rate": 0.01}], ids=str
)
def test_biased_odometry_moves_no_car_off_an_exact_road(bias: dict[str, float]) -> None:
    biased = {**CIRCLE, "disturbances": [{"kind": "sensor_bias", **bias}]}
    plain, wrong = (
        run(build(RunConfig, {"controller": "tuned/lqr", "estimator": "kalman", **fields}))
        for fields in (CIRCLE, biased)
    )
    assert wrong.completed
    gap = wrong["lateral_error"] - plain["lateral_error"]
    assert np.abs(gap).max() < 0.05
    assert abs(gap[-1]) < 0.015


def test_a_bias_of_the_side_velocity_is_found() -> None:
    episode, observations, steers = driven(
        {**CIRCLE, "disturbances": [{"kind": "sensor_bias", "v_y": 0.1}]}
    )
    found = estimates(Kalman(), observations, steers)
    measured = as_rows(observations)[:, 3] - episode["v_y"]
    assert rms(measured) > 0.09
    assert rms(found[100:, 3] - episode["v_y"][100:]) < 0.02


@pytest.mark.parametrize(("half", "most"), [(0.1, 0.009), (0.3, 0.022)])
def test_noise_of_waypoints_is_averaged(half: float, most: float) -> None:
    # The bound on such roads is 5 and 12.5 mm: results/estimation/noise.json.
    episode, observations, steers = driven({**ROAD, "sensor": {"error_range": half}})
    found = estimates(Kalman(), observations, steers)
    truth = episode["lateral_error"]
    assert rms(as_rows(observations)[60:, 0] - truth[60:]) > 0.3 * half
    assert rms(found[60:, 0] - truth[60:]) < most


def test_noise_of_pose_is_averaged() -> None:
    noisy = {"position_noise": 0.1, "heading_noise": 0.01}
    episode, observations, steers = driven({**ROAD, "sensor": noisy})
    found, seen = estimates(Kalman(), observations, steers)[60:], as_rows(observations)[60:]
    for column, name in enumerate(("lateral_error", "heading_error")):
        truth = episode[name][60:]
        assert rms(found[:, column] - truth) < 0.6 * rms(seen[:, column] - truth), name


def test_noise_of_velocities_is_averaged() -> None:
    noisy = {"speed_noise": 0.2, "yaw_rate_noise": 0.02}
    episode, observations, steers = driven({**ROAD, "sensor": noisy})
    found, seen = estimates(Kalman(), observations, steers)[60:], as_rows(observations)[60:]
    for column, name in ((2, "v_x"), (3, "v_y"), (4, "yaw_rate")):
        truth = episode[name][60:]
        assert rms(found[:, column] - truth) < 0.7 * rms(seen[:, column] - truth), name


def test_one_waypoint_far_off_is_left_out() -> None:
    _, observations, steers = driven({**ROAD, "duration": 6.0})
    wrong = [o._replace(preview=o.preview.copy()) for o in observations]
    wrong[60].preview[4] += 3.0
    gap = np.abs(estimates(Kalman(), wrong, steers) - estimates(Kalman(), observations, steers))
    assert gap[60:, :7].max() < 0.01
    assert gap[60:, 7:].max() < 0.05


def test_the_road_elsewhere_is_a_new_beginning() -> None:
    _, observations, steers = driven({**ROAD, "duration": 6.0})
    moved = [o._replace(lateral_error=o.lateral_error + 3.0) for o in observations]
    moved = [o._replace(preview=o.preview - (0.0, 3.0)) for o in moved]
    row = [*observations[:60], *moved[60:]]
    found = estimates(Kalman(), row, steers)
    assert np.abs(found[66:, 0] - as_rows(row)[66:, 0]).max() < 0.02


def test_a_frozen_clock_with_new_numbers_goes_on() -> None:
    _, observations, steers = driven({**ROAD, "duration": 4.0})
    timeless = [o._replace(time=0.0) for o in observations]
    assert np.allclose(
        estimates(Kalman(), timeless, steers), estimates(Kalman(), observations, steers), atol=1e-9
    )


@pytest.mark.parametrize("controller", ["tuned/lqr", "tuned/stanley", "tuned/sliding_mode"])
def test_steering_that_acts_late_loses_no_car_behind_the_predictor(controller: str) -> None:
    fields = {
        **ROAD,
        "controller": controller,
        "speed": {"kind": "random_profile", "high": 20.0, "seed": 1},
        "plant": {"steering_delay": 0.2},
    }
    alone = attempt(build(RunConfig, fields)).episode
    found = attempt(build(RunConfig, {**fields, "predictor": "single_track"})).episode
    assert found.completed
    assert not alone.completed or rms(alone["lateral_error"]) > 2.0 * rms(found["lateral_error"])


def test_the_delay_is_that_of_the_vehicle_at_first() -> None:
    late = CAR.model_copy(update={"steer_delay": 0.15})
    kept = SingleTrack().init(late, DT).kept
    assert kept.memory[DELAY] == pytest.approx(0.15)


def test_a_long_gap_is_predicted_no_further_than_there_are_commands() -> None:
    ahead = np.stack([2.0 * np.arange(15), np.full(15, -0.1)], axis=1)
    seen = Observation(0.0, 0.1, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, ahead, 2.0)
    predictor, times = SingleTrack(), []
    state = predictor.init(CAR, DT)
    for k in range(60):
        late, state = predictor.estimate(state, seen)
        state = predictor.executed(state, 0.02 * k)
        times.append(late.time)
    longest = (len(state.kept.commands) - 1) * DT
    assert times[10] == pytest.approx(10 * DT)
    assert times[-1] == times[-2] == pytest.approx(longest)


def test_estimator_and_predictor_of_a_drive_stand_in_front_of_its_controller() -> None:
    fields = {**ROAD, "duration": 2.0, "sensor": {"error_range": 0.1}}
    beside = run(build(RunConfig, {**fields, "estimator": "kalman", "predictor": "single_track"}))
    mpc: ControllerComponent = RunConfig().controller
    inside = {"kind": "estimated", "predictor": "single_track", "controller": mpc}
    within = run(build(RunConfig, {**fields, "controller": inside}))
    assert np.array_equal(beside["steer_command"], within["steer_command"])


def test_words_put_them_in_front() -> None:
    both: Any = resolve("controller", "estimated/predicted/lqr")
    assert both.controller.predictor == SingleTrack()
    assert both.controller.controller == Lqr()
    assert (both.estimator, both.predictor) == (Kalman(), None)
