"""Random roads of benchmark and tuning: drivable, decided by their seed, unlike each other."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from steersman.kernels import path as kernel
from steersman.paths.generated import (
    ClothoidRoad,
    GeneratedRoad,
    HarmonicRoad,
    SplineRoad,
    SurveyedRoad,
)
from steersman.types import FloatArray

KINDS = (ClothoidRoad, HarmonicRoad, SplineRoad, SurveyedRoad)


def bends(road: GeneratedRoad) -> FloatArray:
    """Curvature every metre [1/m]."""
    return np.array([road.at(s).curvature for s in range(round(road.length))])


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_decides_the_road(kind: type[GeneratedRoad]) -> None:
    first, again, other = kind(seed=3), kind(seed=3), kind(seed=4)
    assert np.array_equal(first.table.pieces, again.table.pieces)
    assert not np.array_equal(bends(first), bends(other))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("radius", [8.0, 40.0])
def test_a_road_is_as_long_as_asked_and_bends_as_much_as_allowed(
    kind: type[GeneratedRoad], radius: float
) -> None:
    road = kind(seed=1, distance=350.0, min_radius=radius)
    assert road.length == pytest.approx(350.0)
    assert not road.closed
    assert np.max(np.abs(road.table.pieces[:, kernel.KAPPA0])) <= 1.0 / radius + 1e-12


def test_equal_seeds_of_two_kinds_have_nothing_in_common() -> None:
    for one, other in itertools.combinations(KINDS, 2):
        found = [np.corrcoef(bends(one(seed=k)), bends(other(seed=k)))[0, 1] for k in range(8)]
        assert abs(np.mean(found)) < 0.3, (one.kind, other.kind)


def test_each_kind_has_a_shape_of_its_own() -> None:
    """Only a survey leaves straights; only sines have no corner in their curvature."""

    def median(kind: type[GeneratedRoad], measure: Callable[[FloatArray], float]) -> float:
        return float(np.median([measure(bends(kind(seed=k))) for k in range(8)]))

    straight = {
        kind: median(kind, lambda found: float(np.mean(np.abs(found) < 1e-3))) for kind in KINDS
    }
    assert straight[SurveyedRoad] > 2.0 * max(straight[k] for k in KINDS if k is not SurveyedRoad)
    kinks = {kind: median(kind, lambda found: np.max(np.abs(np.diff(found, 2)))) for kind in KINDS}
    assert kinks[HarmonicRoad] < 0.5 * min(kinks[k] for k in KINDS if k is not HarmonicRoad)
