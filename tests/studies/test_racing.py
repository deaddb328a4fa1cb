"""Racing: dear runs first, a hopeless trial stopped, and nothing else changed by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.config import build, dump
from steersman.rollout import RunConfig
from steersman.studies import racing
from steersman.studies import tune as tuning
from steersman.studies.objective import RunCost
from steersman.studies.racing import affordable, bound, raced
from steersman.studies.trials import TuningTrials
from steersman.studies.tune import TuneConfig, tune


def priced(costs: Sequence[float]) -> Any:
    return lambda numbers: [RunCost(costs[k], 0.0, 0.0, 0.0, 0.0, False, 1.0) for k in numbers]


def test_a_trial_that_is_certain_to_cost_more_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(racing, "_ROUND", 2)
    costs = [1.0, 9.0, 2.0, 8.0, 1.0, 1.0]
    order = [1, 3, 2, 0, 4, 5]
    whole = raced(priced(costs), order, math.inf)
    assert set(whole) == set(range(6))
    assert bound(whole, 6) == pytest.approx(sum(costs) / 6)
    part = raced(priced(costs), order, 2.5)
    assert set(part) == {1, 3}
    assert bound(part, 6) == pytest.approx(17 / 6)
    assert set(raced(priced(costs), order, 3.0)) == {1, 3, 2, 0}


def test_the_first_trials_are_never_stopped() -> None:
    assert affordable([0.1, 0.2]) == math.inf
    assert affordable([0.3, 0.1, 0.2]) == 0.3


def test_racing_finds_what_whole_trials_find(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measured(config: RunConfig, _: float) -> RunCost:
        gains = (dump(config.controller) or {})["gains"]
        error = sum(math.log(gains[name]) ** 2 for name in ("k_p", "k_i")) * config.start.s
        return RunCost(error, 0.0, 0.0, error, 0.0, False, 1.0)

    monkeypatch.setattr(tuning, "measure", measured)
    suite = [{"path": "circle", "start": float(k)} for k in (1, 4, 2, 3)]
    given = build(TuneConfig, {"controller": "pid", "suite": suite, "trials": 40})
    monkeypatch.setattr(racing, "_ROUND", 1)
    found = tune(given, tmp_path / "raced", jobs=1)
    trials = TuningTrials.read(tmp_path / "raced/pareto.json").trials
    stopped = [one for one in trials if one.rms_error_m is None]
    assert stopped
    assert all(one.cost_m > found.cost_m for one in stopped)
    assert all(one.simulated_seconds < 4.0 for one in stopped if one.simulated_seconds)
    monkeypatch.setattr(tuning, "affordable", lambda _: math.inf)
    whole = tune(given, tmp_path / "whole", jobs=1)
    others = TuningTrials.read(tmp_path / "whole/pareto.json").trials
    assert found.controller == whole.controller
    assert found.cost_m == pytest.approx(whole.cost_m)
    assert [one.parameters for one in trials] == [one.parameters for one in others]
    assert all(
        one.cost_m <= other.cost_m + 1e-12 for one, other in zip(trials, others, strict=True)
    )
