"""The study of ways to use a demonstrator: its trainings, and how it counts."""

from __future__ import annotations

import numpy as np
import pytest

from ..scripts import script

study = script("benchmarks/demonstration.py")


@pytest.mark.parametrize("agent", ["ddpg", "td3", "sac"])
def test_every_method_is_a_training_of_its_own(agent: str) -> None:
    found = [study.config(method, agent, 0, 20_000) for method in study.methods(20_000)]
    assert len({repr(each.model_dump()) for each in found}) == len(found)
    assert {each.steps for each in found} == {20_000}
    shown = [each.problem.demonstration for each in found]
    assert not shown[0].enabled
    assert max(d.warm_start.steps for d in shown if d.warm_start) == 2000
    assert len({repr(each.validation) for each in found}) == 1


def test_a_ratio_is_that_of_paired_seeds() -> None:
    base = [100.0, 400.0, 50.0]
    assert study.ratio([50.0, 200.0, 25.0], base) == "0.50 [0.50, 0.50]"
    logs = np.log([0.5, 0.25, 0.125])
    half = 4.302653 * logs.std(ddof=1) / 3**0.5
    own = [50.0, 100.0, 6.25]
    expected = [np.exp(logs.mean() + k * half) for k in (0, -1, 1)]
    assert study.ratio(own, base) == "{:.2f} [{:.2f}, {:.2f}]".format(*expected)


def test_the_table_has_all_stages() -> None:
    one = {"lost": 3, "off_track": 7.0, "cpu_seconds": 12.0, "validation_mm": 9.0}
    one["median_regret_mm"] = 5.0
    found = {
        name: {s: {at: {**one, "regret_mm": r * (s + 1)} for at in (10, 20)} for s in (0, 1)}
        for name, r in (("nothing", 200.0), ("loss", 100.0), ("cloning", 50.0))
    }
    lines = study.markdown({**found, "failed": {}}, [10, 20]).splitlines()
    assert len(lines) == 5
    assert lines[3].startswith(
        "| loss | 9 [9, 9] | 9 [9, 9] | 150 [100, 200] | 5 [5, 5] | 0.50 [0.50, 0.50] | 3 [3"
    )
