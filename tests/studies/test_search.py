"""A search of hyper-parameters: words, rungs, the winner, interruptions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest

import steersman as sm
from steersman.config import build, read_yaml
from steersman.engine.jobs import Workers
from steersman.errors import ConfigError, TrainingDiverged
from steersman.learning.config import TrainConfig
from steersman.studies import search as module
from steersman.studies.search import search
from steersman.studies.search_space import SearchConfig

GAMMA = {"agent.gamma": "0.5..0.99"}
TRAINING = {"steps": 90_000, "validation": {"interval": 10_000}}


def config(**fields: Any) -> SearchConfig:
    return build(SearchConfig, {"training": TRAINING, "ranges": GAMMA, "trials": 12} | fields)


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int | None]]:
    """Trainings whose score is the distance of gamma from 0.9; what was trained, in order."""
    calls: list[tuple[int, int | None]] = []

    def score(order: Any, tell: Callable[[int], None]) -> float | None:
        calls.append((int(order.out.parent.name.partition("_")[2]), order.until))
        tell(order.until or order.config.steps)
        gamma = order.config.agent.gamma
        return None if gamma > 0.98 else abs(gamma - 0.9) + 1e-3 * order.config.seed

    monkeypatch.setattr(module, "_trained", score)
    monkeypatch.setattr(module, "Workers", lambda *_, **__: Workers("local", 1))
    return calls


def test_the_best_finished_trial_wins(tmp_path: FilePath, trained: Any) -> None:
    found = search(config(), tmp_path)
    assert found.rungs == [10_000, 30_000, 90_000]
    finished = [one for one in found.trials if one.state == "finished"]
    assert found.best.score_m == min(one.score_m for one in finished if one.score_m is not None)
    best = build(TrainConfig, read_yaml(tmp_path / "best.yaml"))
    assert abs(best.agent.gamma - 0.9) < 0.05
    assert str(best.agent.gamma) == found.best.settings["agent.gamma"]
    assert found.best.scores_m == pytest.approx(
        [found.best.score_m - 5e-4, found.best.score_m + 5e-4]
    )


def test_poor_trials_stop_early(tmp_path: FilePath, trained: Any) -> None:
    found = search(config(), tmp_path)
    stopped = [one for one in found.trials if one.state == "stopped"]
    assert len(stopped) >= 6
    assert all(one.steps < 90_000 for one in stopped)
    for one in stopped:  # it was not among the best third of those that came to its rung before it
        came = [o for o in found.trials if o.steps >= one.steps and o.number <= one.number]
        better = [o for o in came if o.score_m is not None and o.score_m < (one.score_m or 0.0)]
        assert better


def test_the_whole_training_is_one_rung_if_wanted(tmp_path: FilePath, trained: Any) -> None:
    found = search(config(first=1.0, trials=3), tmp_path)
    assert found.rungs == [90_000]
    assert {one.state for one in found.trials} <= {"finished", "diverged"}
    assert {until for _, until in trained} == {None}


@pytest.mark.parametrize("after", [1, 9, 14, 30])
def test_an_interrupted_search_ends_as_if_it_had_not_been(
    tmp_path: FilePath, trained: Any, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    whole = search(config(), tmp_path / "whole")
    score = module._trained

    def interrupted(order: Any, tell: Any) -> float | None:
        if len(trained) >= total + after:
            raise KeyboardInterrupt
        return score(order, tell)

    total = len(trained)
    monkeypatch.setattr(module, "_trained", interrupted)
    with pytest.raises(KeyboardInterrupt):
        search(config(), tmp_path / "cut")
    monkeypatch.setattr(module, "_trained", score)
    again = search(config(), tmp_path / "cut")
    assert again.trials == whole.trials
    assert again.best == whole.best


def test_more_trials_go_on_in_the_same_folder(tmp_path: FilePath, trained: Any) -> None:
    first = search(config(trials=4), tmp_path)
    count = len(trained)
    more = search(config(trials=6), tmp_path)
    assert more.trials[:4] == first.trials
    assert {number for number, _ in trained[count:]} == {4, 5}
    with pytest.raises(ConfigError, match="with other settings: reduction was 3, now 4"):
        search(config(reduction=4), tmp_path)


def test_trials_that_diverge_end(tmp_path: FilePath, trained: Any) -> None:
    ranges = {"agent.gamma": "0.95..0.989"}
    found = search(config(ranges=ranges), tmp_path / "some")
    assert {one.score_m for one in found.trials if one.state == "diverged"} == {None}
    with pytest.raises(TrainingDiverged, match="all trials diverged"):
        search(config(ranges={"agent.gamma": "0.985..0.989"}, trials=2), tmp_path / "all")


def test_without_ranges_the_agents_own_are_searched() -> None:
    own = config(ranges={})
    names = set(own.searched())
    assert {"agent.gamma", "agent.learning_rate.start", "agent.noise.at"} <= names
    assert "agent.learning_rate.at" not in names  # the schedule has none
    quiet = {"demonstration": {"p_action": {"kind": "constant", "at": 0}}}
    ppo = config(training=TRAINING | {"agent": "ppo", "problem": quiet}, ranges={})
    assert "agent.tau" not in ppo.searched()


@pytest.mark.parametrize(
    ("ranges", "where", "words"),
    [
        ({"agent.gamma": "0.9..1.5"}, "agent.gamma", "1.5"),
        ({"agent.gama": "0.9..0.95"}, "agent.gama", "did you mean 'gamma'"),
        ({"agent.gamma": "0.9..0.9"}, "agent.gamma", "less than the second"),
        ({"agent.gamma": "0..0.9:log"}, "agent.gamma", "must begin above 0"),
        ({"agent": "ddpg|dpg"}, "agent", "ddpg"),
        ({"agent": "ddpg|ddpg"}, "agent", "repeated choice"),
        ({"agent.gamma": "high"}, "agent.gamma", "LOW..HIGH"),
    ],
)
def test_ranges_that_cannot_be_searched(ranges: Any, where: str, words: str) -> None:
    with pytest.raises(ConfigError) as error:
        config(ranges=ranges)
    assert where in str(error.value)
    assert words in str(error.value)


def test_words_of_python_and_of_the_command(tmp_path: FilePath, trained: Any) -> None:
    said: list[tuple[int, str, float]] = []
    found = sm.search(
        "demo",
        "steps=90000",
        "agent.gamma=0.8..0.95",
        "agent.hidden=[32,32]|[64,64]",
        "seeds=3,5",
        trials=3,
        out=tmp_path,
        progress=lambda *all_: said.append(all_),
    )
    assert found.seeds == [3, 5]
    assert found.ranges == {"agent.gamma": "0.8..0.95", "agent.hidden": "[32,32]|[64,64]"}
    assert found.best.settings["agent.hidden"] in {"[32,32]", "[64,64]"}
    assert [number for number, *_ in said[:2]] == [0, 0]


def test_a_winner_at_the_end_of_a_range_is_told(tmp_path: FilePath, trained: Any) -> None:
    found = search(config(ranges={"agent.gamma": "0.5..0.6"}, trials=24), tmp_path)
    assert found.pressed == ["agent.gamma"]
    (line,) = found.remarks()
    end = "high" if float(found.best.settings["agent.gamma"]) > 0.55 else "low"
    assert line.startswith("agent.gamma: the best value, 0.")
    assert line.endswith(f" is at the {end} end of 0.5..0.6; a wider range may help")


def test_workers_do_not_change_what_is_found(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In processes of their own, as real trainings are."""
    monkeypatch.setattr(module, "_trained", by_value(lambda order, tell: order.config.agent.gamma))
    small = {"trials": 2, "together": 2, "seeds": (0,)}
    apart = search(config(**small), tmp_path / "apart", jobs=2)
    monkeypatch.setattr(module, "Workers", lambda *_, **__: Workers("local", 1))
    here = search(config(**small), tmp_path / "here")
    assert apart.trials == here.trials


def by_value(function: Any) -> Any:
    """A function that other processes get by value: they cannot import this module."""
    function.__module__ = "__main__"
    return function
