"""``steersman carla doctor | calibrate | map`` and bench on the server, from the shell."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from steersman.bench.suites import suite
from steersman.cli import app
from steersman.config import build, lookup
from steersman.errors import PlantError
from steersman.paths.analytic import Circle
from steersman.plants.carla import CarlaConfig
from steersman.plants.simulator import SimulatorConfig
from steersman.rollout import run
from steersman.studies.calibrate import calibrate as module
from steersman.studies.calibrate.calibrate import Fit, calibrate
from steersman.types import Command, Pose
from steersman.vehicles import Bmw320i, CarlaModel3, CarlaModel3V1, Vehicle

from ..standin.serving import Serving
from .conftest import left_behind, running


def steersman(*words: str) -> Result:
    return CliRunner().invoke(app, list(words), prog_name="steersman", catch_exceptions=False)


@pytest.fixture
def plant(server: Serving) -> tuple[str, ...]:
    return (f"plant.port={server.port}", "plant.warm_up=0.1", "plant.run_up=0.5")


# ---------------------------------------------------------------------------------- doctor


def test_a_healthy_server(plant: tuple[str, ...], raw: Any) -> None:
    result = steersman("carla", "doctor", *plant)
    assert result.exit_code == 0, result.output
    names = [line.split()[1].rstrip(":") for line in result.stdout.splitlines()]
    assert names[:3] == ["connection", "settings", "vehicles"]
    assert {"take-off", "velocity", "repeatability", "speed"} <= set(names)
    assert "stand-in for CARLA 0.9.16" in result.stdout
    assert "CARLA 0.9.16-" not in result.stdout
    assert left_behind(raw) == (False, 0)


def test_no_server_is_a_fault_with_a_cure() -> None:
    result = steersman("carla", "doctor", "plant.port=1", "plant.attempts=1", "--json")
    assert result.exit_code == 2
    (finding,) = json.loads(result.stdout)
    assert finding["name"] == "connection"
    assert not finding["healthy"]
    assert "start it" in finding["text"]


def test_left_over_vehicles_are_told_and_cleaned(
    plant: tuple[str, ...], raw: Any, lib: Any
) -> None:
    world = raw.get_world()
    other = world.get_blueprint_library().find("vehicle.lincoln.mkz_2020")
    number = world.spawn_actor(other, lib.Transform(lib.Location(40.0, 1.75, 0.1))).id
    result = steersman("carla", "doctor", *plant)
    assert result.exit_code == 2
    assert f"1 on the map that are not ours: {number} vehicle.lincoln.mkz_2020" in result.stdout
    assert "cure: stop the client they belong to" in result.stdout
    assert "repeatability" not in result.stdout  # the world is not taken from under them
    result = steersman("carla", "doctor", "--clean", *plant)
    assert result.exit_code == 0, result.output
    assert "1 destroyed" in result.stdout
    assert left_behind(raw) == (False, 0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("doctor", "plan.port=1"), "unknown setting; did you mean 'plant'?"),
        (("doctor", "town"), "'town' is not a setting; write plant.port=2000"),
        (("doctor", "plant=simulator"), "plant: simulator is not allowed"),
        (("doctor", "plant.prot=1"), "did you mean 'port'?"),
        (("calibrate", "--out", "car.txt"), "--out: 'car.txt' is not allowed"),
        (("map",), "missing option '--to'"),
    ],
)
def test_wrong_words(
    words: tuple[str, ...], message: str, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = steersman("carla", *words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


# ------------------------------------------------------------------------------- calibrate


class Believed:
    """A plant of which something else is known than what drives."""

    def __init__(self, true: Vehicle, believed: Vehicle) -> None:
        self.plant = SimulatorConfig().make(true)
        self.vehicle = believed

    def __getattr__(self, name: str) -> Any:
        return getattr(self.plant, name)


WRONG = {
    "c_f": 80e3,
    "c_r": 80e3,
    "yaw_inertia": 3000.0,
    "steer_rate_up": 1.2,
    "steer_rate_down": 1.2,
    "max_wheel_angle": 1.0,
    "brake_force": 4000.0,
}
# Recovered to this: a share, or m/s^2 for the map.
RECOVERED = {name: 1e-3 for name in WRONG} | {"brake_force": 3e-3}


@pytest.mark.parametrize(
    "true",
    [
        CarlaModel3(),
        CarlaModel3(c_f=120e3, c_r=95e3, yaw_inertia=2500.0),
        # With a strong engine, so that its runs pass every speed.
        Bmw320i(map_acceleration=CarlaModel3V1().map_acceleration),
    ],
    ids=["model3", "other tyres", "bmw"],
)
def test_calibration_recovers_known_parameters(true: Vehicle) -> None:
    rows = tuple(tuple(0.9 * a - 0.1 for a in row) for row in true.map_acceleration)
    curve = tuple(1.0 for _ in true.steer_curve_factor)
    believed = true.replace(**WRONG, map_acceleration=rows, steer_curve_factor=curve)
    told: list[str] = []
    found = calibrate(Believed(true, believed), told.append)
    for name, tolerance in RECOVERED.items():
        assert getattr(found.vehicle, name) == pytest.approx(getattr(true, name), rel=tolerance)
    assert found.vehicle.steer_curve_factor == pytest.approx(true.steer_curve_factor, abs=1e-6)
    # What a throttle asks of a car whose tyres cannot carry it, nobody sees.
    grips = true.friction > 2.0
    rows = found.vehicle.map_acceleration if grips else ()
    for row, wanted in zip(rows, true.map_acceleration, strict=grips):
        assert row == pytest.approx(wanted, abs=0.03)
    assert found.before == believed
    assert found.fits["tyres and inertia"].error < 1e-4  # rad/s
    assert found.fits["brakes"].error < 0.02  # m/s
    # What is not fitted stays what it was.
    assert found.vehicle.mass == believed.mass
    assert len(told) > 15


@pytest.mark.parametrize("offset", [0.02, -0.02])
def test_misaligned_steering_is_found(offset: float) -> None:
    """Known or not before."""
    true = CarlaModel3(steer_bias=offset)
    for believed in (CarlaModel3(), true):
        found = calibrate(Believed(true, believed), lambda _: None)
        assert found.vehicle.steer_bias == pytest.approx(offset, abs=1e-6)
        for name in ("max_wheel_angle", "c_f", "c_r", "yaw_inertia"):
            assert getattr(found.vehicle, name) == pytest.approx(getattr(true, name), rel=5e-3)
        assert found.fits["steering curve"].error < 1e-3


@pytest.mark.parametrize(("usual", "told"), [(0.1, False), (1e-6, True)])
def test_fits_that_leave_more_than_usual_are_told(
    usual: float, told: bool, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(module.USUAL, "throttle map", usual)
    result = steersman("carla", "calibrate", "plant=simulator", "--out", "car.yaml")
    assert result.exit_code == 0, result.output
    assert ("note: throttle map leaves" in result.stderr) == told


def test_a_fit_that_is_no_cars_is_one_line() -> None:
    fits = {"steering rate": Fit({"steer_rate_up": -1.0}, 0.0, "-")}
    with pytest.raises(
        PlantError, match=r"calibrate: steering rate: the fitted figures are not allowed: .*-1"
    ):
        module._explained(CarlaModel3(), fits, "steering rate")


def test_calibration_through_the_server_and_its_file(
    plant: tuple[str, ...], tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch, raw: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    wrong = ("vehicle.c_f=90000", "vehicle.c_r=60000", "vehicle.yaw_inertia=3300")
    result = steersman("carla", "calibrate", *plant, *wrong, "--out", "car.yaml")
    assert result.exit_code == 0, result.output
    assert "c_f" in result.stdout
    assert "# Calibrated on stand-in for CARLA 0.9.16" in (tmp_path / "car.yaml").read_text()
    found: Any = build(lookup("vehicle", "file"), {"file": "car.yaml"})
    for name in ("c_f", "c_r", "yaw_inertia", "steer_rate_up", "max_wheel_angle", "mass"):
        assert getattr(found, name) == pytest.approx(getattr(CarlaModel3(), name), rel=2e-3), name
    assert left_behind(raw) == (False, 0)
    # The embedded simulator drives it as the server did.
    car = SimulatorConfig().make(found)
    same = SimulatorConfig().make(CarlaModel3())
    for one in (car, same):
        one.enter(Circle())
        one.reset(Pose(0.0, 0.0, 0.0), 12.0, 0.02)
    steps = [(one.step(Command(0.06, 0.5, 0.0)), one) for _ in range(100) for one in (car, same)]
    assert steps[-1][0].yaw_rate == pytest.approx(steps[-2][0].yaw_rate, rel=1e-3)


# ----------------------------------------------------------------------------- bench, map


SHORT = """
courses:
  circle: {path: circle, duration: 2.0, speeds: {slow: {kind: constant_speed, speed: 8.0}}}
disturbances:
  clean: {}
  delay: {delay: 0.1}
  noise: {waypoint_noise: 0.1}
  heavy: {mass: 1.2}
  odd: {delay: 0.03}
"""


def test_bench_leaves_out_what_carla_cannot_do(
    plant: tuple[str, ...], tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch, raw: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.yaml").write_text(SHORT, encoding="utf-8")
    words = ("--controllers", "pid,mpc_pid", "--json")
    result = steersman("bench", "short.yaml", "plant=carla", *plant, *words, "--out", "b")
    assert result.exit_code == 0, result.output
    assert "plant=carla cannot do 2 scenarios, left out: heavy, odd" in result.stderr
    found = json.loads(result.stdout)
    assert found["left_out"] == {"heavy": 1, "odd": 1}
    assert found["plant"] == "stand-in for CARLA 0.9.16"
    assert found["summary"]["scenarios"] == 3
    embedded = json.loads(steersman("bench", "short.yaml", *words, "--out", "c").stdout)
    assert embedded["left_out"] == {}
    rows = {}
    for folder in ("b", "c"):
        lines = (tmp_path / folder / "rows.jsonl").read_text().splitlines()
        kept = [json.loads(line) for line in lines]
        rows[folder] = {(row["controller"], row["disturbance"]): row for row in kept}
    for key, row in rows["b"].items():
        alike = rows["c"][key]["charged_rms_m"]
        assert row["charged_rms_m"] == pytest.approx(alike, abs=1e-4), key
    assert left_behind(raw) == (False, 0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--jobs", "2"), "--jobs: 2 is not allowed; plant=carla has one car: 1"),
        (("--engine", "ray"), "--engine: ray is not allowed; plant=carla: local"),
        (("plant.prot=1",), "did you mean 'port'?"),
    ],
)
def test_bench_with_one_server(words: tuple[str, ...], message: str, tmp_path: FilePath) -> None:
    result = steersman("bench", "quick", "plant=carla", *words, "--out", str(tmp_path / "b"))
    assert result.exit_code == 2
    assert message in result.stderr


def test_scenarios_of_the_suites_on_carla() -> None:
    here, there = suite("quick"), suite("quick", ["plant=carla"])
    left_out, kept = there.left_out((0, 1)), there.scenarios((0, 1))
    assert left_out == {"soft": 4, "mixed": 4}
    assert len(kept) + 8 == len(here.scenarios((0, 1)))
    assert {one.disturbance for one in kept} == {"clean", "delay_100ms", "noise_0.1m"}
    assert here.left_out((0, 1)) == {}


def test_the_map_of_a_server(
    plant: tuple[str, ...], tmp_path: FilePath, carla: CarlaConfig
) -> None:
    run(running(plant=carla, path={"kind": "circle", "radius": 33.0}, duration=0.1))
    file = tmp_path / "map.xodr"
    result = steersman("carla", "map", *plant, "--to", str(file))
    assert result.exit_code == 0, result.output
    assert "OpenDriveMap" in result.stderr
    assert 'curvature="0.0303030' in file.read_text(encoding="utf-8")
