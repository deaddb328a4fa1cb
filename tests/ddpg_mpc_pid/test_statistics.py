"""Statistics against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ddpg_mpc_pid import statistics as st


def test_interquartile_mean_of_a_uniform_ramp_is_its_mean() -> None:
    assert st.iqm(np.arange(101)) == pytest.approx(50.0)
    assert st.iqm([7.0]) == 7.0
    assert math.isnan(st.iqm([]))


def test_interquartile_mean_forgets_outliers() -> None:
    assert st.iqm([0.0, 1.0, 2.0, 1e9]) == 1.5


def test_quartiles_agree_with_numpy_and_take_infinity() -> None:
    values = np.random.default_rng(0).normal(size=37)
    assert st.quartiles(values) == pytest.approx(np.quantile(values, [0.25, 0.5, 0.75]))
    assert st.quartiles([1.0, 2.0, math.inf]) == (1.5, 2.0, math.inf)
    assert st.quartiles([1.0, math.inf, math.inf])[1] == math.inf


def test_bootstrap_of_a_mean_has_the_width_of_the_normal_approximation() -> None:
    values = np.random.default_rng(1).normal(3.0, 2.0, 400)
    got = st.bootstrap(lambda a: float(np.mean(a)), values)
    half = 1.96 * values.std() / math.sqrt(values.size)
    assert got.value == pytest.approx(values.mean())
    assert got.high - got.low == pytest.approx(2.0 * half, rel=0.1)
    assert got.low < values.mean() < got.high


def test_bootstrap_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    hits = 0
    for k in range(200):
        a, b = rng.normal(0.0, 1.0, 40), rng.normal(1.0, 1.0, 40)
        got = st.bootstrap(lambda x, y: float(y.mean() - x.mean()), a, b, repetitions=300, seed=k)
        hits += got.low <= 1.0 <= got.high
    assert 0.89 < hits / 200 < 0.99


def test_groups_are_resampled_within_themselves() -> None:
    """Constant groups leave nothing to chance, however different they are."""
    got = st.bootstrap(lambda x, y: float(y.mean() - x.mean()), [1.0, 1.0], [5.0, 5.0, 5.0])
    assert (got.value, got.low, got.high) == (4.0, 4.0, 4.0)


def test_same_seed_same_interval() -> None:
    values = [1.0, 5.0, 2.0, 8.0]
    assert st.bootstrap(st.iqm, values) == st.bootstrap(st.iqm, values)


def test_what_is_empty_or_never_finite_has_no_interval() -> None:
    assert st.bootstrap(st.iqm, []).value is None
    assert st.bootstrap(st.iqm, [math.inf]).value is None


def test_censored_runs_count_as_the_horizon() -> None:
    assert st.first_reach([1, 2], [5.0, 4.0], 1.0) == math.inf
    assert st.restricted_mean([math.inf, math.inf], 20.0) == 20.0
    assert st.saving([20.0, math.inf], [5.0, 10.0], 40.0) == pytest.approx(0.75)
    assert math.isnan(st.saving([0.0], [0.0], 1.0))
