"""What a page keeps of its drives: packed columns, marks, the road, what controllers saw."""

import base64
import gzip
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from steersman.config import build, resolve
from steersman.controllers.pid import Pid
from steersman.faults import Fault
from steersman.rendering import road_line
from steersman.report import ReportRun
from steersman.report import scene as module
from steersman.report.marks import MOST, marks
from steersman.report.pack import Blob, stretches
from steersman.report.scene import RoadGroup, scenes, shares
from steersman.report.seen import path_of, vehicle_of, waypoints
from steersman.report.signals import ShownDrive, group_by_path
from steersman.report.web import within
from steersman.rollout import RunConfig, run
from steersman.types import Driver, Reason, Status


def read(blob, entry):
    """What the page's script makes of a column (unpack.js does the same; test_browser)."""
    content = gzip.decompress(base64.b64decode(blob.packed()))[entry["at"] :]
    out, total, place = [], 0, 0
    for _ in range(entry["n"]):
        bits = shift = 0
        while True:
            byte = content[place]
            place += 1
            bits |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
        total += (bits >> 1) ^ -(bits & 1)
        out.append(total * entry["q"])
    values = np.array(out, dtype=float)
    for first, behind in entry.get("gaps", ()):
        values[first:behind] = np.nan
    return values


@given(
    arrays(float, st.integers(0, 60), elements=st.floats(-1e9, 1e9) | st.just(np.nan)),
    st.sampled_from([1.0, 1e-3]),
)
def test_a_column_comes_back_within_half_its_step(values, step):
    blob = Blob()
    blob.add([7.0, 8.0], 1.0)
    entry = blob.add(values, step)
    got = read(blob, entry)
    assert np.array_equal(np.isnan(got), np.isnan(values))
    assert np.nan_to_num(np.abs(got - values)).max(initial=0.0) <= 0.5001 * entry["q"]
    assert entry["q"] == pytest.approx(max(step, np.nan_to_num(abs(values)).max(initial=0) / 2**28))
    json.dumps(entry, allow_nan=False)


def test_long_drives_give_up_rows_first():
    assert shares([100, 5000, 9000], 7100) == [100, 3500, 3500]
    assert shares([10, 20], 1000) == [10, 20]
    assert sum(shares([24_000] * 7, module.BUDGET)) <= module.BUDGET
    assert shares([24_000] * 1000, 1)[0] == module.LEAST


def test_what_is_replayed_is_what_was_driven(drive):
    blob = Blob()
    episode = drive(n=1000)
    (group,) = scenes([RoadGroup("<b>", [ShownDrive("<i>", episode)], 1.5)], blob)
    (found,) = group["runs"]
    assert (group["title"], found["name"], found["kept"]) == ("<b>", "<i>", True)
    for key, wanted, step in (
        ("time", episode["time"], 1e-3),
        ("x", episode["x"] - group["origin"][0], 1e-3),
        ("lateral_error", 1e3 * episode["lateral_error"], 0.01),
        ("speed", np.hypot(episode["v_x"], episode["v_y"]), 1e-3),
    ):
        assert read(blob, found["columns"][key]) == pytest.approx(wanted, abs=0.51 * step)
    # No configuration, so one lap of the road is taken from beside the car.
    x, y = (read(blob, entry) for entry in group["road"])
    assert np.hypot(x, y - 50.0) == pytest.approx(np.full(len(x), 50.0), abs=2e-3)
    assert len(x) == pytest.approx(2 * np.pi * 50 / 0.5, abs=2)
    json.dumps(group, allow_nan=False)


def test_thinned_drives_keep_their_marks_and_peaks(drive):
    episode = drive(n=9000)
    error = episode["lateral_error"].copy()
    error[4321] = -1.0
    episode = replace(episode, columns={**episode.columns, "lateral_error": error})
    blob = Blob()
    (group,) = scenes([RoadGroup("g", [ShownDrive("d", episode)], 1.5)], blob, budget=1000)
    (found,) = group["runs"]
    time, lateral = (read(blob, found["columns"][k]) for k in ("time", "lateral_error"))
    assert not found["kept"]
    assert 500 < len(time) < 1100
    worst = next(m for m in found["marks"] if m["kind"] == "worst")
    assert time[worst["row"]] == pytest.approx(episode["time"][4321])
    assert lateral[worst["row"]] == pytest.approx(-1000.0)


@pytest.mark.parametrize("n", [0, 1])
def test_hardly_any_drive_is_no_problem(drive, n):
    blob = Blob()
    (group,) = scenes([RoadGroup("g", [ShownDrive("d", drive(n=n))], 1.5)], blob)
    assert group["runs"][0]["columns"]["time"]["n"] == n


def test_a_page_is_thinned_until_it_is_within_its_limit():
    asked = []

    def render(rows):
        asked.append(rows)
        return "x" * rows

    assert len(within(module.BUDGET // 3, render)) == module.BUDGET // 4
    assert asked == [module.BUDGET, module.BUDGET // 2, module.BUDGET // 4]


class TestMarks:
    def status(self, drive, *spans, **more):
        episode = drive(n=400, **more)
        status = np.zeros(400)
        for kind, first, behind in spans:
            status[first:behind] = kind
        return replace(episode, columns={**episode.columns, "status": status})

    def test_the_largest_deviations_are_apart_and_in_order(self, drive):
        found = [m for m in marks(drive(n=1000)) if m["kind"] == "worst"]
        assert len(found) == 3
        rows = [m["row"] for m in found]
        assert min(abs(a - b) for a in rows for b in rows if a != b) * 0.05 > 5.0
        assert found[0]["text"] == "largest |d|: 10 mm left"
        assert found[1]["text"].startswith("2nd largest")

    def test_the_shoulder_of_a_peak_is_no_peak(self, drive):
        episode = drive(n=400)
        error = np.exp(-np.abs(episode["time"] - 10.0))
        episode = replace(episode, columns={**episode.columns, "lateral_error": error})
        assert [m["row"] for m in marks(episode)] == [200]

    def test_a_run_off_the_road_ends_with_a_mark(self, drive):
        found = marks(drive(n=30, end="off_track"))[-1]
        assert (found["kind"], found["row"], found["text"]) == ("end", 29, "ended early: off track")
        assert "end" not in {m["kind"] for m in marks(drive(n=30))}

    def test_stretches_with_short_breaks_are_one(self, drive):
        clipped, fallback = Status.SATURATED, Status.FALLBACK
        episode = self.status(
            drive, (clipped, 10, 20), (clipped, 25, 30), (clipped, 100, 101), (fallback, 50, 60)
        )
        found = [(m["kind"], m["row"], m["until"]) for m in marks(episode) if m["kind"] != "worst"]
        assert found == [("saturated", 10, 29), ("saturated", 100, 100), ("fallback", 50, 59)]

    def test_of_too_many_the_longest_are_shown_and_all_counted(self, drive):
        episode = drive(n=20_000)
        status = np.zeros(20_000)
        status[::40] = Status.SATURATED
        status[400:420] = Status.SATURATED
        found = marks(replace(episode, columns={**episode.columns, "status": status}))
        shown = [m for m in found if m["kind"] == "saturated"]
        assert len(shown) == MOST
        assert max(m["until"] - m["row"] for m in shown) == 19
        # The stretch and what follows it after 21 steps are apart.
        assert [m["of"] for m in shown if "of" in m] == [500]

    def test_faults_are_marked_whenever_they_are_there(self, drive):
        fault = {"kind": "frozen", "begin": 5.0, "length": 0.5, "every": 8.0}
        controller = {"kind": "supervisor", "inner": {"kind": "faulty", "fault": fault}}
        found = marks(drive(n=500, meta={"config": {"controller": controller}}))
        spans = [(m["row"], m["until"], m["text"]) for m in found if m["kind"] == "fault"]
        assert spans == [(k, k + 9, "fault: frozen") for k in (100, 260, 420)]
        once = {"kind": "answers_nan", "begin": 5.0, "length": None, "every": None}
        for count, spans in ((500, [(100, 499)]), (50, [])):
            config = {"controller": {"kind": "dying", "fault": once}}
            found = marks(drive(n=count, meta={"config": config}))
            assert [(m["row"], m["until"]) for m in found if m["kind"] == "fault"] == spans

    @pytest.mark.parametrize("fault", [{}, {"begin": "x"}, {"begin": -1}, 3, None])
    def test_what_is_no_fault_is_not_marked(self, drive, fault):
        found = marks(drive(n=50, meta={"config": {"controller": {"fault": fault}}}))
        assert {m["kind"] for m in found} == {"worst"}

    def test_interventions_are_marked_with_reason_and_who_steered(self, drive):
        episode = drive(n=100)
        driver, reason = np.zeros(100), np.zeros(100)
        driver[40:60], reason[40:60] = Driver.FALLBACK, Reason.INPUT_NOT_FINITE
        driver[99], reason[99] = Driver.HOLD, Reason.DEADLINE
        status = np.where(driver > 0, Status.FALLBACK, Status.SOLVED).astype(float)
        columns = {**episode.columns, "driver": driver, "reason": reason, "status": status}
        assert "fallback" not in {m["kind"] for m in marks(replace(episode, columns=columns))}
        found = [m for m in marks(replace(episode, columns=columns)) if m["kind"] == "intervention"]
        assert [(m["row"], m["until"]) for m in found] == [(40, 59), (99, 99)]
        assert found[0]["text"] == "intervention: input not finite, fallback steers"
        assert found[1]["text"] == "intervention: deadline, hold steers"
        assert not [m for m in marks(episode) if m["kind"] == "intervention"]

    @given(arrays(bool, st.integers(0, 40)))
    def test_stretches_cover_what_is_marked(self, marked):
        rows = [k for first, behind in stretches(marked) for k in range(first, behind)]
        assert rows == np.flatnonzero(marked).tolist()


class Watching(Pid):
    """Keeps what it is shown."""

    def step(self, state, observation):
        SHOWN.append(observation.preview.copy())
        return super().step(state, observation)


SHOWN: list = []


@pytest.mark.parametrize(
    "sensor",
    [
        {"count": 7, "spacing": 3.0},
        {"error_range": 0.2},
        {"error_range": 0.2, "redraw": False},
        {"position_noise": 0.1, "heading_noise": 0.01, "error_range": 0.1},
    ],
)
def test_waypoints_are_those_that_the_controller_saw(sensor):
    SHOWN.clear()
    tree = {
        "path": "figure_eight", "duration": 3.0, "seed": 5, "vehicle": "bmw_320i",
        "sensor": {"kind": "waypoints", **sensor}, "speed": {"kind": "constant_speed", "speed": 9},
    }  # fmt: skip
    config = build(RunConfig, tree).model_copy(update={"controller": Watching()})
    episode = run(config)
    # Before the first step controllers are asked without effect, to warm up.
    assert np.array_equal(waypoints(episode, path_of(episode)), SHOWN[-len(episode) :])
    vehicle, known = vehicle_of(episode)
    assert (vehicle.kind, known) == ("bmw_320i", True)


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "frozen", "begin": 1.0, "length": 0.5},
        {"kind": "dropped", "begin": 0.5, "share": 0.6},
        {"kind": "nan", "begin": 0.7, "length": 0.2, "every": 1.0},
    ],
)
def test_waypoints_are_those_that_arrived_through_a_fault(fault):
    SHOWN.clear()
    tree = {
        "path": "figure_eight", "duration": 3.0, "seed": 5,
        "sensor": {"kind": "waypoints", "error_range": 0.1},
        "speed": {"kind": "constant_speed", "speed": 9},
    }  # fmt: skip
    parts = {"controller": Watching(), "fault": build(Fault, fault)}
    episode = run(build(RunConfig, tree).model_copy(update=parts))
    found = waypoints(episode, path_of(episode))
    assert np.array_equal(found, SHOWN[-len(episode) :], equal_nan=True)
    bare = replace(
        episode, meta={**episode.meta, "config": {**episode.meta["config"], "fault": None}}
    )
    assert not np.array_equal(found, waypoints(bare, path_of(bare)))
    older = {"kind": "faulty", "fault": fault, "seed": 5}
    config = {**episode.meta["config"], "fault": None, "controller": older}
    old = replace(episode, meta={**episode.meta, "config": config})
    assert np.array_equal(found, waypoints(old, path_of(old)), equal_nan=True)
    config = {**episode.meta["config"], "fault": {"kind": "x"}}
    strange = replace(episode, meta={**episode.meta, "config": config})
    assert waypoints(strange, path_of(strange)) is None


class TestRebuilt:
    @pytest.fixture
    def episode(self):
        return run(build(RunConfig, {"path": "figure_eight", "duration": 0.5, "controller": "pid"}))

    def test_the_road_is_the_whole_path(self, episode):
        path = resolve("path", "figure_eight")
        road = road_line(path_of(episode))
        lengths = np.hypot(np.diff(road.x), np.diff(road.y))
        assert lengths.sum() == pytest.approx(path.length, rel=1e-4)
        assert np.hypot(road.x[0] - road.x[-1], road.y[0] - road.y[-1]) < 1e-6

    @pytest.mark.parametrize(
        "change",
        [
            {"path": {"kind": "circle"}},
            {"path": {"kind": "csv", "file": "gone.csv"}},
            {"path": "nothing"},
            {"path": 3},
        ],
    )
    def test_another_path_or_none_is_not_taken_for_the_driven_one(self, episode, change):
        config = {**episode.meta["config"], **change}
        other = replace(episode, meta={**episode.meta, "config": config})
        assert path_of(other) is None
        (group,) = scenes([RoadGroup("g", [ShownDrive("d", other)], 1.5)], Blob())
        assert group["runs"][0]["seen"] is None
        assert group["road"][0]["n"] == len(other)

    def test_without_a_configuration_the_default_car_is_drawn_and_told(self, episode):
        bare = replace(episode, meta={})
        assert vehicle_of(bare)[1] is False
        groups = group_by_path([ReportRun("a", bare), ReportRun("b", episode)])
        (found,) = scenes([RoadGroup("g", groups[0], 1.5)], Blob())
        assert [run["car"]["known"] for run in found["runs"]] == [False, True]
        assert [run["seen"] is None for run in found["runs"]] == [True, False]
