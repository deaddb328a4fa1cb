"""Pairs of rows: what is paired, differences, ratios, and what has no interval."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from steersman.bench.pairs import Quantity, against, contrast, joined
from steersman.bench.results import BenchRow
from steersman.bench.statistics import Clusters

PATHS = [f"road_{k}" for k in range(8)]


def rows(factor: float = 1.0, paths: Sequence[str] = PATHS, seed: int = 0) -> list[BenchRow]:
    """Three scenarios on each path; roads differ by far more than controllers do."""
    rng = np.random.default_rng(seed)
    out = []
    for path in paths:
        hard = 10.0 ** rng.uniform(-2.0, 0.0)
        for disturbance in ("clean", "heavy", "light"):
            error = factor * hard * rng.uniform(0.9, 1.1)
            row = {
                "scenario": f"{path}/{disturbance}", "path": path, "disturbance": disturbance,
                "controller": "c", "kind": "c", "vehicle": "v", "seed": 0, "speed": "s",
                "dt_s": 0.05, "end": "laps", "completed": True, "driven_share": 1.0,
                "charged_rms_m": error, "charged_mean_m": error, "charged_max_m": error,
                "charged_p95_m": 2.0 * error, "computing_time_s": 0.0,
                "steer_change_rms": 0.01, "steer_reversals_per_min": 5.0,
                "weighted_acceleration_m_s2": 0.3, "control_time_us_p50": 4.0,
            }  # fmt: skip
            out.append(BenchRow.model_validate(row))
    return out


def test_a_factor_is_found_however_much_the_roads_differ() -> None:
    found = against(rows(), rows(0.5))
    figure = found.figures["rms_m"]
    assert figure.ratio.model_dump() == pytest.approx({"value": 0.5, "low": 0.5, "high": 0.5})
    assert figure.own == pytest.approx(0.5 * (figure.base or 0.0))
    assert (figure.difference.high or 0.0) < 0.0
    assert (found.scenarios, found.paths, found.better) == (24, 8, 24)
    assert found.figures["rms_clean_m"].pairs == 8
    assert found.figures["rms_disturbed_m"].pairs == 16


LEVEL = Quantity("level", "m", 1.0, lambda row: row)


@pytest.mark.parametrize(
    ("base", "own", "difference", "ratio"),
    [
        (1e-13, 3e-7, 0.0, None),  # what is rounding is equal
        (1e-13, 0.5, 0.5, None),  # and no measure for others
        (0.5, 1e-13, -0.5, 0.0),
        (0.5, 0.5, 0.0, 1.0),
        (0.0, 0.0, 0.0, None),
    ],
)
def test_rounding_is_equal(base: float, own: float, difference: float, ratio: float | None) -> None:
    draws = Clusters([f"road_{k}" for k in range(6)])
    found = contrast(draws, LEVEL, np.full(6, base), np.full(6, own))
    assert found.difference.value == pytest.approx(difference, abs=1e-5)
    assert found.ratio.value == pytest.approx(ratio, abs=1e-5)
    assert (found.difference.value == 0.0) == (difference == 0.0)
    assert found.ratio.high is None or found.ratio.high < 1.1


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    """Roads differ, and so does what a controller gains on each: whole roads have to be drawn."""
    rng = np.random.default_rng(0)
    names = [f"road_{k}" for k in range(25) for _ in range(6)]
    hits = {"roads": 0, "rows": 0}
    for trial in range(100):
        hard = np.repeat(rng.uniform(1.0, 10.0, 25), 6)
        gain = np.repeat(rng.normal(0.5, 0.3, 25), 6)
        base = hard + rng.normal(0.0, 0.1, 150)
        own = hard + gain + rng.normal(0.0, 0.1, 150)
        rows_alone = [f"{name}_{k}" for k, name in enumerate(names)]
        for key, clusters in (("roads", names), ("rows", rows_alone)):
            draws = Clusters(clusters, repetitions=200, seed=trial)
            found = contrast(draws, LEVEL, base, own).difference
            hits[key] += (found.low or 0.0) <= 0.5 <= (found.high or 0.0)
    assert 0.86 < hits["roads"] / 100 <= 0.99
    assert hits["rows"] / 100 < 0.8  # as if scenarios on one road were independent


def test_exchanging_the_two_negates_differences_and_inverts_ratios() -> None:
    a, b = rows(seed=1), rows(0.8, seed=2)
    one, two = (against(*pair).figures["rms_m"] for pair in ((a, b), (b, a)))
    assert one.difference.value == pytest.approx(-two.difference.value)
    assert one.difference.low == pytest.approx(-two.difference.high)
    assert one.ratio.value == pytest.approx(1.0 / two.ratio.value)
    assert one.ratio.low == pytest.approx(1.0 / two.ratio.high, rel=1e-3)


def test_only_what_both_drove_is_paired() -> None:
    base, own = rows(), rows()[3:]
    assert [a.scenario for a, b in joined(base, own)] == [r.scenario for r in own]
    assert against(base, own).paths == 7
    assert against(base, []).figures == {}


def test_one_path_has_no_interval() -> None:
    found = against(rows(paths=["road_0"]), rows(0.5, paths=["road_0"])).figures["rms_m"]
    assert found.ratio.model_dump() == {"value": pytest.approx(0.5), "low": None, "high": None}
    assert found.pairs == 3


def test_a_ratio_to_nothing_is_undefined() -> None:
    figure = against(rows(), rows()).figures["ended_early"]
    assert figure.difference.model_dump() == {"value": 0.0, "low": 0.0, "high": 0.0}
    assert figure.ratio.model_dump() == {"value": None, "low": None, "high": None}


def test_undefined_values_leave_their_pair_out() -> None:
    own = rows()
    own[0].metrics["steer_reversals_per_min"] = None
    assert against(rows(), own).figures["steer_reversals_per_min"].pairs == 23
