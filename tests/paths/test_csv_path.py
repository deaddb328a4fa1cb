"""Paths from CSV files: what is read, and what is refused with a line that helps."""

from __future__ import annotations

import math
import re
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from steersman.config import build
from steersman.errors import ConfigError, DataError
from steersman.kernels import path as kernel
from steersman.paths.analytic import Circle
from steersman.paths.bends import too_sharp
from steersman.paths.csv_path import CsvPath
from steersman.paths.tracks import Monza
from steersman.vehicles import CarlaModel3

from .conftest import ellipse, write_csv

LINE = [(10.0 * i, 0.0) for i in range(6)]


def refused(file: FilePath, **fields: Any) -> str:
    with pytest.raises(DataError) as caught:
        _ = CsvPath(file=file, **fields).table
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
    kappa = [path.at(s).curvature for s in np.linspace(0.0, path.length, 200)]
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
        assert there.curvature == pytest.approx(kappa, abs=1e-5)


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
        ("0,1,2\n2,3,4\n4,5,6\n", "line 1: no header names the 3 columns; set columns to x=NUMBER"),
        (
            "# time; way\n2;3\n4;5\n6;7\n",
            "line 1: no column x and y in 'time, way'",
        ),
        ("lat,z\n0,0\n", "line 1: no column longitude"),
        (
            "Zeit [ms];B [deg];L [deg];Geschw [km/h];Kurs gegen Nord [deg];H [m]\n0;1;2;3;4;5\n",
            "Kurs gegen Nord [deg], H [m]'; set columns to x=TITLE,y=TITLE or"
            " latitude=TITLE,longitude=TITLE",
        ),
        ("lat,lon\n48,11\n98,11\n", "line 3: (98, 11) is no latitude and longitude"),
        ("x [furlong],y [m]\n0,0\n", "line 1: x in 'furlong' is not known; its units: m, km"),
        ("X,Y\n11.57,48.13\n11.571,48.13\n11.572,48.13\n", "set columns to longitude=X,latitude=Y"),
        ("x,y\n", "holds 0 points"),
        ("x,y\n0,0\n1,nan\n2,2\n", "line 3: y is 'nan'"),
        ("x,y\n0,0\ninf,1\n2,2\n", "line 3: x is 'inf'"),
        ("x,y\n0,0\n1e300,1\n2,2\n", "line 3: (1e+300, 1) is too far"),
        ("x,y\n0,0\n1,one\n2,2\n", "line 3: y is 'one', not a finite number"),
        ("x,y\n\n0,0\n1\n2,2\n", "line 4: y is missing"),
        ("x,y\n0,0\n1,\n2,2\n", "line 3: y is missing"),
        ("x;y\n1.00,5;1\n2;3\n3;4\n", "line 2: x is '1.00,5', not a finite number"),
        ("x,y\n5,5\n5,5\n5,5\n", "holds 1 points"),
        ("x,y\n0,0\n10,0\n5,0.1\n15,0\n", "line 3: the path turns back"),
        ("x,y\n0,0\n1e7,0\n2e7,0\n", "give positions in metres"),
        ("x,y\n0,0\n2e5,0\n4e5,9e4\n", "if they are in mm, set columns to x_mm=x,y_mm=y"),
        ("x,y\n0,0\n.2,0\n.4,.1\n", "if in km, to x_km=x,y_km=y"),
        ("Logger 7\nDate: 2024-05-01, 10:30\na,b\n0,0\n1,0\n2,0\n", "line 3: no column x and y"),
        ("Logger 7, serial\nx [ft US],y\n0,0\n1,0\n2,0\n", "line 2: x in 'ftus' is not known"),
        ("x,y\n0,0\n.5,0\n.5,.02\n1,.02\n1,.04\n1.5,.04\n1.5,.06\n", "turns with a radius of 0.0"),
    ],
)
def test_bad_content(tmp_path: FilePath, text: str, words: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text, encoding="utf-8")
    assert words in refused(file)


@pytest.mark.parametrize("surplus", [2, 3, 5])
def test_a_lap_that_runs_past_its_start_is_cut_there(tmp_path: FilePath, surplus: int) -> None:
    # A second lap's beginning, half a metre further out.
    extra = [(x * 1.005, y * 1.005 + 0.3) for x, y in ellipse()[:surplus]]
    file = write_csv(tmp_path / "lap.csv", ellipse() + extra)
    whole = CsvPath(file=write_csv(tmp_path / "whole.csv", ellipse()))
    path = CsvPath(file=file)
    assert path.closed
    assert path.length == pytest.approx(whole.length, rel=0.005)
    assert "it passes its start again after line" in " ".join(path.notes())
    assert not CsvPath(file=file, loop=False).closed
    assert CsvPath(file=file, loop=False).length > 1.01 * whole.length


def test_repeated_points_and_standing_are_left_out(tmp_path: FilePath) -> None:
    stood = [*LINE[:3], *([(20.0, 0.001)] * 4), *LINE[3:]]
    path = CsvPath(file=write_csv(tmp_path / "stood.csv", stood))
    assert np.array_equal(
        path.table.pieces, CsvPath(file=write_csv(tmp_path / "line.csv", LINE)).table.pieces
    )
    assert path.notes() == ("4 points within 0.05 m of the last one left out, from line 5",)
    thin = CsvPath(file=path.file, spacing=15.0)
    assert thin.length == pytest.approx(40.0)


def test_a_last_point_near_the_first_is_it(tmp_path: FilePath) -> None:
    whole = CsvPath(file=write_csv(tmp_path / "whole.csv", ellipse()))
    for gap in (0.0005, 0.01):
        ring = [*ellipse(), (80.0 + gap / 2, -gap)]
        path = CsvPath(file=write_csv(tmp_path / "ring.csv", ring))
        assert np.array_equal(path.table.pieces, whole.table.pieces)


def test_rows_without_a_position_are_left_out(tmp_path: FilePath) -> None:
    file = tmp_path / "gaps.csv"
    file.write_text("t,x,y\n0,0,0\n1,,\n2,10,0\n3,nan,nan\n4,20,1\n5,30,3\n", encoding="utf-8")
    path = CsvPath(file=file)
    assert path.length == pytest.approx(30.2, abs=0.1)
    (told,) = path.notes()
    assert told.startswith("2 rows without a position are left out; the longest gap, 10 m ")


def test_columns_that_the_user_names(tmp_path: FilePath) -> None:
    file = tmp_path / "own.csv"
    rows = [f"{t};{-y};{x / 1000!r};9" for t, (x, y) in enumerate(ellipse())]
    file.write_text("\n".join(["t;down;E [km];speed", *rows]), encoding="utf-8")
    plain = CsvPath(file=write_csv(tmp_path / "plain.csv", ellipse()))
    given: list[Any] = ["x=E,y=-down", "x=3,y=-2", "x_m=E*1e3,y=-down", {"x": "E", "y": "-down"}]
    for columns in given:
        path = CsvPath(file=file, columns=columns)
        assert path.table.pieces == pytest.approx(plain.table.pieces, abs=1e-9)
        speeds = path.speeds()
        assert speeds is not None
        assert speeds[1].tolist() == [9.0] * 60
    with pytest.raises(ConfigError, match=r"no column is called 'xx' here; did you mean 'x'"):
        build(CsvPath, {"file": str(file), "columns": "xx=E"})
    with pytest.raises(ConfigError, match=r"'E' is not NAME=TITLE; write e.g. x=TITLE,y=TITLE"):
        build(CsvPath, {"file": str(file), "columns": "E"})
    assert "no column 'Q' for x" in refused(file, columns="x=Q,y=down")


def test_the_noise_is_found(tmp_path: FilePath) -> None:
    rng = np.random.default_rng(2)
    for noise in (0.02, 0.1):
        noisy = [(x + rng.normal(0.0, noise), y + rng.normal(0.0, noise)) for x, y in ellipse(400)]
        path = CsvPath(file=write_csv(tmp_path / "noisy.csv", noisy), smoothing="auto")
        told = float(path.notes()[-1].split()[1])
        assert told == pytest.approx(noise, rel=0.2)  # what lies across the path
        sharpest = float(np.max(np.abs(path.table.pieces[:, kernel.KAPPA0])))
        assert sharpest == pytest.approx(0.032, abs=0.008)


def test_what_bends_more_than_the_car_can_turn_is_named(tmp_path: FilePath) -> None:
    rounded = [(0.1 * i, round(0.01 * round(0.02 * (0.1 * i) ** 2 * 100), 2)) for i in range(200)]
    path = CsvPath(file=write_csv(tmp_path / "rounded.csv", rounded))
    text = too_sharp(path, CarlaModel3().turning_radius)
    assert text is not None
    radius = r"it bends with a radius of 0\.\d+ m at s = \d+\.\d m \(line \d+\), in \d+ places"
    car = r" in all; the car turns no tighter than 2\.7 m; path\.smoothing=auto smooths it"
    assert re.match(radius + car, text)
    smooth = path.model_copy(update={"smoothing": "auto"})
    assert too_sharp(smooth, CarlaModel3().turning_radius) is None
    tight = too_sharp(Circle(radius=2.0), CarlaModel3().turning_radius)
    assert tight is not None
    assert "radius of 2 m at s = 0.0 m; the car" in tight


def test_ends_that_cross(tmp_path: FilePath) -> None:
    # The end comes from the right, crosses the first stretch and stops to its left.
    lap = [(0.0, 0.0), *ellipse()[46:], *ellipse()[:44]]
    lap[0] = (lap[1][0] - 9.0, lap[1][1])
    crossing = [*lap, (lap[0][0] + 3.0, lap[0][1] - 4.0), (lap[0][0] + 5.0, lap[0][1] + 2.0)]
    assert "overlaps or crosses the start" in refused(
        write_csv(tmp_path / "cross.csv", crossing), loop=True
    )


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("spacing", [0.5, 2.0])
def test_what_a_message_says_to_set_cures_it(
    tmp_path: FilePath, closed: bool, spacing: float
) -> None:
    """A recording that stands with noise, then drives a lap or part of one."""
    rng = np.random.default_rng(1)
    angle = np.arange(0.0, 2.0 * np.pi if closed else 4.0, spacing / 60.0)
    angle = np.concatenate((np.zeros(60), angle))
    place = 60.0 * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    noisy = place + rng.normal(0.0, 0.03, place.shape)
    file = write_csv(tmp_path / "stood.csv", [(x, y) for x, y in noisy.tolist()])
    text = refused(file)
    assert "set smoothing to auto, which takes it for 0.0" in text
    assert CsvPath(file=file, smoothing="auto").closed == closed
    assert "set loop to false" not in text  # as it stands, the points turn back


def test_smoothing_needs_points(tmp_path: FilePath) -> None:
    file = write_csv(tmp_path / "short.csv", LINE[:3])
    assert "at least 5 points" in refused(file, smoothing=0.1)


@pytest.mark.parametrize("title", ["Laenge [deg]", "Länge [°]", "LAENGE_deg"])
def test_german_latitudes_are_those_in_degrees(title: str, tmp_path: FilePath) -> None:
    file = tmp_path / "fahrt.csv"
    rows = "".join(f"48,13;11,57{k}\n" for k in range(5))
    file.write_text(f"Breite [deg];{title}\n{rows}", encoding="utf-8")
    assert CsvPath(file=file).length == pytest.approx(
        4e-3 * 111_320 * np.cos(np.deg2rad(48.13)), 3e-3
    )
    file.write_text("Nord [m];Ost [m]\n0;0\n0;9\n0;18\n", encoding="utf-8")
    assert CsvPath(file=file).at(18.0).x == pytest.approx(18.0)
    file.write_text("x;y;Breite [m];Laenge [m]\n0;0;3;1\n9;0;3;1\n18;0;3;1\n", encoding="utf-8")
    assert CsvPath(file=file).length == pytest.approx(18.0)
