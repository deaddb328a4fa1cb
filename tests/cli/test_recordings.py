"""``drive --mcap``, ``export --to mcap`` and ``path=mcap`` as a user meets them."""

from __future__ import annotations

import csv
import shutil
import sys
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np
import pytest
from typer.testing import Result

from steersman.episode import COLUMNS, load_episode
from steersman.logs.restore import read_episode

Steersman = Callable[..., Result]
SHORT = ("drive", "path=double_lane_change", "speed=constant_speed", "speed.speed=10")


def test_a_drive_recorded_exported_and_followed(steersman: Steersman, tmp_path: FilePath) -> None:
    done = steersman(*SHORT, "--out", "runs/first", "--mcap", "new/first.mcap")
    assert done.exit_code == 0
    exported = steersman("export", "runs/first", "--to", "mcap", "--out", "o")
    assert exported.stdout == "o/first.mcap\n"
    assert exported.exit_code == 0
    assert (tmp_path / "o/first.mcap").read_bytes() == (tmp_path / "new/first.mcap").read_bytes()
    kept = load_episode(tmp_path / "runs" / "first" / "episode.npz")
    for suffix in ("csv", "mat"):
        exported = steersman("export", "runs/first", "--to", suffix, "--out", "o")
        assert exported.stdout == f"o/first.{suffix}\n"
    with (tmp_path / "o" / "first.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["curvature"]) for row in rows] == kept["curvature"].tolist()
    again = read_episode(tmp_path / "o" / "first.mcap")
    assert again.meta == kept.meta
    for name in COLUMNS:
        assert np.allclose(again[name], kept[name], rtol=0.0, atol=1e-9), name
    followed = steersman("drive", "path=mcap", "path.file=o/first.mcap", "duration=2", "--json")
    assert followed.exit_code == 0
    assert '"end": "duration"' in followed.stdout


def test_a_drive_that_fails_is_recorded_too(steersman: Steersman, tmp_path: FilePath) -> None:
    done = steersman("drive", "corridor=0.001", "--mcap", "lost.mcap")
    assert done.exit_code == 0
    assert read_episode(tmp_path / "lost.mcap").end == "off_track"


def test_a_path_that_is_gone_is_written_as_driven(steersman: Steersman, tmp_path: FilePath) -> None:
    (tmp_path / "road.csv").write_text("x,y\n0,0\n10,0\n20,0.5\n30,1\n")
    assert steersman("drive", "path=csv", "path.file=road.csv", "--out", "r").exit_code == 0
    (tmp_path / "road.csv").unlink()
    shutil.copy(tmp_path / "r" / "episode.npz", tmp_path / "one.npz")
    result = steersman("export", "one.npz", "--to", "mcap")
    assert "road.csv: cannot be read" in result.stderr
    assert "; the path is written as far as it was driven" in result.stderr
    assert result.stdout == "one_mcap/one.mcap\n"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("export folder --to mcap --out o", "folder: no episode.npz in this folder; name a folder"),
        ("export no.npz --to mcap --out o", "no.npz: cannot be read (No such file or directory)"),
        ("export one.csv --to mcap --out o", "one.csv: not an episode of Steersman"),
        ("drive --mcap folder", "--mcap: expected the name of a file, given 'folder'"),
        ("drive --mcap x.bag", "--mcap: 'x.bag' is not allowed; a name that ends in .mcap"),
        ("drive --mcap empty/x.mcap", "empty: is a file, expected a folder"),
        ("drive path=mcap", "path.file: required, but not given: recording"),
        ("drive path=mcap path.file=no.mcap", "no.mcap: cannot be read (No such file"),
        ("drive path=mcap path.file=one.csv", "one.csv: is no recording; expected an .mcap or"),
        ("drive path=mcap path.file=folder", "folder: is a folder without metadata.yaml"),
        ("drive path=mcap path.file=x.mcap", "x.mcap: cannot be read as a ROS 2 recording, it"),
        ("drive path=mcap path.file=x.mcap path.window=[2,1]", "path.window: [2.0, 1.0] is not"),
        ("drive path=mcap path.file=x.mcap path.spacing=0", "path.spacing: 0 is not allowed"),
    ],
)
@pytest.mark.usefixtures("wrong_files")
def test_wrong_words(steersman: Steersman, tmp_path: FilePath, words: str, expected: str) -> None:
    (tmp_path / "x.mcap").write_bytes(b"no recording")
    result = steersman(*words.split())
    assert result.exit_code == 2
    assert expected in result.stderr
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1


def test_without_the_extra(steersman: Steersman, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mcap.writer")  # else the fault names the submodule
    monkeypatch.setitem(sys.modules, "mcap", None)
    result = steersman("drive", "--mcap", "x.mcap")
    assert result.stderr == (
        "error: mcap: not installed; this needs the extra 'logs': "
        "pip install -c constraints.txt -e '.[logs]' in a source checkout, else "
        "pip install 'steersman[logs]'\n"
    )
    assert result.exit_code == 2
