"""FMUs: valid, as exact as Python's drive, and refusing what they cannot do."""

from __future__ import annotations

import math
import zipfile
from functools import cache
from pathlib import Path as FilePath
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from steersman.cli import app
from steersman.cli.exported import ToExport, model_of
from steersman.commands import configuration
from steersman.controllers.policy import Policy
from steersman.controllers.stanley import Stanley
from steersman.delivery import compiled
from steersman.delivery.controller import Setting
from steersman.delivery.fmu import archive
from steersman.delivery.fmu.description import base_units
from steersman.delivery.fmu.model import FmuModel
from steersman.delivery.plant import FIGURES
from steersman.delivery.vector_text import answers, rows_of
from steersman.kernels import vehicle as car
from steersman.rollout import run
from steersman.types import Observation
from steersman.vehicles import CarlaModel3

from ..docs.pages import blocks
from ..scripts import ROOT, script
from .building import STRICT, needs_compiler

pytestmark = needs_compiler
example = script("examples/co_simulation.py")
DRIVE = (
    *("path=figure_eight", "plant.steering_delay=0.07"),
    *("sensor.latency=0.05", "start.s=20"),
)


@pytest.fixture(autouse=True)
def quickly_and_strictly(monkeypatch: pytest.MonkeyPatch) -> None:
    flags = (*STRICT, "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-O0")
    monkeypatch.setattr(archive, "FLAGS", flags)


@cache
def model(*words: str, precision: str = "double") -> FmuModel:
    """What becomes an FMU; making C of a car takes a second."""
    return model_of(ToExport(words[0], words[1:], precision))


def export(folder: FilePath, *words: str, fmi: int = 2, precision: str = "double") -> str:
    """The file that was written."""
    said: list[str] = []
    folder.mkdir(exist_ok=True)
    (file,) = archive.write_fmu(model(*words, precision=precision), fmi, folder, said.append)
    assert "binary for" in said[0], said
    return str(file)


class Unit:
    """An FMU whose values go by their names."""

    def __init__(self, file: str, folder: FilePath) -> None:
        self.about = fmpy.read_model_description(file)
        self.unit = instantiate_fmu(fmpy.extract(file, str(folder)), self.about, "CoSimulation")
        if self.about.fmiVersion == "2.0":
            self.unit.setupExperiment(startTime=0.0)
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()
        self.variables = {each.name: each for each in self.about.modelVariables}

    def get(self, *names: str) -> list[float]:
        return [self._call("get", name) for name in names]

    def put(self, **values: float) -> None:
        for name, value in values.items():
            self._call("set", name, value)

    def _call(self, what: str, name: str, *value: Any) -> Any:
        one = self.variables[name]
        answer = getattr(self.unit, what + one.type)(
            [one.valueReference], *map(lambda x: [x], value)
        )
        return answer[0] if answer else None

    def answer(self, seen: Observation, time: float, step: float = 0.05) -> tuple[float, float]:
        """Steering and status of a controller."""
        self.put(**{k: v for k, v in seen._asdict().items() if k in self.variables})
        for i, point in enumerate(seen.preview.tolist()):
            for axis, value in zip("xy", point, strict=True):
                self._call("set", f"preview[{i}].{axis}", value)
        self.unit.doStep(time, step)
        steer, status = self.get("steer_command", "status")
        return steer, status


@pytest.mark.parametrize(("fmi", "speed"), [(2, "constant_throttle"), (3, "constant_speed")])
def test_two_units_drive_as_python_does(fmi: int, speed: str, tmp_path: FilePath) -> None:
    plant = export(tmp_path, "carla_model3", *DRIVE, f"speed={speed}", fmi=fmi)
    controller = export(tmp_path, "tuned/stanley", fmi=fmi)
    for file in (controller, plant):
        assert validate_fmu(file) == []
    words = [*DRIVE, f"speed={speed}", "controller=tuned/stanley", "duration=8"]
    episode = run(configuration("drive", words))
    rows = np.array(example.drive(controller, plant, 8.0))
    assert abs(rows[:, 0] - episode["time"]).max() < 1e-9
    # What the first controller sees is late; what was recorded is the truth.
    assert abs(rows[1:, 1] - episode["lateral_error"][:-1]).max() < 1e-9
    assert abs(rows[:, 2] - episode["steer_command"]).max() < 1e-9
    assert np.ptp(rows[:, 2]) > 0.05


@pytest.mark.parametrize(
    ("precision", "most"), [("double", 1e-12), ("single", 1e-6), ("mixed", 1e-7)]
)
def test_a_controller_answers_by_its_parameters_and_period(
    precision: str, most: float, tmp_path: FilePath
) -> None:
    file = export(tmp_path, "tuned/stanley", precision=precision)
    config = configuration("drive", ["controller=tuned/stanley"])
    setting = Setting("stanley", config.controller, config.vehicle, 0.05, 15, 2.0)
    rows = [row for row in rows_of(setting)[:40] if not row.restart and row.executed is None]
    unit = Unit(file, tmp_path / "unit")
    expected = answers(setting, rows)
    for i, (row, decision) in enumerate(zip(rows, expected, strict=True)):
        steer, status = unit.answer(row.seen, i * 0.05)
        assert abs(steer - decision.steer) < most
        assert status == decision.status
    now = len(rows) * 0.05
    before, seen = unit.unit.getFMUstate(), rows[20].seen
    first = unit.answer(seen, now)[0]
    unit.unit.setFMUstate(before)
    assert unit.answer(seen, now)[0] == first
    assert isinstance(setting.controller, Stanley)
    stronger = 2.0 * setting.controller.gain
    other = setting.controller.model_copy(update={"gain": stronger})
    changed = answers(setting._replace(controller=other), [*rows, rows[20]])[-1]
    unit.unit.setFMUstate(before)
    for wrong in (-5.0, math.nan):
        with pytest.raises(FMICallException):
            unit.put(gain=wrong)
    unit.put(gain=stronger)
    assert abs(unit.answer(seen, now)[0] - changed.steer) < most
    assert abs(changed.steer - first) > 1e-6
    # Steps that are shorter than the period: an answer at the beginning of each period.
    found = [unit.answer(rows[k].seen, now + 0.05 + 0.01 * k, 0.01)[0] for k in range(11)]
    assert [len(set(found[k : k + 5])) for k in (0, 5)] == [1, 1]
    assert len(set(found)) == 3
    unit.unit.freeFMUstate(before)


def test_the_car_has_figures_and_one_period(tmp_path: FilePath) -> None:
    unit = Unit(
        export(tmp_path, "carla_model3", *DRIVE, "speed=constant_throttle"), tmp_path / "unit"
    )
    figures = {k: v for k, v in CarlaModel3().model_dump().items() if isinstance(v, float)}
    same = figures.keys() & {name for name, _ in FIGURES}
    assert len(FIGURES) == car.N_PARAMS
    assert len(same) > 20
    assert unit.get(*same) == [figures[name] for name in same]
    mass = unit.variables["mass"]
    assert (mass.unit, mass.variability, float(mass.start)) == ("kg", "tunable", figures["mass"])
    assert {"throttle", "brake"} <= {n for n, v in unit.variables.items() if v.causality == "input"}
    unit.put(throttle=1.0)
    unit.unit.doStep(0.0, 0.1)  # two periods
    with pytest.raises(FMICallException):
        unit.unit.doStep(0.1, 0.03)
    quick = unit.get("car.v_x")[0]
    unit.unit.reset()
    for wrong in (-5.0, 0.0, math.nan):
        with pytest.raises(FMICallException):
            unit.put(mass=wrong)
    unit.put(mass=4000.0, throttle=1.0)
    unit.unit.setupExperiment(startTime=0.0)
    unit.unit.enterInitializationMode()
    unit.unit.exitInitializationMode()
    unit.unit.doStep(0.0, 0.1)
    assert unit.get("car.v_x")[0] < quick


def test_a_policy_answers_as_in_python(tmp_path: FilePath) -> None:
    unit = Unit(export(tmp_path, "precision", fmi=3), tmp_path / "unit")
    policy = Policy(file="precision")
    state = policy.init(CarlaModel3(), 0.05)
    setting = Setting("policy", policy, CarlaModel3(), 0.05, 15, 2.0)
    for i, row in enumerate(rows_of(setting)[:30]):
        decision, state = policy.step(state, row.seen)
        assert abs(unit.answer(row.seen, i * 0.05)[0] - decision.steer) < 2e-6
    state = policy.executed(state, 0.3)
    decision, _ = policy.step(state, row.seen)
    unit.put(overruled=1, executed=0.3)
    assert abs(unit.answer(row.seen, 1.5)[0] - decision.steer) < 2e-6


def test_without_a_compiler_there_are_sources_alone(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiled, "COMPILERS", ("no_such_compiler",))
    run = "estimated/tuned/pure_pursuit"  # of which the table has parts by their numbers
    words = ["export", run, "--to", "fmu", "--fmi", "3", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, words)
    assert "no binary in the FMU: there is no C compiler here" in result.stderr
    assert validate_fmu(result.stdout.strip()) == []
    with zipfile.ZipFile(result.stdout.strip()) as made:
        names = made.namelist()
    assert "sources/buildDescription.xml" in names
    assert not any(name.startswith("binaries") for name in names)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("carla_model3 sensor.error_range=0.1", "sensor: random errors and disturbances have no C"),
        ("carla_model3 plant=multibody", "only the embedded simulator leaves"),
        ("carla_model3 --precision single", "settings, name and parameters are for controllers"),
        ("tuned/lqr --fmi 4", "--fmi: 4 is not allowed; expected 2 or 3"),
    ],
)
def test_what_cannot_be_a_unit(words: str, why: str, tmp_path: FilePath) -> None:
    folder = ["--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["export", *words.split(), "--to", "fmu", *folder])
    assert result.exit_code == 2
    assert why in result.stderr


def test_the_page_shows_the_example() -> None:
    shown = [b.body for b in blocks(ROOT / "docs" / "fmu.md") if b.language == "python"]
    assert shown == [(ROOT / "examples" / "co_simulation.py").read_text().rstrip()]


def test_units() -> None:
    assert base_units("m/s^2") == {"m": 1, "s": -2}
    assert base_units("1/m") == {"m": -1}
    assert base_units("-") == {}
    assert base_units("furlong") is None
