"""Paths out of recordings: the line that was driven, the path that was planned, what is refused."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steersman.config import build
from steersman.errors import ConfigError, DataError
from steersman.logs import schemas
from steersman.logs.write import write_episode
from steersman.paths.base import PathComponent
from steersman.paths.course import first_lap, thinned
from steersman.paths.csv_path import CsvPath
from steersman.paths.mcap_path import McapPath
from steersman.rollout import RunConfig, run

from ..logs import bags
from .conftest import ellipse, write_csv

SECOND = 10**9
Points = list[tuple[float, float]]
WAVE = [(2.0 * i, 10.0 * math.sin(0.1 * i)) for i in range(60)]


def driven(folder: FilePath, points: Points, kind: str = "mcap") -> FilePath:
    """A recording of Odometry at these points, ten a second."""
    messages = [
        ("/odom", schemas.ODOMETRY_TYPE, i * SECOND // 10, bags.odometry(0, x, y, 0.0, 1.0))
        for i, (x, y) in enumerate(points)
    ]
    folder.mkdir(exist_ok=True)
    return bags.write(folder, messages, kind)


def planned(folder: FilePath, *paths: Points, frame: str = "map") -> FilePath:
    """A recording of these paths, one a second."""
    messages = []
    for i, points in enumerate(paths):
        told = bags.path(0, points)
        told.header.frame_id = frame
        messages.append(("/plan", schemas.PATH_TYPE, i * SECOND, told))
    folder.mkdir(exist_ok=True)
    return bags.write(folder, messages)


def refused(file: FilePath, **fields: Any) -> str:
    with pytest.raises(DataError) as caught:
        _ = McapPath(file=file, **fields).table
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(file))
    return text


@pytest.mark.parametrize("kind", bags.FORMATS)
def test_as_a_csv_file_with_the_same_points(tmp_path: FilePath, kind: str) -> None:
    path = McapPath(file=driven(tmp_path / "bag", WAVE, kind))
    same = CsvPath(file=write_csv(tmp_path / "wave.csv", WAVE))
    assert not path.closed
    assert np.array_equal(path.table.pieces, same.table.pieces)
    smooth = McapPath(file=path.file, smoothing=0.1)
    same = CsvPath(file=write_csv(tmp_path / "wave.csv", WAVE), smoothing=0.1)
    assert np.array_equal(smooth.table.pieces, same.table.pieces)


@pytest.mark.parametrize(
    ("name", "laps", "deviation"),
    [("training_circuit", 1.02, 0.1), ("lemniscate", 1.2, 0.1), ("double_lane_change", None, 0.1)],
)
def test_what_steersman_drove(
    tmp_path: FilePath, name: str, laps: float | None, deviation: float
) -> None:
    speed = {"kind": "nedc", "a_lat_max": 4.0}
    config = build(RunConfig, {"path": name, "laps": laps, "speed": speed})
    episode = run(config)
    road = config.path
    file = tmp_path / "run.mcap"
    write_episode(file, episode, config.vehicle.table, road)
    followed = McapPath(file=file, topic=schemas.PATH)
    assert followed.closed == road.closed
    assert followed.length == pytest.approx(road.length, abs=2e-3)
    assert farthest(followed, road) < 2e-4  # the spline cuts transitions between its points
    line = McapPath(file=file)
    assert line.closed == road.closed
    # The last row is up to a control step before the end.
    step = 0.0 if road.closed else float(episode["v_x"][-1]) * episode.dt
    assert line.length == pytest.approx(road.length, abs=1e-3 * road.length + step)
    # It lies beside the path by what the controller lay beside it.
    assert farthest(line, road) == pytest.approx(np.max(np.abs(episode["lateral_error"])), rel=0.1)
    assert farthest(line, road) < deviation


def farthest(path: PathComponent, road: PathComponent) -> float:
    share = road.length / path.length
    stations = np.linspace(0.0, path.length, 400).tolist()
    return max(abs(road.project(*path.at(s)[:2], near=share * s)[1]) for s in stations)


def test_a_lap_is_cut_where_it_passes_its_start(tmp_path: FilePath) -> None:
    # Ever further out, by 0.4 m in a lap.
    lap = ellipse(120)
    spiral = [(x * (1 + i * 4e-5), y * (1 + i * 4e-5)) for i, (x, y) in enumerate(lap + lap[:40])]
    path = McapPath(file=driven(tmp_path, spiral))
    assert path.closed
    whole = CsvPath(file=write_csv(tmp_path / "lap.csv", lap))
    assert path.length == pytest.approx(whole.length, rel=0.01)
    assert path.at(0.0)[:2] == pytest.approx((80.0, 0.0), abs=1e-6)
    # The gap at the end is spread over the lap, so nothing bends sharply.
    bends = [path.at(s).curvature for s in np.linspace(0.0, path.length, 300).tolist()]
    assert max(bends) < 1.1 * 80.0 / 50.0**2
    assert not McapPath(file=path.file, loop=False).closed
    assert McapPath(file=path.file, loop=False).length > 1.2 * whole.length


def test_passing_the_start_the_other_way_is_no_lap(tmp_path: FilePath) -> None:
    back_and_forth = [(float(i), 0.0) for i in range(40)]
    turn = [(40.0 + 5.0 * math.sin(a), 5.0 - 5.0 * math.cos(a)) for a in np.linspace(0.1, 4.0, 12)]
    x, y = turn[-1]
    home = [(x - i * (x + 10.0) / 50.0, y - i * (y - 2.0) / 50.0) for i in range(1, 51)]
    assert not McapPath(file=driven(tmp_path, back_and_forth + turn + home)).closed


@settings(max_examples=50, deadline=None)
@given(
    side=st.floats(-2.5, 2.5),
    beyond=st.integers(2, 30),
    turned=st.floats(-3.0, 3.0),
    spacing=st.floats(0.4, 4.0),
)
def test_a_lap_closes_whatever_its_gap(
    side: float, beyond: int, turned: float, spacing: float
) -> None:
    # A spiral that is ``side`` further out after a turn, in any direction.
    radius, count = 60.0, round(math.tau * 60.0 / spacing)
    angle = math.tau * np.arange(count + beyond) / count
    r = radius + side * angle / math.tau
    x, y = r * np.cos(angle + turned), r * np.sin(angle + turned)
    lap = first_lap(x, y)
    assert lap is not None
    assert count - 1 <= len(lap.x) <= count + 1
    assert lap.rows.tolist() == list(range(len(lap.x)))
    assert (lap.x[0], lap.y[0]) == (x[0], y[0])
    joint = math.dist((lap.x[-1], lap.y[-1]), (lap.x[0], lap.y[0]))
    assert 0.4 * spacing < joint < 1.7 * spacing
    moved = np.hypot(lap.x - x[: len(lap.x)], lap.y - y[: len(lap.x)])
    assert np.all(moved <= 0.02 + 1.1 * abs(side) * np.arange(len(moved)) / count)


def test_standing_still_leaves_one_point(tmp_path: FilePath) -> None:
    rng = np.random.default_rng(3)
    standing = [(20.0 + rng.normal(0.0, 0.02), rng.normal(0.0, 0.02)) for _ in range(100)]
    line = [(float(i), 0.0) for i in range(20)]
    on = [(float(i), 0.0) for i in range(21, 40)]
    path = McapPath(file=driven(tmp_path, line + standing + on))
    assert path.length == pytest.approx(39.0, abs=0.01)
    assert thinned(np.zeros(5), np.zeros(5), 0.5).tolist() == [0]
    assert thinned(np.zeros(0), np.zeros(0), 0.5).tolist() == []
    assert thinned(np.arange(6.0), np.zeros(6), 2.0).tolist() == [0, 2, 4]


def test_a_part_of_a_recording(tmp_path: FilePath) -> None:
    file = driven(tmp_path, WAVE)
    path = McapPath(file=file, window=(1.0, 3.0))
    assert path.at(0.0)[:2] == pytest.approx(WAVE[10])
    assert path.at(path.length)[:2] == pytest.approx(WAVE[30])
    assert "/odom: no message from 8 to 9 s; the last is at 5.900 s" in refused(file, window=(8, 9))
    with pytest.raises(ConfigError, match="from must be before to"):
        build(McapPath, {"file": file, "window": [3.0, 1.0]})


def test_the_rear_axle_follows_the_centre_of_mass(tmp_path: FilePath) -> None:
    file = bags.write(tmp_path, bags.drive(300))
    rear, ahead = McapPath(file=file, loop=False), McapPath(file=file, loop=False, ahead=1.5)
    assert rear.at(20.0).curvature == pytest.approx(1.0 / 40.0, abs=1e-4)
    assert ahead.at(20.0).curvature == pytest.approx(1.0 / math.hypot(40.0, 1.5), abs=1e-4)
    assert ahead.at(0.0)[:2] == pytest.approx((1.5, 0.0), abs=1e-9)


def test_the_longest_path_message_counts(tmp_path: FilePath) -> None:
    file = planned(tmp_path, WAVE[:10], WAVE, WAVE[:20])
    assert McapPath(file=file).at(0.0)[:2] == pytest.approx(WAVE[0])
    assert McapPath(file=file).length > 120.0
    assert McapPath(file=file, window=(2.0, 2.5)).length < 60.0
    assert "/plan: no message from 5 to 6 s" in refused(file, window=(5, 6))


def test_a_planned_lap(tmp_path: FilePath) -> None:
    lap = [*ellipse(), ellipse()[0]]
    path = McapPath(file=planned(tmp_path / "a", lap))
    same = CsvPath(file=write_csv(tmp_path / "lap.csv", lap))
    assert path.closed
    assert np.array_equal(path.table.pieces, same.table.pieces)
    assert McapPath(file=planned(tmp_path / "b", ellipse())).closed
    assert not McapPath(file=planned(tmp_path / "c", ellipse()), loop=False).closed


@pytest.mark.parametrize("kind", ["mcap", "folder-db3"])
@pytest.mark.parametrize("spread", [False, True])
def test_poses_are_a_line(tmp_path: FilePath, kind: str, spread: bool) -> None:
    name = schemas.POSE_TYPES[spread]
    messages = [
        ("/localization/pose", name, i * SECOND, bags.posed(i * SECOND, x, y, spread=spread))
        for i, (x, y) in enumerate(WAVE)
    ]
    path = McapPath(file=bags.write(tmp_path, messages, kind))
    assert path.length == McapPath(file=driven(tmp_path / "odometry", WAVE)).length
    assert not path.closed


@pytest.mark.parametrize("kind", ["mcap", "folder-db3"])
def test_a_trajectory_of_autoware_is_a_line(tmp_path: FilePath, kind: str) -> None:
    told = bags.trajectory(0, WAVE)
    file = bags.write(tmp_path, [("/plan", schemas.TRAJECTORY_TYPE, 0, told)], kind)
    assert McapPath(file=file).length == McapPath(file=planned(tmp_path / "path", WAVE)).length


def test_which_topic(tmp_path: FilePath) -> None:
    both = bags.drive(100)
    both.append(("/plan", schemas.PATH_TYPE, 10**18, bags.path(0, WAVE)))
    file = bags.write(tmp_path, both)
    assert McapPath(file=file).length == pytest.approx(0.4 * 99, abs=0.5)
    assert McapPath(file=file, topic="/plan").length > 120.0
    assert "no topic '/pln'; did you mean '/plan'?" in refused(file, topic="/pln")


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([], "holds 0 points, a path needs at least 2 (topic /plan"),
        ([(0.0, 0.0)], "holds 1 points"),
        ([(0.0, 0.0), (1.0, math.nan), (2.0, 0.0)], "/plan: pose 2 lies at [ 1. nan]; positions"),
        ([(0.0, 0.0), (1e9, 0.0), (2.0, 0.0)], "/plan: pose 2 lies at"),
        ([(0.0, 0.0), (9.0, 0.0), (3.0, 0.1), (12.0, 0.0)], "pose 2: the path turns back"),
        ([(0.0, 0.0), (1e7, 0.0), (2e7, 0.0)], "give positions in metres"),
    ],
)
def test_paths_that_nobody_can_follow(tmp_path: FilePath, points: Points, words: str) -> None:
    assert words in refused(planned(tmp_path, points))


def test_lines_that_nobody_can_follow(tmp_path: FilePath) -> None:
    standing = driven(tmp_path / "standing", [(5.0, 5.0)] * 30)
    assert "holds 1 points" in refused(standing)
    assert "window takes a part)" in refused(standing)
    local = planned(tmp_path / "local", WAVE, frame="base_link")
    assert "in the frame base_link, of the vehicle" in refused(local)
    other = ("/cmd", schemas.LATERAL_TYPE, 0, bags.lateral(0, 0.1))
    only = bags.write(tmp_path, [other])
    assert "holds no nav_msgs/msg/Odometry or nav_msgs/msg/Path or " in refused(only)
    assert "topic /cmd holds autoware_control_msgs/msg/Lateral, expected" in refused(
        only, topic="/cmd"
    )
    assert "No such file" in refused(tmp_path / "nowhere.mcap")
