"""The summary: pooled errors, paired ratios, intervals that know that roads differ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from steersman.bench.disturbance import Disturbance
from steersman.bench.entrants import entrants
from steersman.bench.results import BenchRow, IntervalEstimate
from steersman.bench.statistics import Clusters
from steersman.bench.summary import summarise_rows
from steersman.cli.bench import _cells
from steersman.episode import COLLISION

PID, MPC = entrants(["pid", "mpc_pid"])


def row(
    controller: str, path: str, rms: float, disturbance: str = "clean", **words: Any
) -> BenchRow:
    figures = {f"disturbance_{name}": v for name, v in Disturbance().figures().items()}
    return BenchRow.model_validate(figures | {
        "controller": controller, "path": path, "disturbance": disturbance, "kind": controller,
        "scenario": f"{path}/{disturbance}", "completed": True, "end": "duration", "fallbacks": 0,
        "charged_rms_m": rms, "charged_mean_m": rms, "charged_p95_m": rms, "charged_max_m": rms,
        "steer_change_rms": 0.01, "steer_reversals_per_min": 3.0, "vehicle": "v", "seed": 0,
        "control_time_us_p50": 5.0, "control_time_us_p99": 9.0, "computing_time_s": 0.01,
        "speed": "constant", "interventions": 0, "intervened_s": 0.0, "driven_share": 1.0,
        "path_acceleration_m_s2": 2.0, "iso_11270": True, "r79": False, "saturated_share": 0.0,
        "weighted_acceleration_m_s2": 0.3, "deadline_misses_50ms": 0, "deadline_misses_10ms": 1,
        "duration_s": 10.0, "dt_s": 0.05,
    } | words)  # fmt: skip


def test_errors_are_pooled_as_root_mean_squares() -> None:
    rows = [row("pid", "a", 0.3), row("pid", "b", 0.4, "soft")]
    found = summarise_rows(rows, [PID]).controllers["pid"]
    assert found.all.rms_m.value == pytest.approx(np.sqrt(0.125))
    assert found.clean.rms_m.value == pytest.approx(0.3)
    assert found.disturbed.rms_m.value == pytest.approx(0.4)
    assert found.ratio is not None
    assert found.ratio["all"].rms == IntervalEstimate(value=1.0, low=1.0, high=1.0)


def test_tables_tell_collisions_gap_and_jerk_where_a_car_is_ahead() -> None:
    behind = {"rms_gap_error_m": 0.3, "rms_longitudinal_jerk_m_s3": 1.2}
    hit = {"end": COLLISION, "completed": False, "driven_share": 0.5}
    rows = [row("pid", "a", 0.3, **behind), row("pid", "b", 0.4, **behind, **hit)]
    found = summarise_rows(rows, [PID]).controllers["pid"]
    assert _cells(found) == _cells(found) | {"hit": "1/2", "gap": "0.3", "jerk": "1.2"}
    alone = [row("pid", "a", 0.3, rms_longitudinal_jerk_m_s3=1.2), row("pid", "b", 0.4, **hit)]
    free = summarise_rows(alone, [PID]).controllers["pid"]
    assert {_cells(free)[k] for k in ("hit", "gap", "jerk")} == {""}


def test_ratios_are_paired() -> None:
    """Roads differ by far more than controllers: only pairs tell that one is always half."""
    errors = np.exp(np.random.default_rng(0).normal(-3.0, 1.0, 40))
    rows = [row("pid", f"road{i}", e) for i, e in enumerate(errors)]
    rows += [row("mpc_pid", f"road{i}", 0.5 * e) for i, e in enumerate(errors)]
    found = summarise_rows(rows, [PID, MPC])
    assert found.best_classical == "mpc_pid"
    assert list(found.controllers) == ["mpc_pid", "pid"]
    for kind in ("rms", "typical"):
        ratio = getattr((found.controllers["pid"].ratio or {})["all"], kind)
        assert ratio.low == pytest.approx(ratio.high) == pytest.approx(2.0)
    width = found.controllers["pid"].all.rms_m
    assert (width.high or 0.0) > 1.3 * (width.low or 1.0)


def test_a_lost_drive_counts_before_the_typical_error_and_that_before_the_pooled_one() -> None:
    """An error that all have decides a pooled one; it does not make a controller the best."""
    rows = [row("pid", f"road{i}", e) for i, e in enumerate((0.02, 0.02, 0.5))]
    rows += [row("mpc_pid", f"road{i}", e) for i, e in enumerate((0.001, 0.001, 0.51))]
    assert list(summarise_rows(rows, [PID, MPC]).controllers) == ["mpc_pid", "pid"]
    rows[3] = row("mpc_pid", "road0", 0.001, completed=False)
    assert summarise_rows(rows, [PID, MPC]).best_classical == "pid"


def test_only_learned_controllers_have_nothing_to_be_compared_with() -> None:
    found = summarise_rows([row("pid", "a", 0.1)], [PID._replace(learned=True)])
    assert found.best_classical is None
    assert "ratio" not in found.plain()["controllers"]["pid"]


def test_clusters_are_drawn_as_a_whole() -> None:
    """Ten alike items of a road say no more than one: the interval stays as wide."""
    rng = np.random.default_rng(1)
    values = rng.normal(0.0, 1.0, 50)
    names = [f"road{i}" for i in range(50)]
    one = Clusters(names).interval(lambda mean: mean(values))
    ten = Clusters(names * 10).interval(lambda mean: mean(np.tile(values, 10)))
    assert ten == pytest.approx(one)
    assert one.value == pytest.approx(values.mean())
    # The normal approximation of the mean of 50.
    assert one.high - one.low == pytest.approx(2 * 1.96 * values.std() / np.sqrt(50), rel=0.1)


def test_no_items_have_no_interval() -> None:
    assert np.isnan(Clusters([]).interval(lambda mean: mean([]))).all()


def test_profiles_are_shares_within_a_factor_of_the_best() -> None:
    rows = [row("pid", "a", 0.1), row("pid", "b", 0.4)]
    rows += [row("mpc_pid", "a", 0.2), row("mpc_pid", "b", 0.1, completed=False)]
    found = summarise_rows(rows, [PID, MPC]).profiles
    at = dict(zip(found.factors, zip(*found.shares.values(), strict=True), strict=True))
    # On b nobody but pid arrived, so that it is the best there; the other never counts.
    assert at[1.0] == (1.0, 0.0)
    assert at[2.0] == (1.0, 0.5)
    assert at[found.factors[-1]] == (1.0, 0.5)
    for shares in found.shares.values():
        assert shares == sorted(shares)


def test_standards_are_judged_where_the_road_allows_them() -> None:
    rows = [row("pid", "a", 0.1, path_acceleration_m_s2=2.9), row("pid", "b", 0.1, r79=True)]
    rows += [row("mpc_pid", "a", 0.1, path_acceleration_m_s2=3.1), row("mpc_pid", "b", 0.1)]
    found = summarise_rows(rows, [PID, MPC]).controllers
    assert found["pid"].gentle_runs == 1  # a asks for too much, as one of them found out
    assert found["pid"].r79_share == 1.0
    assert found["mpc_pid"].r79_share == 0.0
    assert found["pid"].control_steps == 400


def test_sweeps_are_ordered_and_hold_nothing_else() -> None:
    names = {"slow": 0.2, "clean": 0.0, "quick": 0.05}
    rows = [row("pid", "a", 0.1, n, disturbance_delay=v) for n, v in names.items()]
    rows.append(row("pid", "a", 0.1, "both", disturbance_delay=0.1, disturbance_mass=1.2))
    sweeps = summarise_rows(rows, [PID]).sweeps
    assert [step.disturbance for step in sweeps["delay"]] == ["clean", "quick", "slow"]
    assert [step.value for step in sweeps["delay"]] == [0.0, 0.05, 0.2]
    assert sweeps["friction"] == []


def test_errors_by_a_factor_add_up() -> None:
    rows = [row("pid", "a", 0.3), row("pid", "b", 0.4), row("pid", "b", 0.5, "soft")]
    found = summarise_rows(rows, [PID]).by
    assert list(found["path"]) == ["a", "b"]
    assert found["path"]["b"]["pid"].rms_m.value == pytest.approx(np.sqrt(0.205))
    assert found["disturbance"]["soft"]["pid"].runs == 1


def test_interventions_are_counted_in_every_group() -> None:
    rows = [row("pid", "a", 0.3, interventions=2, intervened_s=4.0), row("pid", "b", 0.4)]
    rows += [row("pid", "a", 0.4, "soft", interventions=1, intervened_s=0.5)]
    found = summarise_rows(rows, [PID])
    pid = found.controllers["pid"]
    assert [pid.errors(name).interventions for name in ("all", "clean", "disturbed")] == [3, 2, 1]
    assert (pid.interventions, pid.intervened_s) == (3, 4.5)
    assert found.by["disturbance"]["soft"]["pid"].interventions == 1


def test_two_ways_of_clusters_are_drawn_both() -> None:
    """Values of road + seed: the variance of the mean is that of both, each over its number."""
    rng = np.random.default_rng(3)
    roads, seeds = rng.normal(0.0, 1.0, 40), rng.normal(0.0, 1.0, 10)
    values = (roads[:, None] + seeds[None, :]).ravel()
    names = [f"road{i}" for i in range(40) for _ in range(10)]
    other = [f"seed{j}" for _ in range(40) for j in range(10)]
    found = Clusters(names, other).interval(lambda mean: mean(values))
    spread = np.sqrt(roads.var() / 40 + seeds.var() / 10)
    assert found.value == pytest.approx(values.mean())
    assert found.high - found.low == pytest.approx(2 * 1.96 * spread, rel=0.15)
    alone = Clusters(names).interval(lambda mean: mean(values))
    assert alone.high - alone.low < 0.8 * (found.high - found.low)


def test_a_median_has_the_interval_of_its_draws() -> None:
    values = np.random.default_rng(5).exponential(1.0, 101)
    clusters = Clusters([f"road{i}" for i in range(101)])
    found = clusters.median(values)
    assert found.value == np.median(values)
    # The exact interval of a median between order statistics.
    low, high = np.sort(values)[[40, 60]]
    assert (found.low, found.high) == pytest.approx((low, high), rel=0.12)
    assert np.isnan(Clusters([]).median([])).all()


def test_one_path_has_no_interval() -> None:
    found = summarise_rows([row("pid", "a", 0.3), row("pid", "a", 0.4, "soft")], [PID])
    for estimate in (found.controllers["pid"].all.rms_m, found.controllers["pid"].all.lost_share):
        assert estimate is not None
        assert (estimate.low, estimate.high) == (None, None)
    steering = found.controllers["pid"].figures["steer_change_rms"]
    assert steering.median == IntervalEstimate(value=0.01)


def test_typical_errors_and_lost_drives_have_intervals() -> None:
    rows = [row("pid", "a", 0.1), row("pid", "b", 0.4, completed=False)]
    found = summarise_rows(rows, [PID]).controllers["pid"].all
    assert found.typical_m is not None
    assert found.typical_m.value == pytest.approx(0.2)
    assert (found.typical_m.low, found.typical_m.high) == pytest.approx((0.1, 0.4))
    assert found.lost_share == IntervalEstimate(value=0.5, low=0.0, high=1.0)


def test_seeds_of_a_tuning_are_one_controller() -> None:
    rows = [row("pid", path, rms, replicate=f"seed {k}")
            for k, rms in enumerate((0.1, 0.2, 0.4)) for path in "ab"]  # fmt: skip
    rows += [row("mpc_pid", path, 0.1) for path in "ab"]
    found = summarise_rows(rows, [PID, MPC])
    pid = found.controllers["pid"]
    assert (pid.replicates, pid.runs) == (3, 6)
    assert (pid.all.rms_m.low, pid.all.rms_m.high) == pytest.approx((0.1, 0.4))
    assert pid.ratio is not None
    assert pid.ratio["all"].typical.value == pytest.approx(2.0)
    other = summarise_rows(rows, [MPC, PID._replace(learned=True)])
    assert other.best_classical == "mpc_pid"


def test_what_is_beyond_grip_is_counted_apart() -> None:
    rows = [row("pid", "a", 0.1, grip_share=0.5), row("pid", "b", 0.1, "soft", grip_share=0.8)]
    rows.append(row("pid", "b", 1.5, "ice", grip_share=1.2, completed=False))
    found = summarise_rows(rows, [PID])
    pid = found.controllers["pid"]
    assert (pid.runs, pid.failures, pid.all.rms_m.value) == (2, 0, pytest.approx(0.1))
    assert pid.beyond is not None
    assert (pid.beyond.runs, pid.beyond.failures) == (1, 1)
    assert [*found.by["grip"]] == ["within 60 %", "60 to 90 %", "beyond"]
    backwards = summarise_rows(rows[::-1], [PID])
    assert [*backwards.by["grip"]] == [*found.by["grip"]]
    assert found.by["disturbance"]["ice"]["pid"].failures == 1


def test_where_all_is_beyond_grip_that_is_summed_up() -> None:
    rows = [row("pid", "a", 1.5, "ice", grip_share=1.2, completed=False)]
    rows.append(row("pid", "b", 1.0, "ice", grip_share=1.3))
    pid = summarise_rows(rows, [PID]).controllers["pid"]
    assert (pid.runs, pid.failures, pid.beyond) == (2, 1, None)
