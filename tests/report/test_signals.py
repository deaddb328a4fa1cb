"""Decimation, grouping by path and rounding."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from steersman.report import Run
from steersman.report import signals as module
from steersman.report.signals import decimate, distance, group_by_path, look, plotted, rounded
from steersman.report.training import curves


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


def test_rounding_gives_json():
    values = np.array([1.23456, 2.0, -0.0001, np.nan, np.inf])
    got = rounded(values, 2)
    assert got == [1.23, 2, 0, None, None]
    assert json.dumps(got, allow_nan=False) == "[1.23, 2, 0, null, null]"


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
    groups = group_by_path([Run("none"), *(Run(name, episode=e) for name, e in runs.items())])
    assert [[drive.name for drive in group] for group in groups] == [
        ["a", "shorter and elsewhere", "no overlap", "empty"],
        ["another radius"],
        ["open"],
        ["moved"],
    ]


def test_what_is_plotted(drive):
    groups = group_by_path([Run("<b>", episode=drive(n=1000)), Run("two", episode=drive())])
    (group,) = plotted(groups, [1.5])
    run = group["runs"][0]
    assert run["name"] == "&lt;b&gt;"
    assert run["lateral"][0] == pytest.approx(10.0)  # mm
    # One lap of path with the corridor's edges on the circles beside it.
    path = {name: np.array(values) for name, values in group["path"].items()}
    assert len(path["x"]) == pytest.approx(2 * np.pi * 50 / 0.5, abs=2)
    for side, radius in (("left", 48.5), ("right", 51.5)):
        found = np.hypot(path[f"{side}_x"], path[f"{side}_y"] - 50.0)
        assert found == pytest.approx(np.full(len(found), radius), abs=2e-3)
    json.dumps(group, allow_nan=False)


def test_many_runs_share_the_budget(drive):
    long = drive(n=20_000)
    groups = [[module.Drive(str(k), long) for k in range(40)]]
    (group,) = plotted(groups, [1.5])
    total = sum(len(run["time"]) for run in group["runs"])
    assert total <= module.BUDGET
    assert all(len(run["time"]) >= module.LEAST // 2 for run in group["runs"])


def test_an_empty_drive_can_be_plotted(drive):
    (group,) = plotted(group_by_path([Run("none", episode=drive(n=0))]), [1.5])
    assert group["path"]["x"] == group["runs"][0]["time"] == []


def test_looks_differ():
    looks = {tuple(look(k).values()) for k in range(28)}
    assert len(looks) == 28


def test_curves_skip_empty_columns_and_cells():
    nan = np.nan
    one = {"steps": np.array([1.0, 2, 3]), "loss": np.array([nan, 0.123456789, 3e-9])}
    two = {"steps": np.array([1.0]), "own<": np.array([4.0]), "empty": np.array([nan])}
    got = curves([Run("a", training=one), Run("b", training=two), Run("c")])
    assert (got["x"], got["panels"]) == ("environment steps", ["loss", "own&lt;"])
    assert got["runs"][0]["panels"][0] == {"x": [2.0, 3.0], "y": [0.12346, 3e-9]}
    assert got["runs"][0]["panels"][1] == {"x": [], "y": []}
    assert curves([Run("c")]) is None


def test_curves_without_a_common_axis_count_rows():
    got = curves([Run("a", training={"loss": np.array([3.0, 2.0])})])
    assert got["x"] == "row"
    assert got["runs"][0]["panels"][0]["x"] == [0.0, 1.0]
