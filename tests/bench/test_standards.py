"""Standards against closed forms: filters at single frequencies, limits, deadlines."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from steersman.episode import COLUMNS, DURATION, OFF_TRACK, Episode
from steersman.metrics.base import evaluate, metrics
from steersman.metrics.comfort import weighting
from steersman.types import FloatArray

DT, RATE = 0.05, 100.0
BENCH = {name: cls for name, cls in metrics(benchmark=True).items() if cls.benchmark}


def episode(
    across: FloatArray | None = None, *, end: str = DURATION, rows: int = 400, **columns: Any
) -> Episode:
    """Rows at 20 Hz with lateral acceleration ``across`` at 100 Hz."""
    filled = {name: np.zeros(rows) for name in COLUMNS}
    filled |= {name: np.broadcast_to(v, rows).astype(float) for name, v in columns.items()}
    fine = np.zeros((0, 2))
    if across is not None:
        fine = np.stack([np.zeros(5 * rows), across], axis=1)
        filled["a_y"] = across[4::5].copy()
    return Episode(filled, end, 7.0, DT, 100.0, True, fine=fine)


def wave(frequency: float, size: float = 1.0, rows: int = 400) -> FloatArray:
    return size * np.sin(2.0 * np.pi * frequency * np.arange(5 * rows) / RATE)


def test_a_constant_acceleration_passes_r79s_filter_as_it_is() -> None:
    got = evaluate(episode(np.full(2000, 2.5)), BENCH)
    assert got["r79_acceleration_m_s2"] == pytest.approx(2.5)
    assert got["r79_jerk_m_s3"] == pytest.approx(0.0, abs=1e-9)
    assert got["r79"] is True
    assert got["iso_11270"] is True
    assert got["weighted_acceleration_m_s2"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("frequency", [0.1, 0.5, 2.0])
def test_r79_damps_as_a_fourth_order_butterworth(frequency: float) -> None:
    rows = 4000
    swell = np.sin(np.pi * np.arange(5 * rows) / (5 * rows)) ** 2  # no start, no end
    got = evaluate(episode(swell * wave(frequency, rows=rows), rows=rows), BENCH)
    gain = 1.0 / math.sqrt(1.0 + (frequency / 0.5) ** 8)
    assert got["r79_acceleration_m_s2"] == pytest.approx(gain, rel=0.1)
    # The mean of a derivative over T is the difference of the ends: 2 sin(pi f T) / T of the size.
    jerk = gain * 2.0 * abs(math.sin(math.pi * frequency * 0.5)) / 0.5
    assert got["r79_jerk_m_s3"] == pytest.approx(jerk, rel=0.12, abs=2e-3)


@pytest.mark.parametrize(
    ("frequency", "factor"),
    # ISO 2631-1, table 3, W_d in thousandths at third-octave bands.
    [(0.5, 853), (1.0, 1011), (2.0, 890), (4.0, 512), (8.0, 253), (16.0, 125)],
)
def test_weighting_is_that_of_the_standards_table(frequency: float, factor: int) -> None:
    rows = 2000
    got = evaluate(episode(wave(frequency, math.sqrt(2.0), rows), rows=rows), BENCH)
    # The bilinear transform bends the scale near half the sampling rate.
    assert got["weighted_acceleration_m_s2"] == pytest.approx(factor / 1000.0, rel=0.12)
    assert weighting(RATE).shape[1] == 6


@pytest.mark.parametrize(
    ("size", "end", "passes"),
    [(2.9, DURATION, True), (3.2, DURATION, False), (1.0, OFF_TRACK, False)],
)
def test_limits_are_those_of_a_completed_run(size: float, end: str, passes: bool) -> None:
    got = evaluate(episode(np.full(2000, size), end=end), BENCH)
    assert got["r79"] is passes
    assert got["iso_11270"] is passes


def test_a_step_breaks_the_limit_of_jerk() -> None:
    step = np.where(np.arange(2000) < 1000, -1.4, 1.4)
    got = evaluate(episode(step), BENCH)
    assert got["iso_11270"] is False  # 2.8 m/s^2 within half a second
    assert got["r79"] is True  # the filter takes longer than that


def test_without_a_record_nothing_is_said() -> None:
    got = evaluate(episode(), BENCH)
    for name in ("r79_acceleration_m_s2", "r79_jerk_m_s3", "r79", "weighted_acceleration_m_s2"):
        assert got[name] is None
    coarse = replace(episode(), fine=np.ones((800, 2)))
    slow = evaluate(coarse, BENCH)
    assert slow["r79_acceleration_m_s2"] is None  # 40 Hz


def test_what_the_path_asks_for() -> None:
    got = evaluate(episode(v_x=8.0, v_y=6.0, curvature=-0.03), BENCH)
    assert got["path_acceleration_m_s2"] == pytest.approx(3.0)


def test_deadlines_and_shares() -> None:
    took = np.where(np.arange(400) < 3, 0.06, np.where(np.arange(400) < 10, 0.02, 1e-5))
    status = np.where(np.arange(400) < 100, 1.0, 0.0)
    got = evaluate(episode(control_time=took, status=status, course_error=0.1), BENCH)
    assert (got["deadline_misses_50ms"], got["deadline_misses_10ms"]) == (3, 10)
    assert got["saturated_share"] == 0.25
    assert got["rms_course_error_deg"] == pytest.approx(math.degrees(0.1))


def test_a_mirrored_record_measures_the_same() -> None:
    across = np.random.default_rng(0).normal(0.0, 2.0, 2000)
    assert evaluate(episode(across), BENCH) == evaluate(episode(-across), BENCH)


def test_an_empty_run_is_valid() -> None:
    none = Episode({name: np.zeros(0) for name in COLUMNS}, OFF_TRACK, 0.0, DT, 1.0, True)
    values = evaluate(none, BENCH)
    assert values["r79"] is None
    assert values["deadline_misses_50ms"] == 0
