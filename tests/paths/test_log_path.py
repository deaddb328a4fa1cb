"""A recording's driven line as a path, at the recorded speed."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest

import steersman as sm
from steersman.errors import SteersmanError
from steersman.paths.log_path import LogPath

RADIUS = 40.0
HEAD = "t,px,py,v(km/h)"
COLUMNS = "time=t,x=px,y=-py,v_x_km_h=v(km/h)"


def circle(file: FilePath, turns: float = 1.6) -> FilePath:
    """Right-handed after ``y=-py``: a circle to the left, faster in its upper half."""
    time, angle, rows = 0.0, 0.0, []
    while angle < 2.0 * np.pi * turns:
        v = 10.0 + 2.0 * np.sin(angle)
        rows.append((time, RADIUS * np.sin(angle), -RADIUS * (1.0 - np.cos(angle)), 3.6 * v))
        time, angle = time + 0.04, angle + 0.04 * v / RADIUS
    np.savetxt(file, rows, delimiter=",", header=HEAD, comments="")
    return file


def test_a_lap_is_cut_and_keeps_its_speeds(tmp_path: FilePath) -> None:
    path = LogPath(file=circle(tmp_path / "log.csv"), columns=COLUMNS)
    assert path.closed
    assert path.length == pytest.approx(2.0 * np.pi * RADIUS, rel=1e-3)
    assert path.at(30.0).curvature == pytest.approx(1.0 / RADIUS, rel=0.02)
    at, speed = path.speeds()
    assert (np.diff(at) > 0.0).all()
    np.testing.assert_allclose(speed, 10.0 + 2.0 * np.sin(at / RADIUS), atol=0.05)


def test_a_window_is_a_part_and_speeds_follow_from_positions(tmp_path: FilePath) -> None:
    file = circle(tmp_path / "log.csv")
    path = LogPath(file=file, columns="time=t,x=px,y=-py", window=(2.0, 8.0))
    assert not path.closed
    at, speed = path.speeds()
    assert path.length == pytest.approx(at[-1])
    whole = LogPath(file=file, columns=COLUMNS, window=(2.0, 8.0)).speeds()[1]
    np.testing.assert_allclose(speed, whole, atol=0.1)


def test_it_is_driven_at_the_recorded_speed(tmp_path: FilePath) -> None:
    path = {"kind": "log", "file": str(circle(tmp_path / "log.csv")), "columns": COLUMNS}
    config = sm.RunConfig(controller="stanley", path=path, speed="path", duration=15.0)
    episode = sm.attempt(config).of_controller()
    _, speed = LogPath(file=path["file"], columns=COLUMNS).speeds()
    assert np.abs(episode["lateral_error"]).max() < 0.5
    assert 0.9 * speed.min() < episode["v_x"].min() < episode["v_x"].max() < 1.1 * speed.max()


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"columns": "time=t,x=px"}, "no column y_m"),
        ({"columns": "time=t,x=px,y=pz"}, "no column 'pz' for y"),
        ({"columns": "time"}, "columns: 'time' is not NAME=TITLE"),
        ({"window": (100.0, 200.0)}, "no position in window; the last is at"),
        ({"window": (3.0, 2.0)}, "from must be before to [s]"),
    ],
)
def test_what_cannot_be_a_path(fields: dict[str, object], said: str, tmp_path: FilePath) -> None:
    with pytest.raises((SteersmanError, ValueError)) as error:
        _ = LogPath(file=circle(tmp_path / "log.csv"), **({"columns": COLUMNS} | fields)).table
    assert said in str(error.value)
