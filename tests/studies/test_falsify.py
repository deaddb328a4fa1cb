"""Falsification: failures are found and pulled in; same seed, same result; never lost."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.bench.grip import demanded_grip
from steersman.config import build, resolve
from steersman.errors import ConfigError, DataError
from steersman.report.falsification import sentences, single_rows
from steersman.rollout import RunConfig, run
from steersman.speed import SpeedTracking
from steersman.studies.falsify import FalsifyConfig, driven_again, falsify
from steersman.studies.findings import FalsifyResult, narrowed
from steersman.studies.hunt import Bracket, most_drives
from steersman.studies.perturbation import Ranges, norm, scaled
from steersman.studies.tried import Tried, drive

ZERO = {"kind": "pid", "gains": {"k_p": 0.0, "k_i": 0.0, "k_d": 0.0}}
NONE = dict.fromkeys(("mass", "friction", "delay", "waypoint_noise", "speed"), 0.0)
BASE = {
    "controller": "pid",
    "path": {"kind": "circle", "radius": 30.0},
    "speed": {"kind": "constant_speed", "speed": 9.0},
    "duration": 3.0,
    "ranges": NONE | {"delay": 0.4, "speed": 0.4},
    "trials": 6,
    "checks": 4,
    "bisections": 3,
}


def config(**changes: Any) -> FalsifyConfig:
    return build(FalsifyConfig, BASE | changes)


def without_origin(result: FalsifyResult) -> dict[str, Any]:
    return {k: v for k, v in result.plain().items() if k not in ("versions", "commit")}


def test_no_gain_is_falsified_by_the_nominal(tmp_path: FilePath) -> None:
    result = falsify(config(controller=ZERO, ranges={}), tmp_path)
    assert result.falsified
    assert result.nominal_failed
    assert len(result.drives) == 1
    assert (result.mildest and result.mildest.norm, result.safe_radius) == (0.0, 0.0)
    assert (result.tried_within, result.singles) == (0, [])
    assert result.ends == {"off_track": 1}
    assert result == FalsifyResult.read(tmp_path / "falsify.json")
    assert result.nearest_holding() is None
    assert [one.what for one in driven_again(result)] == ["fails"]


def test_bisection_agrees_with_a_fine_scan(tmp_path: FilePath) -> None:
    ranges = NONE | {"delay": 0.4}
    one = config(ranges=ranges, trials=0, checks=0, bisections=4)
    (single,) = falsify(one, tmp_path).singles
    grid = [k / 16 for k in range(17)]
    failed = [not run(one.ranges.disturbed(one.run(), {"delay": u})).completed for u in grid]
    first = failed.index(True)
    assert 0 < first < 16
    assert single.failing == grid[first]
    assert grid[first - 1] <= single.holding < grid[first]
    assert single.failing_value == pytest.approx(0.4 * grid[first])


def test_the_bracket_of_one_disturbance_takes_every_drive_of_it_alone() -> None:
    def row(failed: bool, **point: float) -> Tried:
        whole = dict.fromkeys(("mass", "delay"), 0.0) | point
        end = "off_track" if failed else "duration"
        return Tried(
            stage="check", point=whole, norm=norm(whole), failed=failed, end=end, seconds=1.0,
            max_error_m=0.1,
        )  # fmt: skip

    tried = [row(False), row(True, delay=1.0), row(False, delay=0.25), row(True, delay=0.5)]
    tried += [row(False, delay=0.4), row(False, delay=0.45, mass=0.1), row(False, mass=-1.0)]
    tried += [row(False, delay=0.7)]
    bracket = narrowed(Bracket("delay", 0.5, 0.0), tried)
    assert bracket == Bracket("delay", 0.5, 0.4)
    assert narrowed(Bracket("mass", None, -1.0), tried) == Bracket("mass", None, -1.0)


def test_the_mildest_is_no_worse_than_any_and_all_milder_ones_held(tmp_path: FilePath) -> None:
    seen: list[tuple[int, int]] = []
    result = falsify(config(trials=12), tmp_path, lambda done, most, _: seen.append((done, most)))
    mildest, drives = result.mildest, result.drives
    assert mildest is not None
    assert result.falsified
    assert not result.nominal_failed
    assert mildest.norm == min(row.norm for row in drives if row.failed)
    assert mildest.norm == pytest.approx(np.linalg.norm(list(mildest.point.values())))
    alone = [abs(one.failing) for one in result.singles if one.failing is not None]
    assert mildest.norm <= min(alone)
    below = [row for row in drives if row.norm < result.safe_radius]
    assert result.tried_within == len(below)
    assert not any(row.failed for row in below)
    one = config()
    again = run(one.ranges.disturbed(one.run(), mildest.point))
    assert again.end == mildest.end
    failing, holding = driven_again(result)
    assert (failing.what, failing.episode.end) == ("fails", mildest.end)
    assert (holding.what, holding.episode.completed) == ("holds", True)
    far = [
        np.subtract([*row.point.values()], [*mildest.point.values()])
        for row in drives
        if not row.failed
    ]
    gap = np.subtract([*holding.point.values()], [*mildest.point.values()])
    assert np.linalg.norm(gap) == min(map(np.linalg.norm, far))
    assert mildest.values["delay_s"] == pytest.approx(
        0.4 * mildest.point["delay"], abs=0.005
    )  # whole substeps of 10 ms
    assert {most for _, most in seen} == {most_drives(config(trials=12))}
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_where_nothing_fails_it_says_how_far_was_tried(tmp_path: FilePath) -> None:
    tame = config(controller="mpc_pid", ranges=NONE | {"mass": 0.05, "speed": 0.05})
    result = falsify(tame, tmp_path)
    assert not result.falsified
    assert result.mildest is None
    assert result.safe_radius == max(row.norm for row in result.drives)
    assert result.tried_within == len(result.drives)
    assert [one.failing for one in result.singles] == [None] * 4


def test_same_seed_same_result_also_after_interruptions(tmp_path: FilePath) -> None:
    whole = without_origin(falsify(config(), tmp_path / "whole"))
    assert without_origin(falsify(config(), tmp_path / "again")) == whole
    cut = tmp_path / "cut"
    for most in (3, 14):
        count = iter(range(most))

        def stop(*_: Any, count: Any = count) -> None:
            if next(count, None) is None:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            falsify(config(), cut, stop)
        with (cut / "drives.jsonl").open("a") as stream:
            stream.write('{"stage": "sea')  # torn
    assert without_origin(falsify(config(), cut)) == whole
    other = falsify(config(seed=1), tmp_path / "other")
    assert other.plain()["drives"] != whole["drives"]


def test_a_finished_search_drives_nothing_again(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = falsify(config(trials=2, checks=1), tmp_path)
    monkeypatch.setattr("steersman.studies.tried.attempt", None)
    assert falsify(config(trials=2, checks=1), tmp_path) == first


def test_another_study_in_the_same_folder_is_refused(tmp_path: FilePath) -> None:
    falsify(config(controller=ZERO), tmp_path)
    with pytest.raises(ConfigError, match="with other settings: ranges was"):
        falsify(config(controller=ZERO, ranges=NONE | {"mass": 0.1}), tmp_path)
    falsify(config(controller=ZERO, trials=7), tmp_path)  # more of the same
    (tmp_path / "drives.jsonl").write_text("[]\n")
    with pytest.raises(DataError, match="line 1: not a drive"):
        falsify(config(controller=ZERO), tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ranges": NONE}, "ranges: all are 0"),
        ({"ranges": {"friction": 4.0}}, "ranges.friction: 4 is not allowed; must be less than"),
        ({"ranges": {"delay": 5.0}}, "ranges.delay: .* too long; at most 0.7 s"),
        ({"ranges": {"mass": 1.0}}, "ranges.mass: 1.0 is not allowed; must be less than 1"),
        ({"ranges": {"mas": 0.1}}, "did you mean 'mass'"),
        ({"speed": "constant_throttle"}, "speed: the speeds of 'constant_throttle' cannot be"),
        ({"laps": 1}, "laps: give laps or duration, not both"),
    ],
)
def test_what_cannot_be_searched_is_told(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config(**changes)


def test_a_speed_that_cannot_be_scaled_is_left_alone() -> None:
    one = config(speed="constant_throttle", ranges=NONE | {"mass": 0.2})
    assert one.ranges.disturbed(one.run(), {"mass": 0.0}) == one.run()


@pytest.mark.parametrize("kind", ["constant_speed", "nedc", "random_profile"])
def test_scaled_speeds_are_those_times_the_factor(kind: str) -> None:
    speed = resolve("speed", kind)
    assert isinstance(speed, SpeedTracking)
    faster = scaled(speed, 1.25)
    assert isinstance(faster, SpeedTracking)
    for new, old, factor in zip(faster.breakpoints(), speed.breakpoints(), (1, 1.25), strict=True):
        assert new == pytest.approx(factor * old)


def test_the_speeds_of_a_road_are_scaled_by_their_factor() -> None:
    assert scaled(resolve("speed", "path"), 1.25).model_dump()["scale"] == 1.25


def test_a_bend_that_cannot_be_driven_is_no_failure(tmp_path: FilePath) -> None:
    """In bends speeds are lower on ice, but what braking asks for stays: there grip ends."""
    brakes = {"kind": "stop_and_go", "speed": 9.0, "change": 5.0, "hold": 3.0, "stand": 0.5}
    some = {"trials": 2, "checks": 3, "duration": 8.0, "ranges": NONE | {"friction": 0.1}}
    one = config(controller="tuned/lqr", speed=brakes, **some)
    result = falsify(one, tmp_path / "out")
    (single,) = result.singles
    run, ranges_ = one.run(), one.ranges
    shares = [demanded_grip(ranges_.disturbed(run, row.point)) for row in result.drives]
    assert 0.85 < max(shares) <= 0.9
    assert result.grip_share == pytest.approx(shares[0])
    assert (single.failing, single.at_grip) == (None, True)
    assert single.holding_value == pytest.approx(0.8, abs=0.05)
    assert single_rows(result)[0]["fails"] == "not found; grip ends"
    beyond = drive("", {"friction": 1.0}, ranges_.disturbed(run, {"friction": 1.0}), 0.9)
    assert (beyond.end, beyond.failed) == ("off_track", False)
    assert beyond.grip_share is not None
    assert beyond.grip_share > 0.9


def test_an_undisturbed_run_beyond_grip_says_so(tmp_path: FilePath) -> None:
    one = config(speed={"kind": "constant_speed", "speed": 40.0}, ranges=NONE | {"delay": 0.1})
    result = falsify(one, tmp_path)
    assert result.nominal_failed
    assert "path and speeds ask an axle for" in sentences(result)[0]


def test_the_nominal_point_is_the_run_itself() -> None:
    undisturbed = build(RunConfig, {"speed": "constant_speed"})
    ranges = Ranges()
    assert ranges.disturbed(undisturbed, dict.fromkeys(ranges.names(), 0.0)) == undisturbed


def test_the_ends_of_the_ranges_are_their_values() -> None:
    undisturbed = build(RunConfig, {"speed": "constant_speed"})
    ends = dict.fromkeys(Ranges().names(), 1.0)
    worst = Ranges().disturbed(undisturbed, ends)
    car = undisturbed.vehicle
    assert worst.vehicle.mass == pytest.approx(1.5 * car.mass)
    assert worst.vehicle.yaw_inertia == pytest.approx(1.5 * car.yaw_inertia)
    assert worst.vehicle.friction == pytest.approx(0.3)
    assert worst.nominal == car
    assert worst.plant.steering_delay == 0.5
    assert worst.sensor.error_range == 0.5
    assert worst.speed.model_dump()["speed"] == pytest.approx(15.0)
    half = Ranges().disturbed(undisturbed, {"friction": 0.5})
    assert half.vehicle.friction == pytest.approx((0.3 * car.friction) ** 0.5)


def test_processes_change_nothing(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = without_origin(falsify(config(), tmp_path / "one", jobs=1))
    monkeypatch.setattr("steersman.studies.hunt.PIECE_SIZE", 1.0)
    monkeypatch.setattr("steersman.engine.jobs._PIECE_JOBS", 1)
    assert without_origin(falsify(config(), tmp_path / "two", jobs=2)) == whole
