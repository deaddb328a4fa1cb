"""Sources of speed: the driving cycle, the curvature cap, holding a speed, files."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from tests.loops import PedalWork

from steersman.config import build, lookup
from steersman.errors import DataError
from steersman.kernels import vehicle as kernel
from steersman.kernels.path import PathTable
from steersman.kernels.steady_turn import steady_turn
from steersman.paths.analytic import FigureEight
from steersman.paths.base import PathComponent
from steersman.paths.generated import HarmonicRoad
from steersman.paths.segments import Segment, from_segments
from steersman.plants.simulator import SimulatorConfig
from steersman.profiles import Profile, curvature_cap, read_profile, stack_profiles
from steersman.speed import ConstantSpeed, ConstantThrottle, Nedc, RandomProfile, SpeedCsv
from steersman.types import Command, FloatArray, Pose
from steersman.vehicles import CarlaModel3

CIRCLE = build(lookup("path", "circle"), {"radius": 50.0})
CIRCUIT = build(lookup("path", "training_circuit"), {})
CAR = CarlaModel3()


# ------------------------------------------------------------------------------------ NEDC


def first_cycle(nedc: Nedc) -> tuple[FloatArray, FloatArray]:
    times, speeds = nedc.breakpoints()
    count = len(times) // 20
    return times[:count], speeds[:count]


def travelled(nedc: Nedc) -> float:
    times, speeds = first_cycle(nedc)
    return float(np.sum(np.diff(times) * 0.5 * (speeds[1:] + speeds[:-1])))


def test_nedc_starts_at_eleven_seconds() -> None:
    times, speeds = first_cycle(Nedc())
    assert (times[0], speeds[0]) == (0.0, 0.0)
    # From standstill to 15 km/h in 4 s, and 1180 s in all with the 11 s that are left out.
    assert (times[1], speeds[1]) == (4.0, pytest.approx(15.0 / 3.6))
    assert times[-1] == 1180.0 - 11.0
    assert speeds.max() == pytest.approx(120.0 / 3.6)


def test_nedc_distance() -> None:
    # UN R83 gives 11.007 km, 11013 m by its table of phases.
    assert travelled(Nedc()) == pytest.approx(11013.2, abs=0.5)


def test_a_random_start_is_a_moment_of_the_same_cycle() -> None:
    nedc = Nedc(random_start=True)
    times, speeds = nedc.breakpoints()
    at = np.linspace(0.0, 1000.0, 200)
    draws = [nedc.draw(np.random.default_rng(seed), 60.0) for seed in range(10)]
    assert len({len(draw.times) for draw in draws}) == 1
    assert len({float(draw.speeds[0]) for draw in draws}) > 3
    for seed, draw in enumerate(draws):
        begin = np.random.default_rng(seed).uniform(0.0, times[len(times) // 20])
        assert draw.times[0] == 0.0
        assert (np.diff(draw.times) > 0.0).all()
        expected = np.interp(begin + at, times, speeds)
        np.testing.assert_allclose(np.interp(at, draw.times, draw.speeds), expected, atol=1e-6)
    assert Nedc().draw(np.random.default_rng(0), 60.0).speeds[0] == 0.0


def test_nedc_without_standstill() -> None:
    full, short = first_cycle(Nedc()), first_cycle(Nedc(skip_standstill=True))
    assert travelled(Nedc(skip_standstill=True)) == pytest.approx(travelled(Nedc()))
    # 269 s of standstill, of which each phase keeps 0.1 s.
    assert full[0][-1] - short[0][-1] == pytest.approx(269.0, abs=1.5)
    still = (short[1][1:] == 0.0) & (short[1][:-1] == 0.0)
    assert np.diff(short[0])[still] == pytest.approx(0.1)


@pytest.mark.parametrize("skip", [False, True])
def test_nedc_repeats(skip: bool) -> None:
    times, speeds = Nedc(skip_standstill=skip, scale=0.5).breakpoints()
    assert (np.diff(times) > 0.0).all()
    count = len(times) // 20
    assert (speeds[:count] == speeds[-count:]).all()
    assert speeds.max() == pytest.approx(60.0 / 3.6)
    assert Nedc().start_speed(CIRCLE, 0.0) == 0.0


# ------------------------------------------------------------------------------ curvature cap


def test_cap_on_the_circle() -> None:
    assert curvature_cap(CIRCLE, 4.0, 2.0) == pytest.approx(math.sqrt(4.0 * 50.0))
    assert ConstantSpeed(speed=30.0, a_lat_max=4.0).start_speed(CIRCLE, 20.0) == pytest.approx(
        math.sqrt(200.0)
    )
    assert curvature_cap(CIRCLE, None, 2.0).size == 0


def test_cap_slows_down_in_time() -> None:
    limit = curvature_cap(CIRCUIT, 4.0, 2.0)
    kappa = np.array([abs(CIRCUIT.at(float(s)).curvature) for s in range(len(limit))])
    assert (limit**2 * kappa <= 4.0 + 1e-6)[:-1].all()
    # v^2 falls by at most 2 x deceleration in a metre, also over the joint of the lap.
    assert np.diff(limit**2).min() >= -2.0 * 2.0 - 1e-9
    assert limit[-1] <= limit[0] + 1e-9
    # Before the sharp corner the fall is used; behind a corner nothing holds the car back.
    assert np.diff(limit**2).min() == pytest.approx(-4.0)
    assert np.diff(limit**2).max() > 10.0


def test_cap_ahead_of_one_corner() -> None:
    class Corner(PathComponent):
        """100 m straight on, then 30 m at a radius of 25 m."""

        def build_table(self) -> PathTable:
            straight, bend = Segment(100.0, 0.0, 0.0), Segment(30.0, 0.04, 0.04)
            return from_segments([straight, bend], closed=False)

    limit = curvature_cap(Corner(), 4.0, 3.0)
    assert limit[100:] == pytest.approx(10.0)
    for before in (1, 10, 50):
        assert limit[100 - before] == pytest.approx(math.sqrt(100.0 + 2.0 * 3.0 * before))


@pytest.mark.parametrize("path", [CIRCUIT, FigureEight(), HarmonicRoad(seed=3, distance=200.0)])
@pytest.mark.parametrize("most", [0.5, 2.0])
def test_behind_corners_the_cap_rises_as_gently_as_asked(path: PathComponent, most: float) -> None:
    """Nowhere faster than without, and as slow as needed only: bends have their speed."""
    free, gentle = curvature_cap(path, 4.0, 2.0), curvature_cap(path, 4.0, 2.0, most)
    assert np.diff(gentle**2).max() <= 2.0 * most + 1e-9
    assert (gentle <= free).all()
    assert gentle.min() == pytest.approx(free.min())
    if path.closed:
        assert gentle[0] <= gentle[-1] + 1e-9


@pytest.mark.parametrize("end", [None, 0.0])
def test_a_car_speeds_up_as_gently_as_asked(end: float | None) -> None:
    speed = ConstantSpeed(speed=15.0, a_lat_max=3.0, acceleration=1.0, end=end)
    road = HarmonicRoad(seed=3, distance=200.0)
    limit = stack_profiles([speed.profile()], [road]).cap
    assert np.diff(limit**2).max() <= 2.0 + 1e-6


# ------------------------------------------------------------------------------ closed loop


@pytest.mark.parametrize("speed", [5.0, 9.9, 18.7])
@pytest.mark.parametrize("offset", [0.0, 2.0])
def test_speed_is_held_on_the_circle(speed: float, offset: float) -> None:
    source, plant = ConstantSpeed(speed=speed), SimulatorConfig().make(CAR)
    assert source.start_speed(CIRCLE, 0.0) == speed
    state = plant.reset(Pose(0.0, 0.0, 0.0), speed - offset, 0.02)
    pedals, held = PedalWork(source, CIRCLE, plant.dt, state), np.zeros(kernel.N_STATE)
    steady_turn(CAR.table, 0, held, speed, 0.02)
    errors = []
    for _ in range(400):
        throttle, brake = pedals(state, 0.0)
        state = plant.step(Command(float(held[kernel.STEER]), throttle, brake))
        errors.append(abs(math.hypot(state.v_x, state.v_y) - speed))
    if offset == 0.0:
        assert max(errors) < 0.05
    assert max(errors[200:]) < 0.05


def test_nedc_is_followed_on_a_straight() -> None:
    source, plant = Nedc(), SimulatorConfig().make(CAR)
    straight = build(lookup("path", "straight"), {})
    state = plant.reset(Pose(0.0, 0.0, 0.0), 0.0, 0.0)
    pedals = PedalWork(source, straight, plant.dt, state)
    times, speeds = first_cycle(source)
    worst = 0.0
    for _ in range(round(195.0 / plant.dt)):
        throttle, brake = pedals(state, 0.0)
        state = plant.step(Command(0.0, throttle, brake))
        worst = max(worst, abs(state.v_x - float(np.interp(state.time, times, speeds))))
    # UN R83 allows 2 km/h.
    assert worst < 2.0 / 3.6


# ------------------------------------------------------------------------- constant and random


def test_constant_throttle_starts_at_its_initial_speed() -> None:
    source = ConstantThrottle(throttle=0.4, initial=7.0)
    assert source.start_speed(CIRCLE, 0.0) == 7.0
    assert source.draw(np.random.default_rng(0), 10.0).throttle == 0.4


def test_random_profile() -> None:
    source = RandomProfile(low=3.0, high=20.0, interval=2.0, change=1.5)
    rng = np.random.default_rng(4)
    draws = [source.draw(rng, 60.0) for _ in range(20)]
    for profile in draws:
        assert profile.times[-1] >= 60.0
        assert profile.speeds.min() >= 3.0
        assert profile.speeds.max() <= 20.0
        assert np.abs(np.diff(profile.speeds) / np.diff(profile.times)).max() <= 1.5 + 1e-9
        assert math.sqrt(0.3) <= profile.cap_scale <= 1.0
    assert len({float(p.speeds[0]) for p in draws}) == 20
    # A single run has one draw, whenever it is asked.
    assert (source.breakpoints()[1] == source.breakpoints()[1]).all()


def test_the_seed_decides_a_single_run_and_not_the_training() -> None:
    source, other = RandomProfile(), RandomProfile(seed=7, seconds=300.0)
    assert not np.array_equal(source.breakpoints()[1][:5], other.breakpoints()[1][:5])
    assert other.breakpoints()[0][-1] >= 300.0
    drawn = [s.draw(np.random.default_rng(3), 20.0).speeds for s in (source, other)]
    assert np.array_equal(*drawn)


def test_stacked_profiles_keep_their_ends() -> None:
    one = Profile(None, np.array([0.0, 1.0, 2.0]), np.array([1.0, 2.0, 3.0]), None, 2.0)
    two = Profile(None, np.zeros(1), np.array([7.0]), None, 2.0)
    table = stack_profiles([one, two], [CIRCLE])
    assert (table.speeds[1] == 7.0).all()
    assert (np.diff(table.times, axis=1) > 0.0).all()


# -------------------------------------------------------------------------------------- files


def written(folder: FilePath, text: str) -> FilePath:
    file = folder / "profile.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_profile_from_a_file(tmp_path: FilePath) -> None:
    file = written(tmp_path, "time_s, speed_km_h\n10,0\n\n20,36\n")
    times, speeds = SpeedCsv(file=str(file)).breakpoints()
    assert times == pytest.approx([0.0, 10.0])
    assert speeds == pytest.approx([0.0, 10.0])
    file = written(tmp_path, "gear,speed_m_s,time_s\n1,3,0\n2,4,1\n")
    assert read_profile(file)[1] == pytest.approx([3.0, 4.0])
    file = written(tmp_path, "# t [ms]; v (km/h)\n0; 3,6\n2500; 7,2\n")
    times, speeds = read_profile(file)
    assert times == pytest.approx([0.0, 2.5])
    assert speeds == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty; needs the columns time and speed, e.g. time_s and speed_m_s or speed_km_h"),
        ("time_s,gear\n0,1\n", "line 1: needs the columns"),
        (
            "s_m;x_m;y_m;vx_mps\n0;0;0;1\n",
            "line 1: needs the columns time and speed, e.g. time_s"
            " and speed_m_s or speed_km_h; speeds along a path are speed=path",
        ),
        ("time_s,speed_m_s\n", "holds no breakpoints"),
        ("time_s,speed_m_s\n0,1\n1,fast\n", "line 3: speed_m_s is 'fast', not a finite number"),
        ("time_s,speed_m_s\n0,1\n1,nan\n", "line 3: speed_m_s is 'nan', not a finite number"),
        ("time_s,speed_m_s\n0,1\n1\n", "line 3: speed_m_s is missing"),
        ("time_s,speed_m_s\n0,1\n0,2\n", "line 3: time_s must increase"),
        ("time_s,speed_m_s\n0,1\n1,-2\n", "line 3: speed_m_s must not be negative"),
        # Empty lines count: they are lines of the file too.
        ("time_s,speed_m_s\n\n0,1\n\n0,2\n", "line 5: time_s must increase"),
        ("time_s,speed_m_s\n\n0,1\n\n1,-2\n", "line 5: speed_m_s must not be negative"),
    ],
)
def test_bad_files(tmp_path: FilePath, text: str, said: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(DataError) as caught:
        read_profile(file)
    assert str(file) in str(caught.value)
    assert said in str(caught.value)


def test_unreadable_files(tmp_path: FilePath) -> None:
    with pytest.raises(DataError, match="cannot be read"):
        read_profile(tmp_path / "absent.csv")
    file = tmp_path / "binary.csv"
    file.write_bytes(bytes(range(256)))
    with pytest.raises(DataError, match="not a text file"):
        read_profile(file)
