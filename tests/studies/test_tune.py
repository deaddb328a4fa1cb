"""Tuning: never worse than the start, repeatable, resumable, honest about failures."""

from __future__ import annotations

import json
import time
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.bench.suites import suite
from steersman.config import build, override, read_yaml
from steersman.errors import ConfigError
from steersman.metrics.driving import rms_lateral_error, steer_change_rms
from steersman.outcome import Attempt, Interrupted
from steersman.rollout import RunConfig, run
from steersman.studies import objective
from steersman.studies import tune as tuning
from steersman.studies.objective import Prices, RunCost, measure
from steersman.studies.ranges import (
    GainRange,
    TriedValues,
    declared,
    field_bounds,
    ranges,
    widened,
)
from steersman.studies.trials import TuneResult, TuningTrial, TuningTrials, front, importances
from steersman.studies.tune import TuneConfig, cost, tune
from steersman.studies.tune_seeds import SeedsResult, tune_seeds
from steersman.studies.unseen import CLASSES, unseen, warning

RUN = {
    "path": {"kind": "circle", "radius": 30.0},
    "speed": {"kind": "constant_speed", "speed": 8.0},
    "duration": 3.0,
}

ROOT = FilePath(__file__).parents[2]


def study(**changes: Any) -> TuneConfig:
    return build(TuneConfig, {"controller": "pid", "suite": [RUN], "trials": 6} | changes)


def run_cost(controller: Any, **changes: Any) -> float:
    return cost(build(RunConfig, RUN | changes | {"controller": controller}), 0.05)


def test_the_result_is_never_worse_than_the_start(tmp_path: FilePath) -> None:
    result = tune(study(), tmp_path)
    best = result.controller
    assert run_cost(best) <= run_cost("pid")
    assert TuneResult.read(tmp_path / "result.json") == result
    assert result.trials == 6
    assert result.cost_m == pytest.approx(run_cost(best))
    assert result.cost_of_first_trial_m == pytest.approx(run_cost("pid"))


def test_tuned_values_stay_in_their_ranges_and_read_back(tmp_path: FilePath) -> None:
    best = tune(study(), tmp_path).controller
    for name, (low, high, _) in best.search.items():
        value: Any = best
        for part in name.split("."):
            value = getattr(value, part)
        assert low <= value <= high
    run = build(RunConfig, read_yaml(tmp_path / "tuned.yaml"))
    assert run.controller == best


@pytest.mark.parametrize(
    ("other", "key"),
    [
        ({"smoothness": 5.0}, "smoothness"),
        ({"controller": "mpc_pid"}, "controller"),
        ({"controller": {"kind": "pid", "feedforward": True}}, "controller"),
        ({"seed": 9}, "seed"),
    ],
)
def test_another_study_in_the_same_folder_is_refused(
    tmp_path: FilePath, other: dict[str, Any], key: str
) -> None:
    tune(study(trials=2), tmp_path)
    kept = (tmp_path / "result.json").read_bytes()
    with pytest.raises(ConfigError, match=f"with other settings: {key} was"):
        tune(study(**other), tmp_path)
    assert (tmp_path / "result.json").read_bytes() == kept


def test_same_seed_same_result(tmp_path: FilePath) -> None:
    assert tune(study(), tmp_path / "a") == tune(study(), tmp_path / "b")


def test_processes_change_nothing(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    several = study(suite=[RUN, RUN | {"seed": 1}], trials=3)
    alone = tune(several, tmp_path / "one", jobs=1)
    monkeypatch.setattr("steersman.studies.tune._PIECE_SIZE", 1.0)
    assert tune(several, tmp_path / "two", jobs=2) == alone


def test_an_interrupted_study_goes_on(tmp_path: FilePath) -> None:
    seen: list[int] = []

    def stop(number: int, _: float) -> None:
        seen.append(number)
        if number == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tune(study(), tmp_path, stop)
    tune(study(), tmp_path, lambda number, _: seen.append(number))
    assert seen == [1, 2, 3, 4, 5, 6]


def test_a_lock_that_a_killed_study_left_is_no_hindrance(tmp_path: FilePath) -> None:
    tune(study(trials=1), tmp_path)
    (tmp_path / "study.jsonl.lock").symlink_to(tmp_path / "study.jsonl")
    begun = time.monotonic()
    tune(study(trials=2), tmp_path)
    assert time.monotonic() - begun < 10.0  # Optuna would wait for half a minute


def test_leaving_the_road_costs_more_than_staying_on_it_badly() -> None:
    off = run_cost({"kind": "pid", "gains": {"k_p": 0.0, "k_i": 0.0, "k_d": 0.0}}, corridor=0.1)
    assert off > 0.1
    assert run_cost("mpc_pid") < off


@pytest.mark.parametrize("limit", [{"duration": 20.0}, {"duration": None, "laps": 1}])
def test_leaving_the_road_later_costs_less(limit: dict[str, Any]) -> None:
    """With little steering the car leaves later than with steering to the wrong side."""
    none = {"kind": "pid", "gains": {"k_p": 0.0, "k_i": 0.0, "k_d": 0.0}}
    some = {"kind": "pid", "gains": {"k_p": 0.02, "k_i": 0.0, "k_d": 0.0}}
    path = {"kind": "circle", "radius": 200.0}
    far, near = (run_cost(c, path=path, **limit) for c in (some, none))
    assert 0.0 < far < near


def test_a_controller_with_nothing_to_tune_is_refused(tmp_path: FilePath) -> None:

    config = study()
    bare = type("Bare", (type(config.controller),), {"search": {}})
    with pytest.raises(ConfigError, match="nothing to tune"):
        tune(config.model_copy(update={"controller": bare()}), tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_empty_suite_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least one run"):
        build(TuneConfig, override({}, ["suite=[]"]))


def test_a_suite_may_be_given_by_its_name() -> None:
    named = build(TuneConfig, override({}, ["suite=quick"]))
    assert [run for run in named.suite] == [s.run for s in suite("quick").scenarios()]
    assert build(TuneConfig, {}).suite == build(TuneConfig, {"suite": "tuning"}).suite
    with pytest.raises(ConfigError, match="did you mean 'tuning'"):
        build(TuneConfig, override({}, ["suite=tunning"]))


def test_a_study_goes_on_although_its_file_lacks_a_newer_field(tmp_path: FilePath) -> None:
    best = tune(study(trials=2), tmp_path)
    file = tmp_path / "config.yaml"
    lines = file.read_text().splitlines()
    kept = [line for line in lines if line.strip() != "nominal: null"]
    assert len(kept) == len(lines) - 1
    file.write_text("\n".join(kept) + "\n")
    assert tune(study(trials=2), tmp_path) == best


def trade_of(folder: FilePath) -> TuningTrials:
    return TuningTrials.read(folder / "pareto.json")


def test_the_objective_is_told_apart_for_each_trial(tmp_path: FilePath) -> None:
    best = tune(study(trials=3), tmp_path).controller
    trade = trade_of(tmp_path)
    assert len(trade.trials) == trade.measured == 3
    for row in trade.trials:
        parts = (row.tracking_m or 0.0) + (row.smoothness_m or 0.0) + (row.failure_m or 0.0)
        assert parts == pytest.approx(row.cost_m)
        assert row.simulated_seconds == pytest.approx(3.0) or row.failures == 1
    (chosen,) = (row for row in trade.trials if row.chosen)
    episode = run(build(RunConfig, RUN | {"controller": best}))
    assert chosen.rms_error_m == pytest.approx(rms_lateral_error(episode))
    change = steer_change_rms(episode)
    assert chosen.steer_change_rms == pytest.approx(change)
    result = TuneResult.read(tmp_path / "result.json")
    assert result.chosen is not None
    assert result.chosen.number == chosen.number
    assert result.simulated_seconds == sum(r.simulated_seconds or 0.0 for r in trade.trials)
    stored = (tmp_path / "study.jsonl").read_text()
    assert all(stored.count(f'"{name}"') == 3 for name in ("rms_error_m", "simulated_seconds"))


def test_an_interrupted_study_ends_as_if_it_had_not_been(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, real = study(trials=13), tuning.measure  # past the ten that are drawn at random
    whole = tune(config, tmp_path / "whole")
    for drives in (0, 11):  # stopped within the first trial, then within the twelfth
        left = iter(range(drives))

        def stop(*args: Any, left: Any = left) -> RunCost:
            if next(left, None) is None:
                raise KeyboardInterrupt
            return real(*args)

        monkeypatch.setattr(tuning, "measure", stop)
        with pytest.raises(KeyboardInterrupt):
            tune(config, tmp_path / "cut")
    monkeypatch.setattr(tuning, "measure", real)
    resumed = tune(config, tmp_path / "cut")
    assert (resumed.controller, resumed.cost_m) == (whole.controller, whole.cost_m)
    costs = [[r.cost_m for r in trade_of(tmp_path / n).trials] for n in ("whole", "cut")]
    assert costs[0] == costs[1]


def test_a_study_from_before_the_figures_goes_on(tmp_path: FilePath) -> None:
    config = study(trials=3)
    tune(config, tmp_path)
    file = tmp_path / "study.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert sum(bool(line.pop("user_attrs", None)) for line in lines) == 3
    file.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    tune(study(trials=4), tmp_path)
    trade = trade_of(tmp_path)
    assert [row.rms_error_m is None for row in trade.trials] == [True, True, True, False]
    result = TuneResult.read(tmp_path / "result.json")
    assert trade.measured == result.simulated_trials == 1
    assert [row.on_front for row in trade.trials] == [False, False, False, True]


def test_a_controller_that_raises_is_a_failure() -> None:
    config = build(RunConfig, RUN | {"controller": "pid"})

    class Broken(type(config.controller)):  # type: ignore[misc]
        def step(self, state: Any, observation: Any) -> Any:
            raise RuntimeError("broken")

    found = measure(config.model_copy(update={"controller": Broken()}), Prices(0.05))
    assert found.failed
    assert (found.seconds, found.failure) == (0.0, 3.0)
    assert found.total == 3.0


def test_an_interrupted_run_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    config = build(RunConfig, RUN | {"controller": "pid"})

    def cut(_: RunConfig) -> Attempt:
        raise Interrupted(run(config))

    monkeypatch.setattr(objective, "attempt", cut)
    with pytest.raises(KeyboardInterrupt):
        measure(config, Prices(0.05))


@pytest.mark.parametrize("folder", sorted((ROOT / "results" / "tune").iterdir()), ids=str)
def test_studies_of_earlier_versions_load(folder: FilePath) -> None:
    result = TuneResult.read(folder / "result.json")
    if (folder / "pareto.json").exists():  # not in the oldest
        trials = TuningTrials.read(folder / "pareto.json")
        assert result.chosen is not None
        assert trials.chosen().number == result.chosen.number
        assert result.cost_m == trials.chosen().cost_m
        best = [row.number for row in trials.trials if row.on_front]
        assert [trials.trials[i].number for i in front(trials.trials)] == best


def test_the_users_car_and_road_meet_the_whole_suite(tmp_path: FilePath) -> None:
    (tmp_path / "car.yaml").write_text("base: bmw_320i\nmass: 1500\n")
    line = "x,y\n" + "\n".join(f"{5 * k},{0.002 * (5 * k) ** 2}" for k in range(40))
    (tmp_path / "road.csv").write_text(line)
    words = {"vehicle": str(tmp_path / "car.yaml"), "road": str(tmp_path / "road.csv")}
    runs, usual = build(TuneConfig, words).suite, build(TuneConfig, {}).suite
    # What is driven on roads for 60 m/s has no place on another road.
    assert len(runs) == sum(getattr(run.path, "shortest", 0.0) < 90.0 for run in usual)
    assert unseen(runs) == unseen(usual) == []
    assert {run.path.kind for run in runs} == {"csv"}
    assert len({run.start.s for run in runs}) > 1
    light = [run.vehicle.mass for run in runs]
    assert min(light) == pytest.approx(0.85 * 1500.0) or min(light) < 1500.0
    grip = 0.61 * build(TuneConfig, words).vehicle.friction * 9.81  # type: ignore[union-attr]
    assert all((run.speed.a_lat_max or 0.0) <= grip for run in runs if run.vehicle.friction > 1.0)


def test_what_the_runs_do_not_show_is_named() -> None:
    clean = study().suite
    assert set(unseen(clean)) == set(CLASSES)
    said = warning(clean) or ""
    assert all(words in said for words in CLASSES)
    assert "no steering delay" not in (warning(build(TuneConfig, {"suite": "quick"}).suite) or "")
    assert warning(build(TuneConfig, {}).suite) is None


@pytest.mark.parametrize(
    ("given", "value", "wider"),
    [
        (GainRange(0.1, 10.0, True), 9.9, GainRange(0.1, 40.0, True)),
        (GainRange(0.1, 10.0, True), 0.1, GainRange(0.025, 10.0, True)),
        (GainRange(0.0, 2.0, False), 0.05, GainRange(0.0, 2.0, False)),  # the field's bound
        (GainRange(0.0, 2.0, False), 1.95, GainRange(0.0, 3.0, False)),
        (GainRange(0.0, 2.0, False), 1.0, GainRange(0.0, 2.0, False)),
    ],
)
def test_a_range_whose_end_is_pressed_against_is_widened(
    given: GainRange, value: float, wider: GainRange
) -> None:
    assert given.wider(value, (0.0, 100.0)) == wider


def test_ranges_follow_from_the_trials_alone() -> None:
    controller = study(controller="lqr").controller
    first = declared(controller)
    assert ranges(controller, []) == first
    assert widened(controller, first) == []
    best = {name: one.high for name, one in first.items()}
    middle = {name: one.low + 0.5 * (one.high - one.low) for name, one in first.items()}
    tried = [TriedValues(1.0, middle)] * 19 + [TriedValues(0.5, best)]
    assert ranges(controller, tried[:19]) == first
    now = ranges(controller, tried)
    assert all(now[name].high > first[name].high for name in first)
    assert all(now[name].low == first[name].low for name in first)
    assert [said.partition(":")[0] for said in widened(controller, now)] == list(first)
    for name, one in now.items():
        low, high = field_bounds(controller, name)
        assert low <= one.low < one.high <= high


def test_a_search_goes_beyond_a_range_that_is_too_narrow(tmp_path: FilePath) -> None:
    narrow = type(
        "Narrow", (type(study().controller),), {"search": {"gains.k_p": (1e-4, 2e-4, True)}}
    )
    config = study(trials=1)
    start = narrow.model_validate(config.controller.model_dump(exclude={"kind"}))
    many = config.model_copy(update={"controller": start, "trials": 45})
    result = tune(many, tmp_path)
    (said,) = result.widened
    assert said.startswith("gains.k_p: searched from 0.0001 to ")
    assert max(row.parameters["gains.k_p"] for row in trade_of(tmp_path).trials) > 2e-4


def test_importance_is_that_of_the_gain_that_matters() -> None:
    rng = np.random.default_rng(0)
    values = rng.uniform(0.0, 1.0, (60, 2))
    rows = [
        TuningTrial(number=k, cost_m=0.1 + (a - 0.3) ** 2, parameters={"a": a, "b": b})
        for k, (a, b) in enumerate(values)
    ]
    searched = dict.fromkeys("ab", GainRange(0.0, 1.0, False))
    found = importances(rows, searched)
    assert found["a"] > 0.8
    assert sum(found.values()) == pytest.approx(1.0)
    assert importances(rows[:5], searched) == {}


def test_the_median_of_several_seeds_is_kept(tmp_path: FilePath) -> None:
    config = study(trials=3)
    seen: list[int] = []
    result = tune_seeds(config, [0, 1, 2], tmp_path, lambda done, _: seen.append(done))
    assert seen == list(range(1, 10))
    each = {k: TuneResult.read(tmp_path / f"seed_{k}" / "result.json") for k in range(3)}
    assert each[1] == tune(config.model_copy(update={"seed": 1}), tmp_path / "alone")
    costs = sorted(one.cost_m for one in each.values())
    assert result.cost_m == costs[1]
    kept = SeedsResult.read(tmp_path / "seeds.json")
    assert [one.cost_m for one in kept.seeds] == costs
    assert each[kept.median] == result
    assert build(RunConfig, read_yaml(tmp_path / "tuned.yaml")).controller == result.controller
    assert tune_seeds(config, [0, 1, 2], tmp_path, lambda *_: seen.append(0)) == result
    assert 0 not in seen


def test_the_gains_of_a_controller_inside_another_are_tuned_alone(tmp_path: FilePath) -> None:
    config = build(TuneConfig, {"controller": "estimated/tuned/lqr"})
    with pytest.raises(ConfigError, match=r"tune tuned/lqr, then drive estimated/DIR"):
        tune(config, tmp_path / "t")
    assert not (tmp_path / "t").exists()
