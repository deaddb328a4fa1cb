"""``steersman identify``: from a file to a file, and what it refuses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path as FilePath

import pytest
from typer.testing import Result

from steersman.studies.identify.recording import write_log
from steersman.vehicles import CarlaModel3

from ..scripts import script

recording = script("benchmarks/hand_driven.py").recording

Steersman = Callable[..., Result]


@pytest.fixture
def log(tmp_path: FilePath) -> str:
    found = recording(CarlaModel3(), 20.0, acceleration=0.0, throttles=(0.5,))
    write_log(found, tmp_path / "log.csv")
    return "log.csv"


def test_a_file_becomes_a_file(steersman: Steersman, log: str, tmp_path: FilePath) -> None:
    result = steersman(
        "identify", log, "--holdout", "0", "--out", "new/car.yaml", "--report", "fit.html"
    )
    assert result.exit_code == 0, result.output
    assert "15 s" not in result.stdout
    assert "c_f" in result.stdout  # among what is kept
    assert "written to new/car.yaml" in result.stdout
    page = (tmp_path / "fit.html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 4
    driven = steersman("drive", "vehicle=file", "vehicle.file=new/car.yaml", "duration=1", "--json")
    assert driven.exit_code == 0, driven.output
    again = steersman("identify", log, "--holdout", "0", "--vehicle", "new/car.yaml", "--json")
    found = json.loads(again.stdout)
    assert {f["name"] for f in found["figures"]} >= {"steer_delay", "c_f", "map_acceleration[0][0]"}
    assert all(f["status"] == "kept" for f in found["figures"] if f["name"] in {"c_f", "c_r"})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("no.csv", "no.csv: cannot be read (No such file"),
        (". --vehicle carla_model3", "episode.npz: cannot be read"),
        ("log.csv --vehicle modl3", "unknown vehicle 'modl3'; did you mean 'carla_model3'?"),
        (
            "log.csv --out car.txt",
            "--out: 'car.txt' is not allowed; a name that ends in .yaml or .yml is",
        ),
        ("log.csv --report fit.pdf", "--report: 'fit.pdf' is not allowed"),
        ("log.csv --lock 0", "--lock: 0 is not allowed; must be greater than 0 [rad]"),
        ("log.csv --holdout 0.02", "too short to hold 0.02 of them out"),
        ("log.csv --hold 0.2", "no such option"),
    ],
)
def test_what_is_wrong_is_one_line(steersman: Steersman, log: str, words: str, said: str) -> None:
    result = steersman("identify", *words.split())
    assert result.exit_code == 2
    assert said in result.stderr
    assert result.stderr.count("error:") == 1
    assert "Traceback" not in result.stderr
