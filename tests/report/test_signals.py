"""Decimation, grouping by path, curves."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from steersman.bench.along import distance
from steersman.report import ReportRun
from steersman.report.curves import curves
from steersman.report.signals import decimate, group_by_path, look


@given(
    arrays(float, st.tuples(st.integers(1, 4), st.integers(0, 3000)),
           elements=st.floats(-1e6, 1e6)),
    st.integers(16, 400),
)  # fmt: skip
def test_decimation_keeps_ends_and_extremes_within_its_budget(values, points):
    rows = decimate(list(values), points)
    n = values.shape[1]
    assert len(rows) <= max(points, 2)
    assert (np.diff(rows) > 0).all()
    if n:
        assert (rows[0], rows[-1]) == (0, n - 1)
        for signal in values:
            assert signal[rows].max() == signal.max()
            assert signal[rows].min() == signal.min()
    if n <= points:
        assert len(rows) == n


def test_decimation_leaves_no_gap():
    rows = decimate([np.zeros(100_000)], 2000)
    assert np.diff(rows).max() <= 101


def test_a_spike_and_nan_survive_decimation():
    signal = np.zeros(50_000)
    signal[31_415], signal[100] = 1.0, np.nan
    assert 31_415 in decimate([signal], 1000)


def test_distance_counts_on_over_laps(drive):
    s = distance(drive(n=1000))
    assert s[-1] == pytest.approx(10.0 * 0.05 * 999)
    assert (np.diff(s) > 0).all()


def test_runs_on_the_same_path_are_grouped(drive):
    runs = {
        "a": drive(),
        "another radius": drive(radius=60.0),
        "shorter and elsewhere": drive(n=20, start=20.0),
        "no overlap": drive(n=10, start=300.0),
        "open": replace(drive(), closed=False),
        "empty": drive(n=0),
        "moved": drive(),
    }
    moved = {"path_x": runs["a"]["path_x"] + 5.0}
    runs["moved"] = replace(runs["moved"], columns={**runs["moved"].columns, **moved})
    groups = group_by_path(
        [ReportRun("none"), *(ReportRun(name, episode=e) for name, e in runs.items())]
    )
    assert [[drive.name for drive in group] for group in groups] == [
        ["a", "shorter and elsewhere", "no overlap", "empty"],
        ["another radius"],
        ["open"],
        ["moved"],
    ]


def test_looks_differ():
    looks = {tuple(look(k).values()) for k in range(28)}
    assert len(looks) == 28


def test_curves_skip_empty_columns_and_cells():
    nan = np.nan
    one = {"steps": np.array([1.0, 2, 3]), "loss": np.array([nan, 0.123456789, 3e-9])}
    two = {"steps": np.array([1.0]), "own<": np.array([4.0]), "empty": np.array([nan])}
    got = curves([ReportRun("a", training=one), ReportRun("b", training=two), ReportRun("c")])
    assert (got["x"], got["panels"]) == ("environment steps", ["loss", "own<"])
    assert got["runs"][0]["panels"][0] == {"x": [2.0, 3.0], "y": [0.12346, 3e-9]}
    assert got["runs"][0]["panels"][1] == {"x": [], "y": []}
    assert curves([ReportRun("c")]) is None


def test_seeds_of_one_training_are_a_median_and_a_range():
    def seed(*loss):
        steps = np.arange(1.0, 1.0 + len(loss))
        return {"steps": steps, "loss": np.array(loss)}

    records = {
        "x/seed_0": seed(1, 5, 9),
        "x/seed_1": seed(2, 2),
        "x/seed_2": seed(4, 3),
        "y": seed(7),
    }
    got = curves([ReportRun(name, training=one) for name, one in records.items()])
    assert [line["name"] for line in got["runs"]] == ["x: median and range of 3 seeds", "y"]
    [band] = got["runs"][0]["panels"]
    assert band == {"x": [1.0, 2.0], "y": [2.0, 3.0], "low": [1.0, 2.0], "high": [4.0, 5.0]}


def test_curves_without_a_common_axis_count_rows():
    got = curves([ReportRun("a", training={"loss": np.array([3.0, 2.0])})])
    assert got["x"] == "row"
    assert got["runs"][0]["panels"][0]["x"] == [0.0, 1.0]
