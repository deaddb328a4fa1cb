"""Tests of the plug-in itself: `pytest examples/steersman_example_plugin` once it is installed."""

from __future__ import annotations

import math

import pytest
from steersman_example.learning import Calm, LateralAccelerationAhead

from steersman.config import build, components, resolve
from steersman.contracts import plant as plant_contract
from steersman.contracts.feature import check as feature_findings
from steersman.contracts.metric import check
from steersman.contracts.reward import check as reward_findings
from steersman.errors import ConfigError
from steersman.learning.env import PathFollowingEnv
from steersman.metrics.base import metrics, summarise
from steersman.paths.base import PathComponent
from steersman.rollout import RunConfig, run


@pytest.mark.parametrize(
    ("family", "kind"),
    [
        ("controller", "vector_field"),
        ("feature", "lateral_acceleration_ahead"),
        ("metric", "share_beyond_20cm"),
        ("reward", "calm"),
        ("path", "stadium"),
        ("plant", "single_track"),
        ("vehicle", "kei_car"),
    ],
)
def test_it_is_found_by_name(family: str, kind: str) -> None:
    assert kind in components(family)


def test_it_follows_a_road() -> None:
    parts = {"controller": "vector_field", "path": "stadium", "vehicle": "kei_car", "laps": 1}
    found = summarise(run(build(RunConfig, parts)))
    assert found["completed"]
    assert found["max_abs_lateral_error_m"] < 0.5
    assert found["share_beyond_20cm"] < 0.2


def test_the_metric_fulfils_its_contract() -> None:
    assert check(metrics()["share_beyond_20cm"]) == []


def test_feature_and_reward_term_fulfil_their_contracts() -> None:
    assert feature_findings(LateralAccelerationAhead()) == []
    assert feature_findings(LateralAccelerationAhead(waypoints=2)) == []
    assert reward_findings(Calm()) == []


def test_the_plant_fulfils_its_contract() -> None:
    assert plant_contract.check(resolve("plant", "single_track")) == []


def test_the_plant_drives_and_is_learned_on() -> None:
    parts = {"controller": "lqr", "path": "circle", "plant": "single_track", "duration": 20}
    found = summarise(run(build(RunConfig, parts)))
    assert found["completed"]
    assert found["max_abs_lateral_error_m"] < 0.2
    env = PathFollowingEnv({"plant": "single_track", "demonstration": {"controller": "pid"}})
    _, info = env.reset(seed=0)
    for _ in range(100):
        _, _, ended, _, info = env.step([info["demo_action"]])
        assert not ended


def test_the_stadium_closes_and_turns_once() -> None:
    path = resolve("path", {"kind": "stadium", "radius": 40.0})
    assert isinstance(path, PathComponent)
    assert path.closed
    bends = 2.0 * (math.pi * 40.0 + 20.0)
    assert path.length == pytest.approx(2.0 * 100.0 + bends)
    end = path.at(path.length - 1e-6)
    assert (end.x, end.y) == pytest.approx((0.0, 0.0), abs=1e-5)
    assert path.at(100.0 + 0.25 * bends).curvature == pytest.approx(1.0 / 40.0)


def test_a_bend_without_an_arc_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"shorter than 31\.4159 m"):
        resolve("path", {"kind": "stadium", "radius": 10.0, "clothoid": 50.0})
