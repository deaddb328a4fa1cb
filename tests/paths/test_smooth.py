"""Clothoid transitions where curvature jumps."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.config import build
from steersman.errors import ConfigError, DataError
from steersman.kernels import path as kernel
from steersman.kernels.path import PathTable
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.segments import Segment, from_segments
from steersman.paths.smooth import smoothed
from steersman.paths.tracks import Monza
from steersman.types import FloatArray, Pose

from . import xodr_maps as maps

R = 20.0
LINE, QUARTER = Segment(40.0, 0.0, 0.0), Segment(math.pi / 2.0 * R, 1.0 / R, 1.0 / R)
BACK = Segment(30.0, -1.0 / R, -1.0 / R)
SHAPES = {
    "corner": [LINE, QUARTER, LINE],
    "bends": [BACK, QUARTER, Segment(5.0, 0.0, 0.0), BACK, LINE],
    "stadium": [LINE, QUARTER, QUARTER, LINE, QUARTER, QUARTER],
}


START = Pose(7.0, -3.0, 1.0)


def table(name: str, start: Pose = START) -> PathTable:
    return from_segments(SHAPES[name], closed=name == "stadium", start=start)


def jumps(path: PathTable) -> FloatArray:
    """Jumps of curvature between pieces."""
    pieces = path.pieces
    sizes = np.diff(pieces[:, kernel.S0], append=path.meta[0, kernel.LENGTH])
    ends = pieces[:, kernel.KAPPA0] + sizes * pieces[:, kernel.SHARPNESS]
    found: FloatArray = np.abs(ends - np.roll(pieces[:, kernel.KAPPA0], -1))
    return found if path.meta[0, kernel.CLOSED] else found[:-1]


def aside(path: PathTable, other: PathTable) -> FloatArray:
    """How far points of ``other`` lie beside ``path``."""
    length, share = other.meta[0, kernel.LENGTH], path.meta[0, kernel.LENGTH]
    out = []
    for s in np.linspace(0.0, length, 1000):
        x, y, _, _ = kernel.at(other, 0, s)
        out.append(kernel.project_near(path, 0, x, y, s * share / length)[1])
    return np.array(out)


@pytest.mark.parametrize("tolerance", [0.01, 0.1, 0.5])
@pytest.mark.parametrize("name", SHAPES)
def test_continuous_and_within_the_tolerance(name: str, tolerance: float) -> None:
    plain = table(name)
    smooth = smoothed(plain, tolerance)
    assert np.max(jumps(plain)) > 0.04
    assert np.max(jumps(smooth)) < 2e-4
    distances = np.abs(aside(plain, smooth))
    assert np.max(distances) <= tolerance * (1.0 + 1e-3)
    assert np.max(distances) > 0.5 * tolerance  # it is made use of
    assert smooth.meta[0, kernel.CLOSED] == plain.meta[0, kernel.CLOSED]


def test_the_transition_is_a_clothoid() -> None:
    smooth = smoothed(table("corner"), 0.1)
    # The classical shift of an arc by w^2 / (24 R) for a clothoid of length w.
    window = math.sqrt(24.0 * 0.1 * R)
    share = np.array([-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6])
    kappa = [kernel.at(smooth, 0, 40.0 + u * window)[3] for u in share]
    expected = np.clip(share + 0.5, 0.0, 1.0) / R
    assert kappa == pytest.approx(expected, abs=0.03 / R)
    middle = 40.0 + 0.5 * QUARTER.length
    assert aside(table("corner"), smooth)[500] == pytest.approx(0.1, rel=0.02)
    assert kernel.at(smooth, 0, middle)[3] == pytest.approx(1.0 / (R - 0.1), rel=1e-3)


@pytest.mark.parametrize("name", ["corner", "bends"])
def test_open_ends_stay(name: str) -> None:
    plain = table(name)
    smooth = smoothed(plain, 0.2)
    for end in (0.0, 1.0):
        there, here = (kernel.at(p, 0, end * p.meta[0, kernel.LENGTH]) for p in (plain, smooth))
        assert here[:2] == pytest.approx(there[:2], abs=1e-9)
        assert here[3] == pytest.approx(0.0, abs=1e-4)


def test_left_and_right_alike() -> None:
    mirrored = [Segment(s.length, -s.kappa_start, -s.kappa_end) for s in SHAPES["bends"]]
    left = smoothed(table("bends", Pose(0.0, 0.0, 0.0)), 0.1)
    right = smoothed(from_segments(mirrored), 0.1)
    assert left.pieces[:, 1] == pytest.approx(right.pieces[:, 1], abs=1e-9)
    assert left.pieces[:, 2] == pytest.approx(-right.pieces[:, 2], abs=1e-9)


def test_what_has_no_jump_stays() -> None:
    monza = Monza().table
    assert smoothed(monza, 0.1) is monza
    arc = from_segments([QUARTER])
    assert smoothed(arc, 0.1) is arc


def test_too_tight_a_tolerance() -> None:
    with pytest.raises(DataError, match=r"no clothoids of 0\.1 m and more stay within 1e-06 m"):
        smoothed(table("corner"), 1e-6)


def test_lanes_of_a_map(tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "town.xodr", maps.town())
    for words in ({"route": ("a", "a")}, {"route": ("a", "left")}, {"random": 4, "distance": 99.0}):
        plain = OpenDrivePath(file=file, **words)
        smooth = OpenDrivePath(file=file, smooth=0.05, **words)
        assert np.max(jumps(plain.table)) > 0.05
        assert np.max(jumps(smooth.table)) < 5e-4
        assert smooth.closed == plain.closed
        if "random" in words:
            assert smooth.length == 99.0
        else:
            assert np.max(np.abs(aside(plain.table, smooth.table))) < 0.051
    with pytest.raises(DataError, match=r"town\.xodr: no clothoids of 0\.1 m and more"):
        _ = OpenDrivePath(file=file, route=("a", "a"), smooth=1e-6).table
    with pytest.raises(ConfigError, match=r"smooth: 5\.0 is not allowed; must be at most 2"):
        build(OpenDrivePath, {"file": "x", "road": 1, "smooth": 5.0})
