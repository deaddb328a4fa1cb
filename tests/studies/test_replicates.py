"""Methods over their seeds: interquartile means, their intervals, probability of improvement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from steersman.bench.results import BenchRow
from steersman.studies.compare.replicates import Runs, compare_replicates, median_run


def row(scenario: int, error: float) -> BenchRow:
    return BenchRow(
        controller="any",
        kind="any",
        scenario=str(scenario),
        path="p",
        speed="s",
        disturbance="clean",
        vehicle="v",
        seed=0,
        applied={},
        dt_s=0.05,
        end="duration",
        driven_share=1.0,
        charged_rms_m=error,
        charged_mean_m=error,
        charged_p95_m=error,
        charged_max_m=error,
        metrics={"completed": error < 1.0},
        computing_time_s=0.0,
    )


def method(errors: Sequence[Sequence[float]]) -> Runs:
    """A list of errors for each seed."""
    return {
        f"seed {k}": [row(i, error) for i, error in enumerate(run)] for k, run in enumerate(errors)
    }


def test_interquartile_mean_and_lost_drives() -> None:
    found = compare_replicates({"a": method([[0.0, 1.0, 2.0, 90.0], [1.0, 2.0, 3.0, 4.0]])})
    [one] = found.methods
    assert one.iqm_m.value == pytest.approx(np.mean([1.0, 2.0, 2.0, 3.0]))
    assert [run.lost for run in one.runs] == [3, 4]


def test_a_method_against_itself_is_better_half_of_the_time() -> None:
    errors = np.random.default_rng(0).uniform(size=(5, 12)).tolist()
    [found] = compare_replicates({"a": method(errors), "b": method(errors)}).improvements
    assert found.probability.value == pytest.approx(0.5)
    assert found.probability.low is not None
    assert found.probability.high is not None
    assert found.probability.low < 0.5 < found.probability.high


def test_probabilities_of_both_directions_add_up_to_one() -> None:
    rng = np.random.default_rng(1)
    a, b = (method(rng.uniform(size=(k, 9)).round(1).tolist()) for k in (4, 6))
    [one] = compare_replicates({"a": a, "b": b}).improvements
    [two] = compare_replicates({"b": b, "a": a}).improvements
    assert one.probability.value is not None
    assert two.probability.value == pytest.approx(1.0 - one.probability.value)


def test_runs_that_differ_as_a_whole_make_wide_intervals() -> None:
    """One policy drives all scenarios, so that many scenarios do not make up for few seeds."""
    levels = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    errors = np.repeat(levels[:, None], 200, axis=1).tolist()
    [one] = compare_replicates({"a": method(errors)}).methods
    assert one.iqm_m.low is not None
    assert one.iqm_m.high is not None
    assert one.iqm_m.high - one.iqm_m.low > 0.15


def test_one_run_has_no_interval() -> None:
    [one] = compare_replicates({"a": method([[0.1, 0.2]])}).methods
    assert (one.iqm_m.low, one.iqm_m.high) == (None, None)


def test_only_scenarios_that_all_drove_count() -> None:
    found = compare_replicates({"a": method([[0.1, 0.2, 0.9]]), "b": method([[0.3, 0.1]])})
    assert found.scenarios == 2
    assert found.improvements[0].probability.value == 0.5


def test_the_run_of_median_error_stands_for_a_method() -> None:
    assert median_run(method([[0.9], [0.1], [0.3]])) == "seed 2"
    assert median_run(method([[0.9], [0.1]])) == "seed 0"
