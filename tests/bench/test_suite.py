"""Suites: what they hold, that tests share nothing with tuning, that a seed decides all draws."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.bench import suites
from steersman.bench.courses import CAP
from steersman.bench.disturbance import Disturbance, Mixed
from steersman.bench.standard import standard
from steersman.bench.suite import Scenario, Suite
from steersman.config import build, to_yaml
from steersman.errors import ConfigError
from steersman.rollout import RunConfig
from steersman.speed import SpeedTracking
from steersman.vehicles import CarlaModel3

CAR = CarlaModel3()
COURSE = {"path": "circle", "speeds": {"slow": {"kind": "constant_speed"}}, "duration": 2.0}


def by_name(scenarios: list[Scenario]) -> dict[str, Scenario]:
    return {s.name: s for s in scenarios}


@pytest.mark.parametrize("name", suites.SUITES)
def test_every_suite_survives_its_file(name: str, tmp_path: FilePath) -> None:
    suite = suites.suite(name)
    file = tmp_path / "suite.yaml"
    file.write_text(to_yaml(suite), encoding="utf-8")
    assert suites.suite(str(file)) == suite


@pytest.mark.parametrize("name", suites.SUITES)
def test_names_tell_scenarios_apart(name: str) -> None:
    scenarios = suites.suite(name).scenarios((0, 1))
    assert len({s.name for s in scenarios}) == len(scenarios)


def test_a_disturbed_car_can_hold_the_speeds_of_the_first_suite() -> None:
    """Every speed is capped; beyond the usual cap only clean cars are asked to go."""
    for scenario in suites.standard_1().scenarios():
        speed = scenario.run.speed
        assert isinstance(speed, SpeedTracking)
        assert speed.a_lat_max is not None
        if speed.a_lat_max > CAP:
            assert scenario.disturbance == "clean"


def test_the_seed_decides_every_draw() -> None:
    first, second, other = (suites.quick().scenarios((seed,)) for seed in (5, 5, 6))
    assert first == second
    drawn = [s for s in first if s.disturbance == "mixed"]
    assert drawn
    redrawn = {s.path: s for s in other if s.disturbance == "mixed"}
    for scenario in drawn:
        assert scenario.applied != redrawn[scenario.path].applied
        assert scenario.run.seed != redrawn[scenario.path].run.seed


def test_a_drawn_speed_is_the_same_under_every_disturbance() -> None:
    changing = [s for s in standard().scenarios() if (s.path, s.speed) == _MONZA]
    assert len(changing) > 10
    drawn = [s.run.speed.breakpoints()[1] for s in changing]
    assert all(np.array_equal(speeds, drawn[0]) for speeds in drawn)
    # What the sensors' errors and the mixed disturbances draw is each scenario's own.
    assert len({s.run.seed for s in changing}) == len(changing)


_MONZA = ("monza", "changing")


def test_a_clean_scenario_is_the_plain_run() -> None:
    run = RunConfig(vehicle=CAR)
    assert Disturbance().apply(run) == run


def test_a_disturbed_car_is_not_what_its_controller_is_told() -> None:
    run = RunConfig(vehicle=CAR)
    heavy = Disturbance(mass=1.2, yaw_inertia=1.1, c_f=0.7, c_r=1.3).apply(run)
    assert heavy.vehicle.mass == pytest.approx(1.2 * CAR.mass)
    assert heavy.vehicle.yaw_inertia == pytest.approx(1.1 * CAR.yaw_inertia)
    assert heavy.vehicle.c_f == pytest.approx(0.7 * CAR.c_f)
    assert heavy.vehicle.c_r == pytest.approx(1.3 * CAR.c_r)
    assert heavy.nominal == CAR
    # The engine stays that of the car as it was measured.
    assert heavy.vehicle.map_mass == CAR.mass


def test_a_wrong_model_leaves_the_car_alone() -> None:
    run = RunConfig(vehicle=CAR)
    wrong = Disturbance(model={"mass": 1.3}).apply(run)
    assert wrong.vehicle == CAR
    assert wrong.nominal is not None
    assert wrong.nominal.mass == pytest.approx(1.3 * CAR.mass)


def test_the_disturbances_reach_what_they_name() -> None:
    run = RunConfig(vehicle=CAR, speed={"kind": "constant_speed", "a_lat_max": 6.0})
    slippery = Disturbance(friction=0.5).apply(run)
    assert slippery.vehicle.friction == 0.5
    assert slippery.speed.a_lat_max == pytest.approx(0.6 * 0.5 * 9.81)
    assert Disturbance(friction=2.0).apply(run).speed.a_lat_max == 6.0
    windy = Disturbance(wind=15.0).apply(run)
    assert windy.plant.wind.speed == 15.0
    assert windy.plant.wind.seed != windy.seed
    slow = Disturbance(steer_rate=0.5, steer_bias=0.02).apply(run)
    assert slow.vehicle.steer_rate_up == pytest.approx(0.5 * CAR.steer_rate_up)
    assert slow.vehicle.steer_bias == 0.02
    assert slow.nominal == CAR
    blurred = Disturbance(position_noise=0.1, speed_noise=0.2, yaw_rate_noise=0.3).apply(run)
    sensor = blurred.sensor
    assert (sensor.position_noise, sensor.speed_noise, sensor.yaw_rate_noise) == (0.1, 0.2, 0.3)
    assert blurred.nominal is None


def test_mixed_draws_stay_in_their_ranges_and_fill_them() -> None:
    mixed = Mixed()
    draws = [mixed.draw(np.random.default_rng(seed)).figures() for seed in range(200)]
    ends = {
        "delay": (0.0, mixed.delay),
        "waypoint_noise": (0.0, mixed.waypoint_noise),
        "mass": (1.0 - mixed.mass, 1.0 + mixed.mass),
        "c_f": (1.0 - mixed.stiffness, 1.0 + mixed.stiffness),
        "c_r": (1.0 - mixed.stiffness, 1.0 + mixed.stiffness),
    }
    for name, (low, high) in ends.items():
        values = np.array([draw[name] for draw in draws])
        assert low <= values.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < values.max() <= high


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"courses": {}}, "courses: .*at least one"),
        ({"courses": {"a": {"path": "circle"}}}, r"courses\.a\.speeds"),
        ({"courses": {"a": COURSE | {"path": "cirle"}}}, "did you mean 'circle'"),
        ({"courses": {"a": COURSE | {"only": {"slow": ["clen"]}}}}, "did you mean 'clean'"),
        ({"courses": {"a": COURSE | {"only": {"slw": ["clean"]}}}}, "did you mean 'slow'"),
        ({"courses": {"a": COURSE}, "mixed": {"clean": {}}}, "in disturbances too"),
        ({"courses": {"a": COURSE}, "disturbances": {}}, "at least one"),
        ({"courses": {"a": COURSE}, "disturbances": {"b": {"mas": 2}}}, "did you mean 'mass'"),
        ({"courses": {"a": COURSE}, "disturbances": {"b": {"mass": 0}}}, "disturbances.b.mass"),
    ],
)
def test_a_wrong_suite_is_one_line(data: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        build(Suite, data)
    assert "\n" not in str(error.value)


def test_an_unknown_suite_is_named_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="'standart'; did you mean 'standard'"):
        suites.suite("standart")
