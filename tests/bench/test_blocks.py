"""Bootstrap over blocks: block lengths and intervals of series with a known correlation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.bench.statistics import Blocks, block_length


def autoregressive(n: int, rho: float, seed: int) -> np.ndarray:
    """A series of unit variance whose neighbours correlate by ``rho``."""
    noise = np.random.default_rng(seed).normal(size=n) * math.sqrt(1.0 - rho**2)
    out = np.empty(n)
    out[0] = noise[0] / math.sqrt(1.0 - rho**2)
    for k in range(1, n):
        out[k] = rho * out[k - 1] + noise[k]
    return out


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_the_length_of_blocks_is_that_of_the_closed_form(rho: float) -> None:
    """For an AR(1) series G / g(0) = 2 rho / (1 - rho^2), so b = (1.5 (G / g(0))^2 n)^(1/3)."""
    n = 4000
    expected = (1.5 * (2.0 * rho / (1.0 - rho**2)) ** 2 * n) ** (1.0 / 3.0)
    found = np.median([block_length(autoregressive(n, rho, seed)) for seed in range(9)])
    assert found == pytest.approx(expected, rel=0.2)


def test_independent_items_need_no_blocks() -> None:
    series = np.random.default_rng(0).normal(size=2000)
    assert block_length(series) < 6.0
    assert block_length(np.ones(100)) == 1.0
    assert block_length([1.0, 2.0]) == 1.0
    assert block_length([]) == 1.0


def test_a_trend_gets_long_blocks_but_several() -> None:
    for n in (90, 900):
        longest = math.ceil(min(3.0 * math.sqrt(n), n / 3.0))
        assert longest / 2.0 < block_length(np.arange(float(n))) <= longest


def test_blocks_cover_the_mean_of_a_correlated_series_where_single_items_do_not() -> None:
    hits = {"blocks": 0, "items": 0}
    for seed in range(100):
        series = autoregressive(800, 0.8, seed)
        for name, length in (("blocks", math.ceil(block_length(series))), ("items", 1)):
            found = Blocks(800, length, repetitions=300, seed=seed).interval(
                lambda mean, values=series: mean(values)
            )
            hits[name] += found.low <= 0.0 <= found.high
    assert hits["blocks"] >= 85
    assert hits["items"] <= 65


def test_means_are_those_of_the_items_drawn() -> None:
    """With one block as long as the series every draw is a rotation of it."""
    values = np.array([1.0, 2.0, 6.0])
    found = Blocks(3, 3).interval(lambda mean: mean(values))
    assert found == pytest.approx((3.0, 3.0, 3.0))
    assert math.isnan(Blocks(0, 1).interval(lambda mean: mean([])).value)


def test_what_two_series_have_in_common_cancels() -> None:
    base = autoregressive(500, 0.9, 3)
    found = Blocks(500, 20).interval(lambda mean: mean(base + 0.25) - mean(base))
    assert found == pytest.approx((0.25, 0.25, 0.25))
