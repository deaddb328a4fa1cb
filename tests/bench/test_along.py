"""Drives compared at the same places, whatever their speeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from steersman.bench.along import along_path
from steersman.episode import COLUMNS, Episode

LAP = 400.0


def drive(speed: float = 10.0, factor: float = 1.0, start: float = 0.0, n: int = 600) -> Episode:
    """A lap of a ring whose lateral error depends on the place alone."""
    columns = {name: np.zeros(n) for name in COLUMNS}
    s = start + 0.05 * speed * np.arange(n)
    error = factor * 0.1 * (1.0 + 0.5 * np.sin(2.0 * np.pi * s / LAP))
    columns |= {"s": s % LAP, "lateral_error": error, "v_x": np.full(n, speed)}
    return Episode(columns, "duration", speed * 0.05 * n, 0.05, LAP, True)


def test_places_are_compared_not_times() -> None:
    found = along_path(drive(10.0), drive(17.0, n=300))
    assert found is not None
    assert found.to_m == pytest.approx(254.15)
    error = found.figures["mean_abs_lateral_error_m"]
    assert error.ratio.value == pytest.approx(1.0, abs=1e-3)
    assert error.ratio.high - error.ratio.low < 1e-3
    speed = found.figures["mean_speed_m_s"]
    assert speed.difference.model_dump() == pytest.approx({"value": 7.0, "low": 7.0, "high": 7.0})


def test_a_factor_is_found_although_the_error_varies_along_the_path() -> None:
    found = along_path(drive(), drive(factor=0.5))
    assert found is not None
    ratio = found.figures["rms_lateral_error_m"].ratio
    assert ratio.model_dump() == pytest.approx({"value": 0.5, "low": 0.5, "high": 0.5})
    difference = found.figures["rms_lateral_error_m"].difference
    assert difference.low < difference.value < difference.high < 0.0
    assert 1 <= found.blocks <= found.places


def test_the_end_of_a_lap_is_its_beginning() -> None:
    """A drive that is told to begin just before the seam has the whole stretch in common."""
    found = along_path(drive(), drive(start=LAP - 1e-9))
    assert found is not None
    assert found.to_m - found.from_m == pytest.approx(299.5, abs=0.1)


def test_too_little_in_common_is_not_compared() -> None:
    open_path = replace(drive(n=100), closed=False)
    later = replace(drive(start=200.0, n=100), closed=False)
    assert along_path(open_path, later) is None
    empty = replace(open_path, columns={name: np.zeros(0) for name in COLUMNS})
    assert along_path(open_path, empty) is None
