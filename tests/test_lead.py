"""A car ahead: its kinematics, collisions, the constant-time-gap law, and learning behind it."""

from __future__ import annotations

from functools import cache
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from steersman import episode as ending
from steersman.bench.suites import suite
from steersman.cli import app
from steersman.config import build, resolve
from steersman.controllers.policy import Policy
from steersman.controllers.time_gap import TimeGap
from steersman.delivery.controller import Setting, translated
from steersman.encoding import FeatureList
from steersman.episode import Episode, load_episode
from steersman.errors import ConfigError
from steersman.kernels import lead as ahead
from steersman.kernels import reward as judged
from steersman.kernels import world as kernel
from steersman.lead import Lead
from steersman.learning.config import TrainConfig
from steersman.learning.env import PathFollowingEnv
from steersman.learning.export import export_policy
from steersman.learning.fleet import FleetDriver
from steersman.metrics.base import evaluate, metrics
from steersman.report.pack import Blob
from steersman.report.scene import RoadGroup, scenes
from steersman.report.signals import ShownDrive, signals_of, values_of
from steersman.rollout import RunConfig, attempt
from steersman.studies.objective import Prices, measure
from steersman.types import CarAhead, Observation

from .learning.problems import problem
from .loops import CAR, DT, random_net

LAW: dict[str, Any] = {"kind": "time_gap", "inner": "pid"}
TRACE = {"kind": "random_profile", "low": 2.0, "high": 20.0, "interval": 2.0, "change": 3.0}
STEADY = {"kind": "constant_speed", "speed": 12.0}
BEHIND: dict[str, Any] = {
    "joint": True,
    "roads": [{"kind": "circle", "radius": 300.0}],
    "speeds": [{"kind": "constant_speed", "speed": 25.0}],
    "demonstration": {"enabled": False},
    "encoding": {
        "kind": "list",
        "features": ["v_x", "lateral_error", "gap", "relative_speed", "gap_error"],
    },
    "task": {
        "kind": "precise",
        "demonstration": "none",
        "terms": [{"kind": "gap", "weight": 1.0}, {"kind": "jerk", "weight": 0.1}],
    },
    "leads": [{"speed": TRACE, "gap": 20.0, "spread": 0.5}],
}


@cache
def driven(controller: str = "law", seconds: float = 25.0) -> Episode:
    """Behind a car whose speed changes, where 25 m/s are wished."""
    return attempt(behind(LAW if controller == "law" else controller, seconds)).episode


def behind(controller: Any, seconds: float, **lead: Any) -> RunConfig:
    words: dict[str, Any] = {
        "controller": controller,
        "path": {"kind": "circle", "radius": 200.0},
        "speed": {"kind": "constant_speed", "speed": 25.0},
        "lead": {"speed": TRACE} | lead,
        "duration": seconds,
    }
    return build(RunConfig, words)


def figures(found: Episode) -> dict[str, Any]:
    return evaluate(found, metrics(benchmark=True))


# ------------------------------------------------------------------------------------- the world


def test_the_gap_is_the_way_of_one_car_less_that_of_the_other() -> None:
    found = driven()
    way = np.cumsum(0.5 * (found["lead_speed"][1:] + found["lead_speed"][:-1])) * found.dt
    own = np.unwrap(found["s"], period=found.path_length)
    assert found["gap"][1:] == pytest.approx(found["gap"][0] + way - (own[1:] - own[0]), abs=1e-9)


def test_the_car_ahead_drives_its_trace() -> None:
    found = driven()
    times, speeds = build(Lead, {"speed": TRACE}).speed.breakpoints()  # type: ignore[attr-defined]
    assert found["lead_speed"] == pytest.approx(np.interp(found["time"], times, speeds), abs=1e-12)


def test_limits_along_the_road_hold_for_both_cars() -> None:
    run = behind(LAW, 10.0, speed={"kind": "constant_speed", "speed": 24.0})
    capped = run.model_copy(update={"speed": resolve("speed", {"kind": "constant_speed",
                                    "speed": 25.0, "a_lat_max": 0.5})})  # fmt: skip
    found = attempt(capped).episode
    assert found["lead_speed"][1:] == pytest.approx(np.full(len(found) - 1, 10.0), rel=1e-6)


def test_running_into_it_ends_the_drive() -> None:
    tried = attempt(behind("pid", 25.0))
    assert (tried.outcome, tried.episode.end) == ("collided", ending.COLLISION)
    assert not tried.episode.completed
    values = figures(tried.episode)
    assert values["collided"] is True
    assert values["least_gap_m"] == 0.0


def test_without_one_nothing_is_measured_of_it(tmp_path: FilePath) -> None:
    run = behind("pid", 1.0).model_copy(update={"lead": None})
    found = attempt(run).episode
    values = figures(found)
    assert {values[k] for k in ("collided", "least_gap_m", "rms_gap_error_m")} == {None}
    assert "gap" not in found.columns
    driven().save(tmp_path / "behind.npz")
    kept = load_episode(tmp_path / "behind.npz")
    assert np.array_equal(kept["gap"], driven()["gap"])


def test_a_drive_prints_the_gap_where_a_car_is_ahead() -> None:
    words = ["drive", "controller=time_gap", "path=straight", "duration=1"]
    shown = [CliRunner().invoke(app, [*words, *more]).output for more in ((), ("lead.speed=nedc",))]
    assert [text.count("gap to the car ahead") for text in shown] == [0, 1]
    assert [text.count("RMS longitudinal jerk") for text in shown] == [0, 1]


def test_a_page_shows_the_gap_where_a_car_is_ahead() -> None:
    """Of drives on one page that have none, the panel is empty."""
    alone = attempt(behind("pid", 1.0).model_copy(update={"lead": None})).episode
    assert "gap" not in {signal.key for signal in signals_of([alone])}
    (gap,) = (signal for signal in signals_of([alone, driven()]) if signal.key == "gap")
    assert np.array_equal(values_of(gap, driven()), driven()["gap"])
    assert np.isnan(values_of(gap, alone)).all()
    both = [ShownDrive("law", driven(), False), ShownDrive("alone", alone, False)]
    for drives in (both, both[1:]):
        (scene,) = scenes([RoadGroup("road", drives, 1.5)], Blob())
        assert ["gap" in run["columns"] for run in scene["runs"]] == [len(drives) > 1] * len(drives)


def test_speeds_along_the_path_are_none_of_a_car_ahead() -> None:
    for speed in ("constant_throttle", "profile"):
        with pytest.raises(ConfigError, match="has no speeds over time"):
            build(RunConfig, {"lead": {"speed": speed}})


# --------------------------------------------------------------------------------------- the law


def test_the_law_keeps_the_wished_gap() -> None:
    run = behind(LAW, 40.0, speed=STEADY, gap=40.0, standstill=4.0, headway=2.0)
    found = attempt(run).episode
    assert found["gap"][-1] == pytest.approx(4.0 + 2.0 * 12.0, abs=0.3)
    assert found["v_x"][-1] == pytest.approx(12.0, abs=0.1)
    assert found["gap"].min() > 20.0


def test_the_law_is_linear_in_both_errors_and_bounded() -> None:
    law = TimeGap(k_gap=0.3, k_speed=0.5, ahead=0.4, acceleration=2.0, braking=6.0)

    def allowed(gap: float, speed: float) -> float:
        seen = Observation(0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0, np.zeros((4, 2)), 2.0)
        seen = seen._replace(ahead=CarAhead(gap, speed, 18.0))
        return law.step(law.init(CAR, DT), seen)[0].speed_limit

    assert allowed(20.0, -1.0) == pytest.approx(10.0 + 0.4 * (0.3 * 2.0 - 0.5))
    assert allowed(90.0, 0.0) == pytest.approx(10.0 + 0.4 * 2.0)
    assert allowed(1.0, -20.0) == pytest.approx(10.0 - 0.4 * 6.0)


def test_without_a_car_ahead_the_law_drives_as_wished() -> None:
    run = behind(LAW, 5.0).model_copy(update={"lead": None})
    plain = run.model_copy(update={"controller": resolve("controller", "pid")})
    assert np.array_equal(attempt(run).episode["v_x"], attempt(plain).episode["v_x"])


def test_it_is_not_exported_as_if_there_were_no_car_ahead() -> None:
    within = resolve("controller", {"kind": "supervisor", "inner": LAW, "fallback": "pid"})
    for law in (resolve("controller", LAW), within):
        with pytest.raises(ConfigError, match="gap to a car ahead"):
            translated(Setting("law", law, CAR, DT, 15, 2.0))


# ---------------------------------------------------------------------------- benchmark and tuning


def test_a_suite_draws_the_trace_from_its_seed_and_prices_the_gap() -> None:
    one, other = (suite("acc").scenarios([seed])[0].run for seed in (0, 1))
    assert one.lead is not None
    assert other.lead is not None
    assert one.lead.speed != other.lead.speed
    tuned_on = [each.run.lead for each in suite("acc_tuning").scenarios()]
    assert one.lead not in tuned_on
    run = behind(LAW, 8.0)
    free, gap, jerk = (measure(run, Prices(0.0, *p)) for p in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)))
    values = figures(attempt(run).episode)
    assert gap.total - free.total == pytest.approx(values["rms_gap_error_m"])
    assert jerk.total - free.total == pytest.approx(values["rms_longitudinal_jerk_m_s3"])


# ------------------------------------------------------------------------------------- learning


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"leads": []}, "gap needs a car ahead"),
        ({"leads": [], "encoding": FeatureList(features=("v_x", "gap"))}, "needs a car ahead"),
        (
            {"joint": False, "encoding": FeatureList(features=("v_x",)), "task": "precise"},
            "needs an action that changes the speed",
        ),
    ],
)
def test_what_does_not_go_together_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        problem(**{**BEHIND, **changes})


def test_a_learner_meets_the_world_of_a_drive() -> None:
    """Features, reward and collision of the fleet are those of its state; snapshots go on."""
    driver = FleetDriver(problem(**BEHIND), 4)
    driver.seed(3)
    for i in range(driver.n):
        driver.reset(i)
    fleet, kept = driver.fleet, {}
    names = driver.problem.layout.names
    assert len(set(fleet.lead[:, ahead.GAP])) == driver.n  # each its own start
    for k in range(200):
        if k == 20:
            kept = {"saved": driver.snapshot(), "lead": fleet.lead.copy()}
            kept["saved"]["arrays"] = {n: a.copy() for n, a in kept["saved"]["arrays"].items()}
        driver.step(np.tile([0.0, 1.0], (driver.n, 1)))
        gap = names.index("gap [m]")
        seen = fleet.inputs[:, gap] / driver.problem.layout.scale[gap]
        assert seen == pytest.approx(np.minimum(fleet.lead[:, ahead.GAP], 120.0))
        if (fleet.ended == kernel.COLLIDED).any():
            break
    hit = int(np.flatnonzero(fleet.ended == kernel.COLLIDED)[0])
    assert fleet.lead[hit, ahead.GAP] <= 0.0
    assert kernel.COLLIDED in kernel.FAILED
    assert np.isfinite(fleet.reward).all()
    assert fleet.judged[judged.WISHED_GAP] == pytest.approx(3.0 + 1.5 * fleet.judged[judged.SPEED])
    driver.restore(kept["saved"])
    assert np.array_equal(fleet.lead, kept["lead"])


def test_an_environment_ends_with_the_collision() -> None:
    env = PathFollowingEnv(problem(**BEHIND))
    env.reset(seed=1)
    ended = False
    for _ in range(300):
        *_, ended, _, info = env.step([0.0, 1.0])
        assert np.isfinite(info["speed"])
        if ended:
            break
    assert ended


def test_an_exported_policy_drives_behind_a_car_and_needs_one(tmp_path: FilePath) -> None:
    task = problem(**{**BEHIND, "action": "residual", "base": LAW})
    net = random_net(len(task.layout.names), actions=2)
    policy = Policy(file=str(export_policy(net, TrainConfig(problem=task), tmp_path, {})))
    assert policy.follows()
    run = behind("pid", 3.0).model_copy(update={"controller": policy})
    found = attempt(run)
    assert found.error is None
    with pytest.raises(ConfigError, match="needs a car ahead"):
        attempt(run.model_copy(update={"lead": None}))
