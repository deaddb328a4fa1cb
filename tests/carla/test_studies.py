"""One word more, ``plant=carla``, and imitations, falsifications and tunings are the server's."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from steersman.cli import app
from steersman.config import build, read_yaml
from steersman.plants.carla import CarlaConfig
from steersman.studies.tune import TuneConfig

from ..standin.serving import Serving
from .conftest import left_behind


def steersman(*words: str) -> Result:
    return CliRunner().invoke(app, list(words), prog_name="steersman", catch_exceptions=False)


@pytest.fixture
def words(server: Serving) -> tuple[str, ...]:
    return ("plant=carla", f"plant.port={server.port}", "plant.warm_up=0.1", "plant.run_up=0.2")


def test_an_imitation(
    carla: CarlaConfig, words: tuple[str, ...], raw: Any, tmp_path: FilePath
) -> None:
    out = tmp_path / "out"
    size = ("steps=400", "rounds=2", "fit.updates=60", "problem.episode_time=3")
    roads = ("problem.roads=[circle]", "validation.vehicles=1")
    result = steersman("imitate", "demo", *words, *size, *roads, "--out", str(out))
    assert result.exit_code == 0, result.output
    assert "plant=carla drives one car: vehicles=1" in result.stderr
    assert "validation.vehicles" not in result.stderr.split("drives one car: ")[1].split("\n")[0]
    assert read_yaml(out / "config.yaml")["problem"]["plant"]["kind"] == "carla"
    assert left_behind(raw) == (False, 0)
    duration = ("duration=1", "controller=policy", f"controller.file={out / 'policy.onnx'}")
    assert steersman("drive", *words, *duration).exit_code == 0


def test_an_imitation_by_many_cars_is_refused(tmp_path: FilePath) -> None:
    result = steersman("imitate", "demo", "plant=carla", "vehicles=4", "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "vehicles: 4 is not allowed; plant=carla drives one vehicle: 1" in result.stderr


def test_a_falsification(words: tuple[str, ...], raw: Any, tmp_path: FilePath) -> None:
    """Delays are whole ticks there; the car is the one there is."""
    budget = ("duration=3", "trials=2", "checks=1", "bisections=2", "ranges.speed=0")
    command = ("falsify", *words, *budget, "controller=mpc_pid", "--out", str(tmp_path))
    result = steersman(*command, "--json")
    assert result.exit_code == 0, result.output
    assert "plant=carla drives one car: ranges.mass=0 ranges.friction=0" in result.stderr
    found = json.loads(result.stdout)
    delay = next(one for one in found["singles"] if one["name"] == "delay")
    for value in (delay["failing_value"], delay["holding_value"]):
        assert value is None or round(value / 0.05, 9).is_integer()
    assert left_behind(raw) == (False, 0)


def test_a_disturbed_car_is_refused(tmp_path: FilePath) -> None:
    result = steersman("falsify", "plant=carla", "ranges.mass=0.2", "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "ranges.mass: 0.2 is not allowed; plant=carla has the one car" in result.stderr


def test_a_tuning(words: tuple[str, ...], raw: Any, tmp_path: FilePath) -> None:
    """On what of a suite the server's car can do."""
    command = ("tune", *words, "controller=pid", "suite=quick", "--trials", "2")
    result = steersman(*command, "--out", str(tmp_path))
    assert result.exit_code == 0, result.output
    runs = read_yaml(tmp_path / "config.yaml")["suite"]
    assert {run["plant"]["kind"] for run in runs} == {"carla"}
    # Of five disturbances on two courses: clean, delayed, with noise.
    assert len(runs) == 6
    assert left_behind(raw) == (False, 0)


def test_a_tunings_own_runs_take_its_plant() -> None:
    config = build(TuneConfig, {"plant": "carla", "suite": [{"plant": "simulator"}, {"laps": 2}]})
    assert [run.plant.kind for run in config.suite] == ["simulator", "carla"]
