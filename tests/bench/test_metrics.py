"""Metrics against closed forms, symmetries and bounds."""

import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from steersman.contracts.metric import check
from steersman.episode import COLUMNS, DURATION, OFF_TRACK, ROLL_OVER, Episode
from steersman.metrics.base import evaluate, last_half, metric, metrics, summarise

DT = 0.05
COUNT = itertools.count()
STEADY = [name for name, cls in metrics().items() if cls.steady]
LATERAL = (
    *("lateral_error", "heading_error", "course_error", "steer_command", "steer", "wheel_angle"),
    *("a_y", "v_y", "yaw_rate", "curvature", "y", "psi", "path_y"),
)


def episode(n=200, end=DURATION, dt=DT, **columns):
    filled = {name: np.zeros(n) for name in COLUMNS} | {"time": np.arange(n) * dt}
    filled |= {name: np.broadcast_to(v, n).astype(float) for name, v in columns.items()}
    return Episode(filled, end, distance=7.0, dt=dt, path_length=100.0, closed=True)


def signal():
    return st.integers(1, 60).flatmap(lambda k: arrays(float, k, elements=st.floats(-1e3, 1e3)))


@given(signal(), st.data())
def test_a_mirrored_run_measures_the_same(values, data):
    n = len(values)
    columns = {name: data.draw(arrays(float, n, elements=st.floats(-1e3, 1e3))) for name in LATERAL}
    run = episode(n, v_x=np.abs(values), **columns)
    mirrored = replace(run, columns={k: -v if k in LATERAL else v for k, v in run.columns.items()})
    assert summarise(mirrored) == summarise(run)


@pytest.mark.parametrize("value", [-0.3, 0.0, 0.25])
def test_constant_signals(value):
    run = episode(
        lateral_error=value, heading_error=value, course_error=2 * value, steer_command=value,
        a_y=value, v_x=3.0, v_y=4.0, control_time=20e-6,
    )  # fmt: skip
    got = summarise(run)
    size = abs(value)
    for name in STEADY[:4]:
        assert got[name] == pytest.approx(size)
    assert got["mean_abs_heading_error_deg"] == pytest.approx(math.degrees(size))
    assert got["mean_abs_course_error_deg"] == pytest.approx(math.degrees(2 * size))
    for name in ("steer_std", "steer_rate_rms_per_s", "lateral_jerk_rms_m_s3"):
        assert got[name] == pytest.approx(0.0, abs=1e-12)
    assert got["max_lateral_acceleration_m_s2"] == size
    assert got["mean_speed_m_s"] == pytest.approx(5.0)
    for name in ("p50", "p99", "max"):
        assert got[f"control_time_us_{name}"] == pytest.approx(20.0)
    assert (got["distance_m"], got["duration_s"]) == (7.0, pytest.approx(10.0))
    assert got["steady"] == pytest.approx({name: got[name] for name in STEADY})


def test_a_sinusoid_over_whole_periods():
    n, amplitude, omega = 400, 0.2, 2 * math.pi / 5.0  # four periods of 5 s
    wave = amplitude * np.sin(omega * DT * np.arange(n))
    got = summarise(episode(n, lateral_error=wave, steer_command=wave, a_y=wave))
    assert got["rms_lateral_error_m"] == pytest.approx(amplitude / math.sqrt(2))
    assert got["steer_std"] == pytest.approx(amplitude / math.sqrt(2))
    assert got["mean_abs_lateral_error_m"] == pytest.approx(2 * amplitude / math.pi, rel=1e-3)
    assert got["max_abs_lateral_error_m"] == pytest.approx(amplitude)
    # |sin| exceeds sin(0.95 pi/2) for a twentieth of the time
    p95 = amplitude * math.sin(0.95 * math.pi / 2)
    assert got["p95_abs_lateral_error_m"] == pytest.approx(p95, rel=2e-3)
    # A difference over dt of a sinusoid is one of amplitude a w sinc(w dt / 2).
    rate = amplitude * omega / math.sqrt(2) * np.sinc(omega * DT / 2 / math.pi)
    assert got["steer_rate_rms_per_s"] == pytest.approx(rate, rel=2e-3)
    assert got["lateral_jerk_rms_m_s3"] == pytest.approx(rate, rel=2e-3)


def test_a_sinusoid_reverses_twice_a_period():
    """Two turns in 8 s, each seen once the steering came back by the gap; then 15 in a minute."""
    time = np.arange(0.0, 8.0, 0.05)
    wave = 0.1 * np.sin(2.0 * np.pi * time / 4.0)
    swaying = evaluate(episode(160, steer_command=wave))
    assert swaying["steer_reversals_per_min"] == pytest.approx(60.0 * 4 / 8.0)
    trembling = evaluate(episode(160, steer_command=0.04 * wave))
    assert trembling["steer_reversals_per_min"] == 0.0


def test_a_ripple_below_the_gap_is_no_reversal():
    ramp = np.linspace(0.0, 0.5, 200)
    ripple = 0.004 * (-1.0) ** np.arange(200)
    assert evaluate(episode(steer_command=ramp + ripple))["steer_reversals_per_min"] == 0.0
    assert evaluate(episode(steer_command=3.0 * ripple))["steer_reversals_per_min"] > 1000.0


def test_a_ramp_of_lateral_acceleration_has_constant_jerk():
    got = summarise(episode(100, a_y=-2.0 * DT * np.arange(100)))
    assert got["lateral_jerk_rms_m_s3"] == pytest.approx(2.0)
    assert got["max_lateral_jerk_500ms_m_s3"] == pytest.approx(2.0)


def test_the_moving_average_of_jerk_spreads_a_step_over_half_a_second():
    got = summarise(episode(100, a_y=np.where(np.arange(100) < 50, 0.0, 1.0)))
    assert got["max_lateral_jerk_500ms_m_s3"] == pytest.approx(1.0 / 0.5)
    assert got["lateral_jerk_rms_m_s3"] == pytest.approx(1.0 / DT / math.sqrt(99))


def test_a_run_shorter_than_the_window_is_averaged_as_a_whole():
    got = summarise(episode(3, a_y=[0.0, 5.0, 1.0]))
    assert got["max_lateral_jerk_500ms_m_s3"] == pytest.approx(1.0 / (2 * DT))


@given(signal(), st.randoms(use_true_random=False))
def test_the_order_of_rows_matters_to_rates_only(values, random):
    shuffled = list(values)
    random.shuffle(shuffled)
    ordered = ("rate", "jerk", "change", "reversals")
    order_free = [n for n in metrics() if not any(word in n for word in ordered)]
    table = {name: metrics()[name] for name in order_free}
    names = ("lateral_error", "heading_error", "steer_command", "a_y", "v_x", "control_time")
    one = episode(len(values), **dict.fromkeys(names, values))
    other = episode(len(values), **dict.fromkeys(names, np.array(shuffled)))
    assert evaluate(other, table) == pytest.approx(evaluate(one, table), rel=1e-9, abs=1e-9)


@given(signal())
def test_the_sizes_of_lateral_error_are_ordered(values):
    got = summarise(episode(len(values), lateral_error=values))
    mean, rms, p95, largest = (got[name] for name in STEADY[:4])
    slack = 1e-9 + 1e-9 * largest
    assert mean <= rms + slack
    assert rms <= largest + slack
    assert p95 <= largest + slack


@given(signal(), st.floats(0.1, 10.0))
def test_errors_scale_with_their_signal(values, factor):
    one = summarise(episode(len(values), lateral_error=values))
    other = summarise(episode(len(values), lateral_error=factor * values))
    for name in STEADY[:4]:
        assert other[name] == pytest.approx(factor * one[name], rel=1e-9, abs=1e-9)


def test_steady_is_the_last_half():
    error = np.where(np.arange(200) < 100, 9.0, 0.5)
    got = summarise(episode(lateral_error=error))
    assert got["mean_abs_lateral_error_m"] == pytest.approx(4.75)
    assert got["steady"]["max_abs_lateral_error_m"] == 0.5
    assert len(last_half(episode(1))) == 1
    assert last_half(episode(3))["time"].tolist() == pytest.approx([DT, 2 * DT])


@pytest.mark.parametrize(
    ("end", "flags"),
    [
        (DURATION, (True, False, False)),
        (OFF_TRACK, (False, True, False)),
        (ROLL_OVER, (False, False, True)),
        ("interrupted", (False, False, False)),
    ],
)
def test_how_a_run_ended(end, flags):
    got = summarise(episode(end=end))
    assert (got["completed"], got["off_track"], got["rolled_over"]) == flags
    assert all(isinstance(got[name], bool) for name in ("completed", "off_track", "rolled_over"))
    assert got["end"] == end


def test_decisions_are_counted_by_status():
    got = summarise(episode(6, status=[0, 1, 1, 2, 0, 1]))
    assert (got["saturated"], got["fallbacks"]) == (3, 1)
    assert all(type(got[name]) is int for name in ("saturated", "fallbacks"))


def test_percentiles_of_computing_time():
    times = np.arange(1, 102) * 1e-6
    got = summarise(episode(101, control_time=times[::-1]))
    assert got["control_time_us_p50"] == pytest.approx(51.0)
    assert got["control_time_us_p99"] == pytest.approx(100.0)
    assert got["control_time_us_max"] == pytest.approx(101.0)


def test_an_empty_run_has_no_errors_to_report():
    got = summarise(episode(0))
    assert got["mean_abs_lateral_error_m"] is None
    assert got["control_time_us_p99"] is None
    assert (got["duration_s"], got["saturated"], got["completed"]) == (0.0, 0, True)
    assert set(got["steady"].values()) == {None}


def test_a_run_of_one_row_has_changed_nothing():
    got = summarise(episode(1, lateral_error=-0.1, steer_command=0.4, a_y=2.0))
    assert got["steer_std"] == got["steer_rate_rms_per_s"] == got["lateral_jerk_rms_m_s3"] == 0.0
    assert got["max_lateral_jerk_500ms_m_s3"] == 0.0
    assert got["mean_abs_lateral_error_m"] == pytest.approx(0.1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_signal_that_is_not_finite_gives_none_and_valid_json(bad):
    values = np.zeros(20)
    values[[3, 4]] = bad
    columns = {name: values for name in COLUMNS if name not in ("time", "status")}
    got = summarise(episode(20, **columns))
    assert got["rms_lateral_error_m"] is None
    assert got["duration_s"] == pytest.approx(1.0)
    json.dumps(got, allow_nan=False)


@pytest.mark.parametrize("name", metrics(benchmark=True))
def test_every_metric_fulfils_its_contract(name):
    assert check(metrics(benchmark=True)[name]) == []


@pytest.mark.parametrize(
    ("function", "finding"),
    [
        (lambda e: float(np.sum(e["lateral_error"])), "mirror image"),
        (lambda e: 1.0 / len(e), "raises ZeroDivisionError over a drive without rows"),
        (lambda e: float(e["v_x"].sort() or len(e)), "changes the columns"),
        (lambda e: float(next(COUNT)), "and then"),
    ],
)
def test_the_contract_finds(function, finding):
    from steersman.metrics.base import Metric

    wrong = type("Wrong", (Metric,), {"meaning": "m", "function": staticmethod(function)})
    assert any(finding in line for line in check(wrong))


def test_a_metric_that_is_declared_is_measured(monkeypatch):
    from steersman.registry import _REGISTRY

    monkeypatch.setitem(_REGISTRY, "metric", dict(_REGISTRY["metric"]))
    metric("rows_of_test", "-", "rows", "higher", dtype=int)(len)
    assert summarise(episode(7))["rows_of_test"] == 7
    assert "Higher is better" in str(metrics()["rows_of_test"].__doc__)


def test_interventions_are_counted_with_their_time():
    driver = [0, 1, 1, 3, 0, 0, 2, 2]
    got = summarise(episode(8, driver=driver, reason=[0, 5, 5, 3, 0, 0, 6, 6]))
    assert got["interventions"] == 2
    assert got["intervened_s"] == pytest.approx(5 * episode(8).dt)
    assert summarise(episode(3))["interventions"] == 0
    begun = summarise(episode(2, driver=[1, 1]))
    assert begun["interventions"] == 1
