"""The builders: accuracy of long rows, closing, errors, banks of several paths."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.errors import DataError
from steersman.kernels import path as kernel
from steersman.paths.analytic import Circle, FigureEight, Straight
from steersman.paths.segments import Segment, end_pose, from_samples, from_segments, stack
from steersman.paths.tracks import Monza
from steersman.types import Pose

SQUARE = [Segment(20.0, 0.0, 0.0), Segment(5.0 * math.pi, 0.1, 0.1)] * 4


def test_a_hundred_laps_come_back() -> None:
    end = end_pose(SQUARE * 100)
    assert math.hypot(end.x, end.y) < 1e-8


def test_start_pose_moves_the_path() -> None:
    plain = from_segments(SQUARE, closed=True)
    moved = from_segments(SQUARE, closed=True, start=Pose(3.0, -4.0, 1.0))
    for s in np.linspace(0.0, 140.0, 29):
        x, y, psi, kappa = kernel.at(plain, 0, s)
        c, n = math.cos(1.0), math.sin(1.0)
        want = (3.0 + c * x - n * y, -4.0 + n * x + c * y, psi + 1.0, kappa)
        assert kernel.at(moved, 0, s) == pytest.approx(want, abs=1e-9)


def test_small_closing_error_is_spread() -> None:
    rough = [Segment(round(length, 4), *rest) for length, *rest in SQUARE]
    table = from_segments(rough, closed=True)
    length = table.meta[0, kernel.LENGTH]
    start, end = kernel.at(table, 0, 0.0), kernel.at(table, 0, length - 1e-9)
    assert math.dist(start[:2], end[:2]) < 1e-8
    assert end[2] - start[2] == pytest.approx(math.tau, abs=1e-9)


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([Segment(20.0, 0.0, 0.0)], "ends 20 m away"),
        ([Segment(20.0, 0.1, 0.1)], "turned by 2 rad"),
        ([Segment(20.01, 0.0, 0.0), *SQUARE[1:]], "ends 0.01 m away"),
    ],
)
def test_open_ends_are_refused(segments: list[Segment], words: str) -> None:
    with pytest.raises(DataError, match=words):
        from_segments(segments, closed=True)


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([], "at least one segment"),
        ([Segment(1.0, 0.0, 0.0), Segment(0.0, 0.0, 0.0)], "segment 2 .* length 0.0"),
        ([Segment(-1.0, 0.0, 0.0)], "segment 1 .* length -1.0"),
        ([Segment(1.0, math.nan, 0.0)], "curvature nan"),
        ([Segment(math.inf, 0.0, 0.0)], "length inf"),
        ([Segment(1e9, 0.0, 0.0)], "long, the most is"),
        ([Segment(1e5, 1e4, 1e4)], "turns too sharply"),
    ],
)
def test_unusable_segments_are_refused(segments: list[Segment], words: str) -> None:
    with pytest.raises(DataError, match=words):
        from_segments(segments)


def test_samples_give_back_the_clothoid() -> None:
    table = from_segments([Segment(30.0, -0.05, 0.08)], start=Pose(1.0, 2.0, 3.0))
    s = np.linspace(0.0, 30.0, 31)
    x, y, psi, _ = np.array([kernel.at(table, 0, value) for value in s]).T
    again = from_samples(x, y, psi, closed=False)
    assert again.meta[0, kernel.LENGTH] == pytest.approx(30.0, abs=1e-7)
    for value in np.linspace(0.0, 30.0, 77):
        want = kernel.at(table, 0, value)
        assert kernel.at(again, 0, value) == pytest.approx(want, abs=1e-7)


def test_coarse_samples_are_refused() -> None:
    flat = np.zeros(3)
    with pytest.raises(DataError, match="at most"):
        from_samples(np.array([0.0, 1.0, 5.0]), flat, flat, closed=False)
    with pytest.raises(DataError, match="turns more than"):
        from_samples(np.array([0.0, 1.0, 2.0]), flat, np.array([0.0, 0.5, 0.0]), closed=False)


def test_a_bank_holds_the_same_paths() -> None:
    paths = [Circle(), Monza(), Straight(), FigureEight(), Circle(direction="right")]
    bank = stack([path.table for path in paths])
    again = stack([stack([path.table for path in paths[:2]]), *(p.table for p in paths[2:])])
    assert all(np.array_equal(a, b) for a, b in zip(bank, again, strict=True))
    for number, path in enumerate(paths):
        for s in np.linspace(-5.0, path.length + 5.0, 37):
            assert kernel.at(bank, number, s) == kernel.at(path.table, 0, s)
            x, y = path.at(s).x + 0.2, path.at(s).y - 0.1
            assert kernel.project(bank, number, x, y) == kernel.project(path.table, 0, x, y)
            assert kernel.project_near(bank, number, x, y, s) == kernel.project_near(
                path.table, 0, x, y, s
            )


def test_an_empty_bank_is_refused() -> None:
    with pytest.raises(DataError, match="at least one path"):
        stack([])
