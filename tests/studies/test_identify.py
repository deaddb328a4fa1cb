"""Identification: known cars out of noisy recordings, and what recordings cannot tell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.config import build, lookup
from steersman.engine.jobs import Workers
from steersman.engine.work import Outcome, packed, perform
from steersman.errors import DataError, SteersmanError
from steersman.report.identification import write_identification
from steersman.rollout import RunConfig, run
from steersman.studies.identify import lateral, stretch_replay
from steersman.studies.identify.completion import completed, low_pass
from steersman.studies.identify.estimate import Estimate, estimate
from steersman.studies.identify.identification import (
    Figure,
    Identified,
    check_bounds,
    fitted_rows,
    identify,
)
from steersman.studies.identify.in_range import upset
from steersman.studies.identify.misses import Misses, Selection
from steersman.studies.identify.recording import (
    Log,
    joined,
    of_episode,
    pieces,
    read_log,
    write_log,
)
from steersman.studies.identify.result import write
from steersman.studies.identify.unknowns import (
    SIGMAS,
    Sensors,
    Unknown,
    guess_at,
    steering,
    vehicle_at,
)
from steersman.vehicles import Bmw320i, CarlaModel3, Vehicle

from ..scripts import script

recording = script("benchmarks/hand_driven.py").recording

MODEL3 = CarlaModel3()
OTHER = MODEL3.replace(
    c_f=90e3,
    c_r=80e3,
    yaw_inertia=3000.0,
    steer_delay=0.12,
    steer_lag=0.08,
    max_wheel_angle=1.0,
    steer_bias=0.01,
    brake_force=6000.0,
    map_acceleration=[[0.8 * a - 0.1 for a in row] for row in MODEL3.map_acceleration],
)
# With a strong engine, so that half a minute shows every speed.
STRONG = {"map_acceleration": Vehicle().map_acceleration}
BMW = Bmw320i(**STRONG, steer_rate_up=1.5, steer_rate_down=1.5)
BELIEVED_BMW = Bmw320i(**STRONG, c_f=80e3, c_r=80e3, yaw_inertia=2300.0, max_wheel_angle=0.9)


def value(car: Vehicle, figure: Figure) -> float:
    field, _, rest = figure.name.partition("[")
    found: Any = getattr(car, field)
    for index in rest.replace("]", "").split("[") if rest else ():
        found = found[int(index)]
    return float(found)


def deviations(found: Identified, true: Vehicle) -> dict[str, float]:
    """How many standard deviations each told figure is off."""
    return {
        f.name: SIGMAS * (f.value - value(true, f)) / (0.5 * (f.high - f.low))
        for f in found.figures
        if f.low is not None and f.high is not None and not f.name.startswith(("offset", "arm"))
    }


@pytest.fixture(scope="module")
def of_other() -> Identified:
    return identify(recording(OTHER, 45.0), MODEL3)


def test_a_car_is_recovered(of_other: Identified) -> None:
    off = deviations(of_other, OTHER)
    assert {"steer_delay", "steer_lag", "max_wheel_angle", "steer_bias", "c_f", "c_r"} <= set(off)
    assert {"yaw_inertia", "map_acceleration[2][2]", "steer_curve_factor[1]"} <= set(off)
    sizes = np.abs(list(off.values()))
    assert np.max(sizes) < 4.0
    assert np.mean(sizes < SIGMAS) > 0.8
    near = {"steer_delay": 0.005, "steer_lag": 0.01, "steer_bias": 0.002}
    for name in ("max_wheel_angle", "c_f", "c_r", "yaw_inertia"):
        near[name] = 0.08 * getattr(OTHER, name)
    for name, tolerance in near.items():
        assert getattr(of_other.vehicle, name) == pytest.approx(getattr(OTHER, name), abs=tolerance)


LINEAR = MODEL3.replace(
    mass=1500.0, yaw_inertia=2500.0, l_f=1.2, l_r=1.5, c_f=80e3, c_r=95e3, max_wheel_angle=0.6,
    steer_delay=0.12, steer_lag=0.1,
)  # fmt: skip


def single_track(file: FilePath, seconds: float = 40.0, h: float = 0.002) -> FilePath:
    """A noisy recording of that car as a linear single-track model (Rajamani, eq. 2.45 f.)."""
    rng, car = np.random.default_rng(3), LINEAR
    n, row = round(seconds / h), round(0.02 / h)
    time = h * np.arange(n)
    speed = np.interp(
        time / seconds, [0, 0.2, 0.3, 0.5, 0.6, 0.75, 0.8, 1], [5, 5, 9, 9, 15, 15, 20, 20]
    )
    command, k, side = np.zeros(n), 0, 1.0
    while k < n:
        until = k + round(rng.uniform(0.5, 1.5) / h)
        most = min(0.8, 8.1 / speed[k] ** 2 / car.max_wheel_angle * (1.0 + 0.003 * speed[k] ** 2))
        command[k:until] = side * rng.uniform(0.3, 1.0) * most * (rng.random() > 0.3)
        k, side = until, -side
    command = np.repeat(command[::row], row)[:n]
    acting = np.concatenate([np.zeros(round(car.steer_delay / h)), command])[:n]
    wheel = v_y = rate = 0.0
    rows = []
    for u, v in zip(acting * car.max_wheel_angle, speed, strict=True):
        wheel += h / car.steer_lag * (u - wheel)
        front = car.c_f * (wheel - (v_y + car.l_f * rate) / v)
        rear = -car.c_r * (v_y - car.l_r * rate) / v
        a_y = (front + rear) / car.mass
        v_y, rate = (
            v_y + h * (a_y - v * rate),
            rate + h * (car.l_f * front - car.l_r * rear) / car.yaw_inertia,
        )
        rows.append((rate, a_y))
    told = np.column_stack([time, command, speed, rows])[::row]
    told += rng.normal(size=told.shape) * (0.0, 0.0, 0.03, 0.0035, 0.08)
    head = "time,steer_command,v_x,yaw_rate,a_y"
    np.savetxt(file, told, delimiter=",", header=head, comments="", fmt="%.6g")
    return file


def test_a_lag_is_not_taken_for_slow_rates(tmp_path: FilePath) -> None:
    """They look alike: rates far from limiting stay as they are believed to be."""
    wrong = {"yaw_inertia": 3000.0, "c_f": 100e3, "c_r": 100e3, "max_wheel_angle": 0.5}
    believed = LINEAR.replace(
        **wrong, steer_delay=0.0, steer_lag=0.0, steer_rate_up=10.0, steer_rate_down=10.0,
        steer_curve_speed=(0.0, 30.0), steer_curve_factor=(1.0, 1.0), ackermann=False,
    )  # fmt: skip
    found = identify(read_log(single_track(tmp_path / "log.csv")), believed, 0.0)
    assert (found.vehicle.steer_rate_up, found.vehicle.steer_rate_down) == (10.0, 10.0)
    (lag,) = (f for f in found.figures if f.name == "steer_lag")
    assert lag.high is not None
    assert lag.low is not None
    assert lag.high - lag.low < 0.03
    assert lag.value == pytest.approx(0.1, abs=0.015)
    # The tyres of a linear model are not quite ours.
    assert found.vehicle.c_f == pytest.approx(80e3, rel=0.1)
    assert found.vehicle.c_r == pytest.approx(95e3, rel=0.1)


def test_held_out_errors_are_little_more_than_noise(of_other: Identified) -> None:
    """Predictions over 1 s begin at a noisy yaw rate."""
    errors = {e.signal: e for e in of_other.errors}
    assert errors["yaw_rate"].noise == pytest.approx(0.005, rel=0.2)
    assert errors["a_y"].noise == pytest.approx(0.1, rel=0.2)
    assert 0.0045 < errors["yaw_rate"].after < 0.007
    assert 0.09 < errors["a_y"].after < 0.13
    for error in errors.values():
        assert error.after < 0.5 * error.before
        assert error.rows > 100


def test_what_was_never_driven_is_kept_and_marked(of_other: Identified, tmp_path: FilePath) -> None:
    kept = {f.name: f for f in of_other.figures if f.low is None}
    assert "map_acceleration[5][6]" in kept
    for figure in kept.values():
        assert value(of_other.vehicle, figure) == value(MODEL3, figure)
        assert figure.status in {"kept", "none seen", "at least"}
    write(of_other, tmp_path / "car.yaml")
    text = (tmp_path / "car.yaml").read_text(encoding="utf-8")
    assert "kept: not determined by this recording" in text
    read = build(lookup("vehicle", "file"), {"file": str(tmp_path / "car.yaml")})
    assert read.model_dump(exclude={"file"}) == of_other.vehicle.model_dump()


def test_the_page_has_a_figure_for_each_signal(of_other: Identified, tmp_path: FilePath) -> None:
    write_identification(of_other, tmp_path / "fit.html")
    figures = {file.stem for file in (tmp_path / "fit_plots").iterdir()}
    assert {"yaw_rate", "a_y_left", "v_x", "throttle_map", "autocorrelation"} <= figures
    page = (tmp_path / "fit.html").read_text(encoding="utf-8")
    assert page.count("<svg") == len(figures)
    assert "Determined by the recording" in page


class Elsewhere(Workers):
    """Hands every job over pickled, as to another process."""

    def outcomes(self, work: Any, jobs: Any, **_: Any) -> Iterator[list[Outcome]]:
        self.keys = [job.key for job in jobs]
        for job in jobs:
            yield perform(packed(work, [job]).data, lambda *_: None)


def test_a_slow_actuator_is_told_from_a_delay() -> None:
    log = recording(BMW, 30.0, acceleration=2.0, top=15.0, throttles=(0.4, 0.5, 0.6))
    workers = Elsewhere()
    found = identify(log, BELIEVED_BMW, 0.0, workers=workers).vehicle
    assert workers.keys == ["0", "1"]
    assert found.steer_rate_up == pytest.approx(1.5, rel=0.15)
    assert found.steer_rate_down == pytest.approx(1.5, rel=0.15)
    assert found.steer_delay < 0.01
    assert found.steer_lag == 0.0


# ------------------------------------------------------------------------ what is not told


def test_straight_driving_tells_nothing_of_the_steering() -> None:
    found = identify(recording(MODEL3, 10.0, acceleration=0.0), Bmw320i(), 0.0)
    told = {f.name for f in found.figures if f.low is not None}
    assert not told & {"steer_delay", "c_f", "c_r", "yaw_inertia", "max_wheel_angle", "steer_lag"}
    for name in ("c_f", "c_r", "yaw_inertia", "max_wheel_angle", "steer_delay", "steer_rate_up"):
        assert getattr(found.vehicle, name) == getattr(Bmw320i(), name)


def test_a_constant_throttle_tells_its_own_row_only() -> None:
    log = recording(MODEL3, 8.0, throttles=(0.5,))
    found = identify(log, MODEL3, 0.0)
    rows = {f.name[17] for f in found.figures if f.name.startswith("map") and f.low is not None}
    own = MODEL3.map_throttle.index(0.5)
    assert rows <= {str(own), str(own + 1)}
    assert str(own) in rows


# ------------------------------------------------------------------------------ estimation


def plain(count: int, need: float) -> list[Unknown]:
    return [Unknown("z", (i,), "-", 0.0, False, 1.0, need, -10.0, 10.0) for i in range(count)]


def linear(seed: int, *, coloured: bool = False, outliers: bool = False) -> tuple[Misses, Any]:
    rng = np.random.default_rng(seed)
    slopes = rng.standard_normal((400, 3))
    slopes[:, 2] = 0.0
    if coloured:
        slopes[:, 0] = 1.0
    noise = rng.standard_normal(400)
    if coloured:
        for k in range(1, 400):
            noise[k] += 0.7 * noise[k - 1]
    if outliers:
        noise[::20] += 50.0
    true = np.array([0.5, -0.3, 0.4])

    def of(z: Any) -> Any:
        return (0.3 * slopes @ (z - true) - noise)[:, None]

    return Misses(of, plain(3, need=3.0), np.array([1e-6])), true


@pytest.mark.parametrize("kind", ["white", "coloured", "outliers"])
def test_intervals_hold_the_truth_as_often_as_they_say(kind: str) -> None:
    inside = []
    for seed in range(150):
        misses, true = linear(seed, coloured=kind == "coloured", outliers=kind == "outliers")
        zero = np.zeros(3)
        found = estimate(misses, zero, Selection.of(misses))
        assert found.determined.tolist() == [True, True, False]
        assert found.z[2] == 0.0
        half = SIGMAS * np.sqrt(np.diag(found.covariance))[:2]
        inside.append(np.abs(found.z - true)[:2] <= half)
    share = np.mean(inside, axis=0)
    assert (share > 0.88).all()
    assert (share < 0.995).all()


def test_the_uncertainty_of_what_is_held_is_in_the_intervals() -> None:
    rng = np.random.default_rng(0)
    both, noise = rng.standard_normal((2, 500))

    def of(z: Any) -> Any:  # only the sum shows
        return (both * (z[0] + z[1]) - 0.1 * noise)[:, None]

    misses = Misses(of, plain(2, need=1.0), np.array([1e-6]))
    found = estimate(misses, np.zeros(2), Selection.of(misses))
    (kept,) = np.flatnonzero(found.determined)
    assert found.given[kept] == 1 - kept
    assert np.sqrt(found.covariance[kept, kept]) == pytest.approx(1.0, rel=0.1)


def test_lateral_intervals_cover(tmp_path: FilePath) -> None:
    """A few noisy recordings of one drive; the record in results/identify has many."""
    clean = recording(OTHER, 40.0, noise=0.0)
    stretches = stretch_replay.stretches(clean, OTHER)
    stretches = [s._replace(driven=s.pedals) for s in stretches]
    use = np.full(len(clean.time), True)
    off = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        noisy = dict(clean.signals)
        for name, deviation in (("yaw_rate", 0.005), ("a_y", 0.1)):
            noisy[name] = noisy[name] + deviation * rng.standard_normal(len(clean.time))
        log = clean._replace(signals=noisy)
        unknowns = steering(OTHER, lateral.channels(log), by_angle=False)
        misses = lateral.misses_of(OTHER, log, stretches, unknowns, use)
        found = estimate(misses, np.zeros(len(unknowns)), Selection.of(misses))
        seen = found.determined
        sizes = np.abs(found.z[seen]) / np.sqrt(np.diag(found.covariance))[seen]
        off += sizes.tolist()
    assert len(off) > 50
    assert 0.87 < np.mean(np.array(off) < SIGMAS) <= 1.0


def test_the_same_recording_gives_the_same_figures() -> None:
    log = recording(MODEL3, 4.0)
    one, two = (identify(log, MODEL3, 0.0) for _ in range(2))
    assert one.figures == two.figures


# --------------------------------------------------------------------------------- files


def test_csv_round_trip(tmp_path: FilePath) -> None:
    log = recording(MODEL3, 20.0)
    log.signals["a_y"][7] = np.nan
    write_log(log, tmp_path / "log.csv")
    read = read_log(tmp_path / "log.csv")
    assert list(read.signals) == list(log.signals)
    np.testing.assert_allclose(read.time, log.time, rtol=1e-8)
    for name, values in log.signals.items():
        np.testing.assert_allclose(read.signals[name], values, rtol=1e-8, atol=1e-9)


def test_units_of_columns(tmp_path: FilePath) -> None:
    head = "time_ms;steer_angle_deg;v_x_km_h;yaw_rate_deg_s;throttle_percent\n"
    rows = "".join(f"{50 * k};90;36;{k % 7};{k % 3}\n" for k in range(200))
    (tmp_path / "log.csv").write_text(head + rows, encoding="utf-8")
    log = read_log(tmp_path / "log.csv", lock=float(np.pi))
    assert log.time[1] == pytest.approx(0.05)
    assert log.signals["steer_command"][0] == pytest.approx(0.5)
    assert log.signals["v_x"][0] == pytest.approx(10.0)
    assert log.signals["yaw_rate"][1] == pytest.approx(np.radians(1.0))
    assert log.signals["throttle"][2] == pytest.approx(0.02)


COLUMNS = "time=t(s),steer_command=-cmd,v_x_km_h=v(km/h),yaw_rate_deg_s=r,throttle=pedal(kPa)/200"


def test_columns_by_name_unit_sign_and_factor(tmp_path: FilePath) -> None:
    rows = "".join(f"{0.05 * k:.2f},0.5,36,{k % 7},{k % 3}\n" for k in range(200))
    (tmp_path / "log.csv").write_text("# t(s),cmd,v(km/h),r,pedal(kPa)\n" + rows, encoding="utf-8")
    log = read_log(tmp_path / "log.csv", columns=COLUMNS)
    assert log.signals["steer_command"][0] == -0.5
    assert log.signals["v_x"][0] == pytest.approx(10.0)
    assert log.signals["yaw_rate"][1] == pytest.approx(np.radians(1.0))
    assert log.signals["throttle"][2] == pytest.approx(0.01)
    both = joined([log, log])
    assert len(pieces(both)) == 2
    for text, said in (
        ("time=zeit", "no column 'zeit' for time"),
        ("tyme=t(s)", "no column is called 'tyme' here; did you mean"),
        ("carle", "'carle' is not NAME=TITLE; write e.g. time=TITLE"),
        (COLUMNS.replace("pedal", "pedl"), "no column 'pedl(kPa)/200' for throttle"),
    ):
        with pytest.raises(SteersmanError) as error:
            read_log(tmp_path / "log.csv", columns=text)
        assert said in str(error.value)


def test_a_log_of_carlas_client_needs_no_rewriting(tmp_path: FilePath) -> None:
    time = np.arange(0.0, 20.0, 0.05)
    yaw = -0.2 * time  # to the right, which CARLA counts positive
    table = np.column_stack(
        [time, -50.0 * np.sin(yaw), 50.0 * (1.0 - np.cos(yaw)), -yaw, 0.0 * time + 10.0,
         0.0 * time + 0.1, 0.0 * time + 0.4, 0.0 * time]
    )  # fmt: skip
    head = "time,x,y,yaw,speed,steer_normalized,throttle,brake"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=head, comments="")
    log = completed(read_log(tmp_path / "log.csv", columns="carla"), MODEL3)
    assert log.signals["steer_command"][0] == -0.1
    assert log.signals["yaw_rate"][10:-10] == pytest.approx(-0.2, abs=1e-6)
    assert log.signals["v_y"][10:-10] == pytest.approx(0.0, abs=1e-3)


def test_an_episode_is_a_recording(tmp_path: FilePath) -> None:
    episode = run(build(RunConfig, {"path": "circle", "duration": 10.0}))
    episode.save(tmp_path / "episode.npz")
    log, same = read_log(tmp_path), of_episode(episode)
    for name in ("steer_command", "throttle", "v_x", "yaw_rate", "a_y", "wheel_angle"):
        assert (log.signals[name] == same.signals[name]).all()
    # What it says is what the simulator does.
    car = MODEL3
    (stretch,) = stretch_replay.stretches(log, car)
    states = stretch_replay.lateral(car, stretch._replace(driven=stretch.pedals))
    found = stretch_replay.responses(car, stretch, states, ["yaw_rate"], Sensors({}, {}))[20:, 0]
    np.testing.assert_allclose(found, log.signals["yaw_rate"][20:], atol=1e-4)


HEAD = "time,steer_command,v_x,yaw_rate\n"
ROWS = "".join(f"{0.05 * k:.2f},0,10,0\n" for k in range(200))
WRONG = [
    ("", "is empty"),
    ("time,steer_command,v_x\n", "no column yaw_rate_rad_s or yaw_rate_deg_s"),
    ("time,steer_command,v_x,yaw_ratee\n", "is 'yaw_ratee' it?"),
    (
        "time,LRW [deg],v_x,yaw_rate\n",
        "in 'time, LRW [deg], v_x, yaw_rate'; name it with --columns steer_command=TITLE, or"
        " steer_angle or wheel_angle instead",
    ),
    ("time,steer_angle,v_x,yaw_rate\n" + ROWS, "--lock ANGLE"),
    ("time,time_ms,steer_command,v_x,yaw_rate\n", "time and time_ms are the same"),
    (HEAD + "0,0,10,0\n0.05,x,10,0\n", "line 3: steer_command is 'x', not a finite number"),
    (HEAD + "0,0,10\n", "line 2: yaw_rate is missing"),
    (HEAD + "0,0,10,0\n0,0,10,0\n", "line 3: time must increase"),
    (HEAD + "0,0,10,0\n1e308,0,10,0\n", "line 3: time is more than 1e"),
    (HEAD + ",0,10,0\n", "line 2: time is missing"),
    (HEAD + "0,0,10,0\n", "1 rows over 0.0 s are too few"),
    (HEAD + "".join(f"{50 * k},0,10,0\n" for k in range(200)), "time_ms is in milliseconds"),
]


@pytest.mark.parametrize(("text", "said"), WRONG)
def test_files_that_are_wrong(text: str, said: str, tmp_path: FilePath) -> None:
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DataError) as error:
        read_log(tmp_path / "log.csv")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def scaled(name: str, factor: float) -> Callable[[dict[str, Any]], None]:
    def change(signals: dict[str, Any]) -> None:
        signals[name] = signals[name] * factor

    return change


def without(name: str, change: Callable[[dict[str, Any]], None]) -> Callable[..., None]:
    def both(signals: dict[str, Any]) -> None:
        del signals[name]
        change(signals)

    return both


MISTAKEN = [
    (scaled("steer_command", -1.0), "turns against its steering"),
    (scaled("yaw_rate", 180.0 / np.pi), "name it yaw_rate_deg_s"),
    (without("a_y", scaled("yaw_rate", 180.0 / np.pi)), "is yaw_rate in degrees"),
    (scaled("a_y", 1.0 / 9.81), "name it a_y_g"),
    (scaled("a_y", -1.0), "a_y and yaw_rate have opposite signs"),
    (scaled("v_x", 3.6), "name it v_x_km_h"),
    (scaled("steer_command", 100.0), "in percent name it steer_command_percent"),
    (scaled("throttle", 100.0), "in percent name it throttle_percent"),
]


@pytest.mark.parametrize(("change", "said"), MISTAKEN)
def test_wrong_units_and_signs_are_told(change: Callable[..., None], said: str) -> None:
    log = recording(MODEL3, 30.0, 3)
    signals = dict(log.signals)
    change(signals)
    with pytest.raises(DataError) as error:
        identify(log._replace(signals=signals), MODEL3, 0.0)
    assert said in str(error.value)


# ------------------------------------------------------------------------------ sensors


def sensed(seconds: float = 40.0, **more: Any) -> Log:
    """A drive with v_y, and the heading."""
    keep = ("steer_command", "v_x", "v_y", "yaw_rate", "wheel_angle")
    log = recording(MODEL3.replace(c_f=120e3, **more), seconds, keep=keep)
    clean = recording(MODEL3.replace(c_f=120e3, **more), seconds, keep=("yaw_rate",), noise=0.0)
    heading = np.concatenate([[0.0], np.cumsum(clean.signals["yaw_rate"][:-1]) * 0.05])
    heading += 0.5 * 0.05 * (clean.signals["yaw_rate"] - clean.signals["yaw_rate"][0])
    return log._replace(signals={**log.signals, "yaw": heading})


def test_where_a_sensor_sits_and_how_it_is_turned_is_found() -> None:
    log = sensed(20.0)
    signals = {name: log.signals[name] for name in ("steer_command", "v_x", "yaw_rate")}
    signals["v_y"] = log.signals["v_y"] - 0.45 * log.signals["yaw_rate"] + 0.02 * log.signals["v_x"]
    found = {f.name: f for f in identify(log._replace(signals=signals), MODEL3, 0.0).figures}
    assert found["arm[v_y]"].value == pytest.approx(-0.45, abs=0.1)
    assert found["offset[v_y]"].value == pytest.approx(0.02, abs=0.003)


def test_a_low_passed_yaw_rate_is_seen_in_the_heading() -> None:
    log = sensed()
    slow = low_pass(log.signals["yaw_rate"], 0.3, 0.05)
    slow[300:330] += 0.3
    shown = completed(log._replace(signals={**log.signals, "yaw_rate": slow}), MODEL3)
    assert shown.yaw_rate_lag == pytest.approx(0.3, abs=0.03)
    assert shown.contradicting > 1.0
    assert np.isnan(shown.signals["yaw_rate"][300:330]).all()
    assert completed(log, MODEL3).yaw_rate_lag == 0.0
    off = {**log.signals, "yaw_rate": log.signals["yaw_rate"] + 0.02}
    assert completed(log._replace(signals=off), MODEL3).yaw_rate_offset == pytest.approx(
        0.02, abs=1e-3
    )
    assert completed(log, MODEL3).contradicting < 1.0


def test_a_standstill_tells_the_gyroscopes_offset() -> None:
    log = sensed(10.0)
    signals = {name: values + 0.0 for name, values in log.signals.items() if name != "yaw"}
    signals["v_x"][:60], signals["yaw_rate"][:60] = 0.0, 0.0
    signals["yaw_rate"] += 0.02
    shown = completed(log._replace(signals=signals), MODEL3)
    assert shown.yaw_rate_offset == pytest.approx(0.02)
    assert shown.signals["yaw_rate"][:60] == pytest.approx(0.0, abs=1e-9)


def test_positions_and_heading_stand_for_speeds() -> None:
    time = np.arange(0.0, 20.0, 0.05)
    yaw = 0.2 * time + 3.0
    course = yaw + 0.05  # side-slip
    signals = {
        "x": 50.0 * (np.sin(course) - np.sin(course[0])),
        "y": -50.0 * (np.cos(course) - np.cos(course[0])),
        "yaw": (yaw + np.pi) % (2.0 * np.pi) - np.pi,
        "speed": np.full(len(time), 10.0),
        "steer_command": np.zeros(len(time)),
    }
    shown = completed(Log("log", time, signals), MODEL3).signals
    assert shown["yaw_rate"][5:-5] == pytest.approx(0.2, abs=1e-6)
    assert shown["v_y"][5:-5] == pytest.approx(10.0 * np.sin(0.05), abs=1e-3)
    assert shown["v_x"][5:-5] == pytest.approx(10.0 * np.cos(0.05), abs=1e-3)


def test_a_measured_angle_is_replayed_without_the_actuator() -> None:
    log = sensed(30.0)
    signals = {name: log.signals[name] for name in ("v_x", "yaw_rate", "wheel_angle")}
    signals["wheel_angle"] = np.roll(signals["wheel_angle"], 2)  # stamped 0.1 s late
    start = MODEL3.replace(steer_delay=0.2)
    found = identify(log._replace(signals=signals), start, 0.0)
    clock = next(f for f in found.figures if f.name == "clock[wheel_angle]")
    assert clock.value == pytest.approx(-0.1, abs=0.03)
    assert found.vehicle.steer_delay == 0.2
    assert found.vehicle.steer_rate_up == MODEL3.steer_rate_up


def test_a_figure_at_its_bound_is_an_error() -> None:
    unknowns = steering(MODEL3, ["yaw_rate"], by_angle=False)
    count, names = len(unknowns), [u.name for u in unknowns]
    log = Log("drive.csv", np.zeros(1), {})

    def fit(name: str, side: int, *, determined: bool = True) -> lateral.Fitted:
        z, i = np.zeros(count), names.index(name)
        z[i] = unknowns[i].bounds()[side]
        told = np.full(count, determined)
        zero = np.zeros((count, count))
        found = Estimate(z, told, zero, [-1] * count, np.ones(count), np.ones(1))
        return lateral.Fitted(unknowns, found, MODEL3, np.zeros(count))

    said = r"drive.csv: the fit drives yaw_inertia to its bound of 1.*kg m\^2, .*low-passed"
    with pytest.raises(DataError, match=said):
        check_bounds(log, [fit("yaw_inertia", 1)])
    with pytest.raises(DataError, match=r"drives steer_delay to its bound of 0.5 s.*clocks"):
        check_bounds(log, [fit("steer_delay", 1)])
    check_bounds(log, [fit("steer_delay", 0)])  # no delay is a natural one
    check_bounds(log, [fit("yaw_inertia", 1, determined=False)])


def test_rows_that_no_command_explains_are_left_out() -> None:
    time, rng = np.arange(0.0, 60.0, 0.05), np.random.default_rng(0)
    left = rng.standard_normal((len(time), 2))
    assert not upset(time, left, np.ones(2)).any()
    left[400:410, 1] += 20.0
    found = time[upset(time, left, np.ones(2))]
    assert 19.2 < found[0] < 20.0
    assert 20.4 < found[-1] < 21.3
    left[:, 0] *= 50.0  # a model that fails throughout is no kerb
    assert not upset(time, left, np.ones(2)).any()


# -------------------------------------------------------------------------------- the rest


def test_gaps_unequal_steps_and_empty_cells_do_no_harm() -> None:
    log = recording(MODEL3.replace(c_f=90e3, steer_delay=0.1), 24.0)
    rng = np.random.default_rng(0)
    keep = rng.uniform(size=len(log.time)) > 0.1
    keep[300:330] = False
    signals = {name: values[keep].copy() for name, values in log.signals.items()}
    signals["yaw_rate"][rng.uniform(size=keep.sum()) < 0.05] = np.nan
    signals["yaw_rate"][rng.uniform(size=keep.sum()) < 0.02] = 3.0
    del signals["throttle"]
    shaken = Log("shaken", log.time[keep], signals)
    assert len(pieces(shaken)) == 2
    found = identify(shaken, MODEL3, 0.0).vehicle
    assert found.c_f == pytest.approx(90e3, rel=0.15)
    assert found.steer_delay == pytest.approx(0.1, abs=0.03)


def test_blocks_are_held_out_evenly() -> None:
    log = Log("x", np.arange(0.0, 100.0, 0.05), {})
    use = fitted_rows(log, 0.3)
    assert np.mean(~use) == pytest.approx(0.3, abs=0.02)
    changes = np.flatnonzero(np.diff(use.astype(int)))
    assert np.allclose(log.time[changes + 1] % 10.0, 0.0, atol=1e-6)
    assert fitted_rows(log, 0.0).all()
    with pytest.raises(DataError, match="too short to hold"):
        fitted_rows(Log("x", np.arange(0.0, 15.0, 0.05), {}), 0.25)


def test_unknowns_go_there_and_back() -> None:
    unknowns = steering(OTHER, ["yaw_rate"], by_angle=False)
    rng = np.random.default_rng(0)
    z = rng.uniform(-0.2, 0.2, len(unknowns))
    car, guess = vehicle_at(OTHER, unknowns, z), guess_at(OTHER, unknowns, z)
    for one, other in zip(car.table, guess.table, strict=True):
        assert np.array_equal(one, other)
    for unknown, step in zip(unknowns, z, strict=True):
        if unknown.sensor:
            continue
        found: Any = getattr(car, unknown.field)
        for i in unknown.at:
            found = found[i]
        assert unknown.z(found) == pytest.approx(step, abs=1e-9)
