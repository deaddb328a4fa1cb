"""Paths from CSV files: what is read, and what is refused with a line that helps."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.errors import DataError
from steersman.kernels import path as kernel
from steersman.paths.csv_path import CsvPath
from steersman.paths.tracks import Monza

from .conftest import ellipse, write_csv

LINE = [(10.0 * i, 0.0) for i in range(6)]


def refused(file: FilePath, *, loop: bool | None = None, smoothing: float = 0.0) -> str:
    with pytest.raises(DataError) as caught:
        _ = CsvPath(file=file, loop=loop, smoothing=smoothing).table
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(str(file))
    return text


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("x,y", "{x!r},{y!r}"),
        ("# x_m,y_m,w_tr_right_m,w_tr_left_m", "{x!r},{y!r},5.0,6.0"),
        ("x_m,y_m,w_tr_right_m,w_tr_left_m", "{x!r},{y!r},5.0,6.0"),
        ("# made by hand\n# s_m; x_m; y_m; psi_rad", "0.0; {x!r}; {y!r}; 0.0"),
        ('"Y" , "X"', "{y!r} , {x!r}"),
        ("\ufeffx\ty", "{x!r}\t{y!r}"),
    ],
)
def test_headers(tmp_path: FilePath, header: str, row: str) -> None:
    file = tmp_path / "path.csv"
    rows = [row.format(x=x, y=y) for x, y in ellipse()]
    file.write_text("\r\n".join([header, *rows, "", ""]), encoding="utf-8")
    path = CsvPath(file=file)
    assert path.closed
    assert path.at(0.0)[:2] == pytest.approx((80.0, 0.0), abs=1e-9)
    for x, y in ellipse():
        assert path.project(x, y)[1] == pytest.approx(0.0, abs=1e-7)


def test_spline_follows_the_curve(tmp_path: FilePath) -> None:
    path = CsvPath(file=write_csv(tmp_path / "circle.csv", _circle(90)))
    assert path.length == pytest.approx(100.0 * math.pi, rel=1e-6)
    kappa = [path.at(s).kappa for s in np.linspace(0.0, path.length, 200)]
    assert kappa == pytest.approx([0.02] * 200, abs=5e-5)


def _circle(count: int) -> list[tuple[float, float]]:
    angles = [math.tau * i / count for i in range(count)]
    return [(50.0 * math.cos(a), 50.0 * math.sin(a)) for a in angles]


def test_translation_and_rotation(tmp_path: FilePath) -> None:
    plain = CsvPath(file=write_csv(tmp_path / "a.csv", ellipse()))
    c, n = math.cos(0.7), math.sin(0.7)
    moved_points = [(1000.0 + c * x - n * y, -500.0 + n * x + c * y) for x, y in ellipse()]
    moved = CsvPath(file=write_csv(tmp_path / "b.csv", moved_points))
    assert moved.length == pytest.approx(plain.length, abs=1e-6)
    for s in np.linspace(0.0, plain.length, 31):
        x, y, psi, kappa = plain.at(s)
        there = moved.at(s)
        assert there.x == pytest.approx(1000.0 + c * x - n * y, abs=1e-6)
        assert there.y == pytest.approx(-500.0 + n * x + c * y, abs=1e-6)
        assert math.remainder(there.psi - psi - 0.7, math.tau) == pytest.approx(0.0, abs=1e-6)
        assert there.kappa == pytest.approx(kappa, abs=1e-5)


def test_a_real_track(tmp_path: FilePath) -> None:
    monza = Monza()
    points = [monza.at(5.0 * i)[:2] for i in range(int(monza.length / 5.0))]
    path = CsvPath(file=write_csv(tmp_path / "monza.csv", points))
    assert path.closed
    assert path.length == pytest.approx(monza.length, abs=0.1)
    offsets = [monza.project(*path.at(s)[:2])[1] for s in np.linspace(0.0, path.length, 500)]
    assert np.max(np.abs(offsets)) < 0.05


def test_open_or_closed(tmp_path: FilePath) -> None:
    square = write_csv(tmp_path / "square.csv", [(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)])
    assert not CsvPath(file=square).closed
    assert CsvPath(file=square, loop=True).closed
    ring = write_csv(tmp_path / "ring.csv", [*ellipse(), ellipse()[0]])
    plain = write_csv(tmp_path / "plain.csv", ellipse())
    assert CsvPath(file=ring).length == pytest.approx(CsvPath(file=plain).length)
    assert not CsvPath(file=ring, loop=False).closed
    assert not CsvPath(file=write_csv(tmp_path / "short.csv", LINE[:3])).closed
    line = CsvPath(file=write_csv(tmp_path / "line.csv", LINE))
    assert not line.closed
    assert line.length == pytest.approx(50.0)
    assert np.max(np.abs(line.table.pieces[:, kernel.KAPPA0])) < 1e-12


def test_smoothing_calms_noise(tmp_path: FilePath) -> None:
    rng = np.random.default_rng(5)
    noisy = [(x + rng.normal(0.0, 0.1), y + rng.normal(0.0, 0.1)) for x, y in ellipse(150)]
    file = write_csv(tmp_path / "noisy.csv", noisy)
    rough, smooth = CsvPath(file=file), CsvPath(file=file, smoothing=0.14)
    sharpest = [float(np.max(np.abs(p.table.pieces[:, kernel.KAPPA0]))) for p in (rough, smooth)]
    # The ellipse's own sharpest curvature is a / b^2 = 0.032.
    assert sharpest[1] == pytest.approx(0.032, abs=0.006)
    assert sharpest[0] > 2.0 * sharpest[1]
    assert smooth.closed
    assert math.dist(smooth.at(0.0)[:2], smooth.at(smooth.length - 1e-9)[:2]) < 1e-6


def test_missing_folder_and_binary(tmp_path: FilePath) -> None:
    assert "No such file" in refused(tmp_path / "nowhere.csv")
    assert "is a folder" in refused(tmp_path)
    with pytest.raises(DataError, match="not the name of a file"):
        _ = CsvPath(file=FilePath("a\0b.csv")).table
    with pytest.raises(DataError, match="No such file"):
        _ = CsvPath(file=FilePath("~nobody-of-this-name/b.csv")).table
    garbage = tmp_path / "garbage.csv"
    garbage.write_bytes(bytes(range(256)) * 4)
    assert "not a text file" in refused(garbage)
    garbage.write_bytes(b"x,y\n0,0\n\0\0")
    assert "not a text file" in refused(garbage)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("\n \n", "is empty"),
        ("# only a remark\n", "has no header"),
        ("x,z\n0,0\n", "line 1: no column y"),
        ("0.0,1.0\n2.0,3.0\n", "line 1: no column x and y"),
        ("x,y\n", "holds 0 points"),
        ("x,y\n0,0\n1,1\n", "holds 2 points"),
        ("x,y\n0,0\n1,nan\n2,2\n", "line 3: y is 'nan'"),
        ("x,y\n0,0\ninf,1\n2,2\n", "line 3: x is 'inf'"),
        ("x,y\n0,0\n1e300,1\n2,2\n", "line 3: (1e+300, 1) is too far"),
        ("x,y\n0,0\n1,one\n2,2\n", "line 3: y is 'one', not a finite number"),
        ("x,y\n\n0,0\n1\n2,2\n", "line 4: y is missing"),
        ("x,y\n0,0\n1,\n2,2\n", "line 3: y is missing"),
        ("x;y\n0,5;1\n2;3\n3;4\n", "line 2: x is '0,5', not a finite number"),
        ("x,y\n0,0\n1,1\n1,1\n2,2\n", "line 4: repeats (almost) the point of line 3"),
        ("x,y\n0,0\n10,0\n5,0.1\n15,0\n", "line 3: the path turns back"),
        ("x,y\n0,0\n1e7,0\n2e7,0\n", "give positions in metres"),
        ("x,y\n0,0\n1,0\n1.0001,0.0001\n2,0\n3,0\n", "line 4: repeats (almost)"),
        ("x,y\n0,0\n.02,0\n.02,.02\n.04,.02\n.04,.04\n", "turns with a radius of 0.0"),
    ],
)
def test_bad_content(tmp_path: FilePath, text: str, words: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text, encoding="utf-8")
    assert words in refused(file)


@pytest.mark.parametrize("surplus", [2, 3, 5])
def test_a_lap_that_runs_past_its_start(tmp_path: FilePath, surplus: int) -> None:
    # A second lap's beginning, half a metre further out.
    extra = [(x * 1.005, y * 1.005 + 0.3) for x, y in ellipse()[:surplus]]
    file = write_csv(tmp_path / "lap.csv", ellipse() + extra)
    assert "set loop to false" in refused(file, loop=True)
    assert "set loop to false" in refused(file)
    assert not CsvPath(file=file, loop=False).closed


def test_ends_that_cross(tmp_path: FilePath) -> None:
    # The end comes from the right, crosses the first stretch and stops to its left.
    lap = [(0.0, 0.0), *ellipse()[46:], *ellipse()[:44]]
    lap[0] = (lap[1][0] - 9.0, lap[1][1])
    crossing = [*lap, (lap[0][0] + 3.0, lap[0][1] - 4.0), (lap[0][0] + 5.0, lap[0][1] + 2.0)]
    assert "overlaps or crosses the start" in refused(
        write_csv(tmp_path / "cross.csv", crossing), loop=True
    )


def test_smoothing_needs_points(tmp_path: FilePath) -> None:
    file = write_csv(tmp_path / "short.csv", LINE[:3])
    assert "at least 4 points" in refused(file, smoothing=0.1)
