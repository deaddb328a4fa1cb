"""Speeds along the path: limits hold, nothing is faster, closed paths join, files are read."""

from __future__ import annotations

import itertools
import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steersman.config import build, lookup
from steersman.errors import ConfigError, DataError
from steersman.kernels import speed as kernel
from steersman.kernels.speed_profile import available, fastest
from steersman.learning.problem import Problem
from steersman.paths.csv_path import CsvPath
from steersman.profiles import CRAWL, road_limits, stack_profiles
from steersman.rollout import RunConfig, attempt
from steersman.speed import ConstantSpeed, PathSpeed, SpeedProfile
from steersman.types import FloatArray

CIRCUIT = build(lookup("path", "training_circuit"), {})
LANES = build(lookup("path", "double_lane_change"), {})
GRIP = np.array([[0.0, 5.0, 6.0], [20.0, 4.0, 7.0], [60.0, 3.0, 9.0]])


def solved(kappa: FloatArray, exponent: float, step: float = 2.0, *, closed: bool) -> FloatArray:
    limit = np.full(len(kappa), 45.0)
    fastest(GRIP, exponent, 2.5, kappa, step, closed, limit)
    return limit


def excess(v: FloatArray, kappa: FloatArray, exponent: float, step: float = 2.0) -> float:
    """By how much limits are exceeded anywhere, also between the places [m/s^2]."""
    worst = -math.inf
    for (v0, v1), (k0, k1) in zip(
        itertools.pairwise(v), itertools.pairwise(np.abs(kappa)), strict=True
    ):
        a = (v1 * v1 - v0 * v0) / (2.0 * step)
        for w in np.linspace(0.0, 1.0, 5):
            between, bend = math.sqrt(v0 * v0 + 2.0 * a * step * w), k0 + w * (k1 - k0)
            left = available(GRIP, exponent, between, bend)
            across = np.interp(between, GRIP[:, 0], GRIP[:, 2])
            worst = max(worst, between**2 * bend - across, abs(a) - left, a - 2.5)
    return float(worst)


bends = st.lists(st.floats(-0.08, 0.08), min_size=4, max_size=40).map(
    lambda found: np.repeat(found, 3)
)


@settings(max_examples=60, deadline=None)
@given(kappa=bends, exponent=st.sampled_from([1.0, 2.0, 6.0]), closed=st.booleans())
def test_limits_hold_everywhere(kappa: FloatArray, exponent: float, closed: bool) -> None:
    if closed:
        kappa[-1] = kappa[0]
    v = solved(kappa, exponent, closed=closed)
    assert excess(v, kappa, exponent) < 1e-6
    assert v.max() <= 45.0
    if closed:
        assert v[0] == v[-1]


def test_nothing_is_faster_on_a_small_path() -> None:
    """Against a search over all speeds on a grid that keep the same limits."""
    kappa = np.array([0.0, 0.01, 0.05, 0.07, 0.03, 0.0, -0.02, -0.06, -0.02, 0.0])
    levels = np.linspace(4.0, 30.0, 400)
    v, step = solved(kappa, 2.0, 4.0, closed=False), 4.0
    held = levels[None, :] ** 2 * np.abs(kappa)[:, None] <= np.interp(levels, *GRIP.T[[0, 2]])
    gain = (levels[None, :] ** 2 - levels[:, None] ** 2) / (2.0 * step)
    time = np.where(held[0], 0.0, math.inf)
    for i in range(1, len(kappa)):
        bend = max(abs(kappa[i - 1]), abs(kappa[i]))
        left = np.array([available(GRIP, 2.0, w, bend) for w in levels])
        allowed = np.minimum(left[:, None], left[None, :])
        fine = (gain <= np.minimum(allowed, 2.5)) & (gain >= -allowed) & held[i][None, :]
        took = 2.0 * step / (levels[:, None] + levels[None, :])
        time = np.where(fine, time[:, None] + took, math.inf).min(axis=0)
    ours = float((2.0 * step / (v[1:] + v[:-1])).sum())
    assert ours <= float(time.min()) * (1.0 + 1e-9)
    assert ours >= 0.98 * float(time.min())  # the grid is 0.065 m/s wide


def test_a_closed_path_joins_and_a_faster_car_is_not_slower() -> None:
    slow, step = road_limits(CIRCUIT, SpeedProfile().profile())
    assert step * (len(slow) - 1) == pytest.approx(CIRCUIT.length)
    assert slow[0] == slow[-1]
    quick, _ = road_limits(CIRCUIT, SpeedProfile(a_lat_max=6.0, deceleration=6.0).profile())
    assert (quick >= slow).all()
    assert quick.max() > slow.max()


def test_an_open_path_begins_and_ends_as_told() -> None:
    limit, step = road_limits(LANES, SpeedProfile(start=3.0, end=0.0).profile())
    assert (limit[0], limit[-1]) == (3.0, CRAWL)
    gains = np.diff(limit**2) / (2.0 * step)
    assert gains.max() <= 2.0 + 1e-9
    assert gains.min() >= -4.0 - 1e-9


def test_a_car_that_brakes_at_the_end_arrives_as_fast_as_told() -> None:
    tried = attempt(RunConfig(path=LANES, speed=ConstantSpeed(speed=12.0, end=3.0), corridor=3.0))
    assert tried.outcome == "finished"
    v = tried.episode["v_x"]
    assert v.max() > 10.0
    assert v[-1] == pytest.approx(3.0, abs=0.5)
    assert tried.episode["a_x"].min() > -6.0


def test_a_capped_speed_stays_what_it_was_but_at_the_end() -> None:
    usual = ConstantSpeed(speed=20.0, a_lat_max=4.0)
    tables = [
        stack_profiles([one.profile()], [LANES])
        for one in (usual, usual.model_copy(update={"end": 5.0}))
    ]
    places = np.linspace(0.0, 0.5 * LANES.length, 50)
    found = [
        [kernel.target_speed(table, 0, LANES.table, 0, 0.0, float(s)) for s in places]
        for table in tables
    ]
    assert found[1] == pytest.approx(found[0], rel=2e-2)
    end = kernel.target_speed(tables[1], 0, LANES.table, 0, 0.0, LANES.length)
    assert end == pytest.approx(5.0)


# ----------------------------------------------------------------------------------- files

HEADS = {
    "plain": "x,y,v\n{x},{y},{v}",
    "TUM race line": "# race line\n# s_m; x_m; y_m; psi_rad; kappa_radpm; vx_mps; ax_mps2\n"
    "0; {x}; {y}; 0; 0; {v}; 0",
    "F1TENTH": "# x_m, y_m, speed\n{x}, {y}, {v}",
    "Autoware": "x,y,z,yaw,velocity,change_flag\n{x},{y},0,0,{v},0",
    "km/h": "x,y,speed_km_h\n{x},{y},{kmh}",
}


def written(folder: FilePath, text: str, *, closed: bool) -> CsvPath:
    """A circle or a half of one, radius 40 m, with a speed that rises from 5 to 9 m/s."""
    *head, row = text.split("\n")
    angles = np.linspace(0.0, 2.0 * math.pi if closed else math.pi, 61)[: 60 if closed else 61]
    speeds = 7.0 - 2.0 * np.cos(angles)
    lines = [
        row.format(x=40.0 * math.sin(a), y=40.0 * (1.0 - math.cos(a)), v=v, kmh=3.6 * v)
        for a, v in zip(angles, speeds, strict=True)
    ]
    file = folder / "path.csv"
    file.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8")
    return CsvPath(file=file)


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("closed", [True, False])
def test_speeds_are_read_along_the_path(tmp_path: FilePath, head: str, closed: bool) -> None:
    path = written(tmp_path, HEADS[head], closed=closed)
    assert path.closed == closed
    speed = PathSpeed(scale=2.0)
    for s in (0.0, 30.0, 77.0, 110.0):
        expected = 2.0 * (7.0 - 2.0 * math.cos(s / 40.0))
        assert speed.start_speed(path, s) == pytest.approx(expected, abs=0.02)


def test_a_car_drives_the_speeds_of_the_file(tmp_path: FilePath) -> None:
    path = written(tmp_path, HEADS["plain"], closed=True)
    tried = attempt(RunConfig(path=path, speed=PathSpeed(), laps=1))
    episode = tried.episode
    wanted = 7.0 - 2.0 * np.cos(episode["s"] / 40.0)
    assert tried.outcome == "finished"
    assert np.abs(np.hypot(episode["v_x"], episode["v_y"]) - wanted).max() < 0.3


def test_a_path_without_speeds_is_refused(tmp_path: FilePath) -> None:
    with pytest.raises(ConfigError, match="speed: path has no speeds along the path"):
        attempt(RunConfig(path=CIRCUIT, speed=PathSpeed()))
    path = written(tmp_path, "x,y,speed\n{x},{y},-{v}", closed=True)
    assert path.length > 0.0  # what is not asked for is not read
    with pytest.raises(DataError, match=r"path\.csv, line 2: speed must not be negative"):
        path.speeds()


def test_speeds_along_the_path_are_trained_on_alone() -> None:
    with pytest.raises(ConfigError, match="profile gives speeds along the path"):
        build(Problem, {"speeds": (SpeedProfile(), ConstantSpeed())})
    problem = Problem(roads=(CIRCUIT,), speeds=(SpeedProfile(),))
    assert problem.demands(2).cap.size > 1


def test_grip_over_speed_is_read_from_a_file(tmp_path: FilePath) -> None:
    file = tmp_path / "ggv.csv"
    file.write_text("# v_mps,ax_max_mps2,ay_max_mps2\n0,5,6\n20,4,7\n60,3,9\n", encoding="utf-8")
    limit, step = road_limits(CIRCUIT, SpeedProfile(ggv=file, acceleration=2.5).profile())
    kappa = np.array([CIRCUIT.at(step * i).curvature for i in range(len(limit))])
    assert excess(limit, kappa, 2.0, step) < 1e-6
    file.write_text("v_mps,ax_max_mps2,ay_max_mps2\n0,5,6\n0,4,7\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"line 3: v_mps must increase"):
        SpeedProfile(ggv=file).profile()
