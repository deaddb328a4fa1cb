"""A user's car: what its file leaves to another, and controllers that were made for another."""

from __future__ import annotations

import html
import json
import math
from pathlib import Path as FilePath

import pytest

import steersman as sm
from steersman import tuned
from steersman.api.cars import Made, about_cars, implausible, tuned_on
from steersman.api.driving import announce_drive
from steersman.bench.entrants import entrants
from steersman.config import build, dump, resolve
from steersman.errors import ConfigError
from steersman.kernels.vehicle import GRAVITY
from steersman.registry import components
from steersman.vehicles import CarlaModel3V1, Vehicle, VehicleFile
from steersman.words import _AROUND

MINE = "base: carla_model3\nmass: 2100\nc_f: 120000\n"


@pytest.fixture
def mine(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> FilePath:
    """A car's file, in the current folder."""
    monkeypatch.chdir(tmp_path)
    file = FilePath("mine.yaml")
    file.write_text(MINE, encoding="utf-8")
    return file


def told(*words: str) -> list[str]:
    """The lines about what is driven."""
    lines: list[str] = []
    announce_drive(sm.configure("drive", *words), words, lines.append)
    return lines


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("vehicle.c_f=155", "vehicle.c_r=99"), "vehicle: c_f / (mass g) is"),
        (("speed.speed=50",), "m/s in a bend of 50 m ask for"),
        (("path.radius=2",), "path: "),
    ],
)
def test_python_is_told_as_the_shell_is(words: tuple[str, ...], expected: str) -> None:
    words = ("lqr", "path=circle", "speed=constant_speed", *words)
    episode = sm.drive(*words, duration=1)
    assert any(expected in note for note in episode.notes)
    before = [each for each in episode.notes if not each.startswith(("speed:", "controller:"))]
    assert before == told(*words)
    for text in (str(episode), repr(episode)):
        assert text == "\n  note: ".join([episode.line(), *episode.notes])
    assert html.escape(episode.notes[0], quote=False) in html.unescape(episode._repr_html_())


def test_a_drive_of_fallbacks_says_so(tmp_path: FilePath) -> None:
    class NotANumber(sm.Controller):
        def init(self, vehicle: Vehicle, dt: float) -> None:
            """Nothing."""

        def decide(self, state: None, observation: sm.Observation) -> tuple[float, sm.Status, None]:
            return math.nan, sm.Status.SOLVED, state

    episode = sm.drive(NotANumber(), path="circle", duration=0.5, out=tmp_path)
    assert episode.notes[0].startswith("controller: 10 of 10 steps were fallbacks")
    assert sm.load(tmp_path).notes == episode.notes
    assert sm.drive("lqr", path="circle", duration=0.5).notes == ()


def test_what_a_car_leaves_to_its_base_is_listed_once(mine: FilePath) -> None:
    (line,) = told("lqr", "vehicle=mine.yaml")
    assert line.startswith("vehicle: mine.yaml leaves friction (3: vehicle.friction=0.9), the ")
    assert "the throttle map (map_throttle, map_speed, map_acceleration)" in line
    assert "other figures to carla_model3; lines in the file set them" in line
    (line,) = told("lqr", "vehicle=mine.yaml", "vehicle.friction=0.9")
    assert "leaves the steering curve" in line
    with mine.open("a", encoding="utf-8") as out:
        out.write("friction: 1.0\nsteer_curve_speed: [0, 50]\nsteer_curve_factor: [1, 1]\n")
    (line,) = told("lqr", "vehicle=mine.yaml")
    assert "mine.yaml leaves the throttle map" in line
    whole = dump(VehicleFile(file=str(mine)))
    assert whole is not None
    figures = {name: value for name, value in whole.items() if name not in {"kind", "file"}}
    mine.write_text(json.dumps({"base": "custom", **figures}), encoding="utf-8")
    assert told("lqr", "vehicle=mine.yaml") == []


@pytest.mark.parametrize(
    ("word", "line"),
    [
        ("l_f=116.8", "l_f is 116.8 m, in cars it is 0.02 to 10"),
        ("mass=1845000", "mass is 1.845e+06 kg"),
        ("mass=1.845", "yaw_inertia / (mass l_f l_r) is 725.4"),
        ("c_r=67.8", "c_r / (mass g) is 0.003746 /rad"),
        ("steer_rate_up=24.7", "24.7 deg/s of the road wheels it would be 0.3"),
        ("steer_rate_down=400", "in cars it is 0.05 to 20"),
        ("pedal_rate_up=0.01", "pedal_rate_up is 0.01 full strokes a second"),
    ],
)
def test_figures_in_another_unit_are_told(word: str, line: str) -> None:
    assert [one for one in told("pid", f"vehicle.{word}") if line in one]


def test_figures_beside_the_file_are_in_the_advice(mine: FilePath) -> None:
    *_, line = told("tuned/lqr", f"vehicle={mine}", "vehicle.mass=3100")
    assert "tune tuned/lqr --car FILE' makes one for this car; FILE is mine.yaml with" in line
    assert line.endswith("mass: 3100.0")
    *_, plain = told("tuned/lqr", f"vehicle={mine}")
    assert plain.endswith("tune tuned/lqr --car mine.yaml' makes one for this car")


def test_what_belongs_to_another_mass_is_named(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "van.yaml").write_text("base: vw_t7\nmass: 2310\nc_r: 150000\n", encoding="utf-8")
    (line,) = told("lqr", "vehicle=van.yaml")
    assert ", yaw_inertia (1.36e+04), c_f (" in line
    assert "c_r (" not in line
    (tmp_path / "van.yaml").write_text("base: vw_t7\nheight: 0.8\n", encoding="utf-8")
    assert not [line for line in told("lqr", "vehicle=van.yaml") if "yaw_inertia" in line]


@pytest.mark.parametrize(
    ("field", "given", "cure"),
    [
        ("l_f", "1,531", "write 1.531"),
        ("friction", "0,9", "write 0.9"),
        ("steering_ratio", "16.2", "give max_wheel_angle: the steering wheel's angle"),
    ],
)
def test_what_a_data_sheet_says_gets_an_answer(field: str, given: str, cure: str) -> None:
    with pytest.raises(ConfigError, match=cure):
        build(Vehicle, {field: given})


def test_no_known_car_is_implausible() -> None:
    for kind in components("vehicle"):
        if kind != "file":
            assert implausible(resolve("vehicle", kind)) is None
    scale = {"mass": 3.47, "yaw_inertia": 0.047, "l_f": 0.159, "l_r": 0.171, "track_width": 0.3}
    small = {"height": 0.07, "c_f": 80.0, "c_r": 80.0, "width": 0.3, "body_length": 0.5}
    assert implausible(Vehicle.model_validate(scale | small)) is None


@pytest.mark.parametrize("word", ["tuned/lqr", "controller=tuned/lqr", "supervised/tuned/lqr"])
def test_gains_of_another_car_say_so(mine: FilePath, word: str) -> None:
    assert told(word) == []
    line = told(word, f"vehicle={mine}")[-1]
    assert line.startswith("controller: tuned/lqr was tuned for carla_model3 (mass 1845, here ")
    assert line.endswith("'steersman tune tuned/lqr --car mine.yaml' makes one for this car")
    assert sm.configure("tune", "tuned/lqr", vehicle="mine.yaml").vehicle.mass == 2100.0


def test_a_policy_of_another_car_says_so(mine: FilePath) -> None:
    assert told("precision") == []
    line = told("controller=policy", "vehicle=bmw_320i")[-1]
    assert line.startswith("controller: precision was trained for carla_model3 (mass 1845, here 1")
    assert "'steersman train PRESET problem.vehicle=bmw_320i'" in line
    problem = sm.configure("train", "demo", "problem.vehicle=mine.yaml").problem
    assert problem.vehicle.mass == 2100.0


def test_every_command_that_drives_a_car_says_what_was_made_for_another(mine: FilePath) -> None:
    car = {"kind": "file", "file": str(mine)}
    course = {"path": "circle", "duration": 0.2, "speeds": {"slow": "constant_speed"}}
    suite = FilePath("suite.yaml")
    suite.write_text(json.dumps({"courses": {"c": course}, "vehicles": {"mine": car}}))
    few = ("duration=0.2", "trials=0", "checks=0", "bisections=1")
    lines: list[list[str]] = [[], [], []]
    sm.bench("tuned/lqr", "pid", suite=str(suite), jobs=1, notify=lines[0].append)
    sm.compare("tuned/lqr", "pid", suite=str(suite), jobs=1, notify=lines[1].append)
    sm.falsify("tuned/lqr", f"vehicle={mine}", *few, out="f", jobs=1, notify=lines[2].append)
    for told in lines:
        assert [line.partition(":")[0] for line in told[:2]] == ["vehicle", "controller"]
        assert "leaves friction" in told[0]
        assert "'steersman tune tuned/lqr --car mine.yaml'" in told[1]
        assert not any(line.startswith(("vehicle", "controller")) for line in told[2:])


def test_of_many_controllers_the_rest_share_a_line(mine: FilePath) -> None:
    made = [Made(entrants([word])[0].controller, [word]) for word in tuned.names()]
    bmw, model3 = (
        sm.configure("drive", vehicle=car).vehicle for car in ("bmw_320i", "carla_model3")
    )
    *told, last = about_cars([bmw], made)
    assert len(told) == 3
    assert last.startswith("controller: likewise made for another car: tuned/")
    assert [*about_cars([model3], made)] == []


def test_gains_tuned_for_this_car_say_nothing(mine: FilePath) -> None:
    folder = FilePath("runs")
    folder.mkdir()
    (folder / "tuned.yaml").write_text("controller: {kind: lqr}\n", encoding="utf-8")
    car = dump(VehicleFile(file=str(mine)))
    (folder / "result.json").write_text(json.dumps({"suite": [{"vehicle": car}]}), encoding="utf-8")
    for word in ("runs", "runs/tuned.yaml"):
        assert len(told(word, f"vehicle={mine}")) == 1  # what the file leaves to its base
        assert "was tuned for mine.yaml" in told(word)[-1]
    other = [{"vehicle": dump(CarlaModel3V1())}]
    (folder / "result.json").write_text(json.dumps({"suite": other}), encoding="utf-8")
    assert "was tuned for carla_model3_v1" in told("runs", f"vehicle={mine}")[-1]
    (folder / "result.json").write_text("[1]", encoding="utf-8")
    assert len(told("runs", f"vehicle={mine}")) == 1


@pytest.mark.parametrize("prefix", [f"{word}/" for word in _AROUND] + ["estimated/predicted/"])
def test_gains_of_another_car_say_so_behind_every_prefix(mine: FilePath, prefix: str) -> None:
    assert told(f"{prefix}tuned/lqr") == []
    line = told(f"{prefix}tuned/lqr", f"vehicle={mine}")[-1]
    assert line.startswith("controller: tuned/lqr was tuned for carla_model3 (mass 1845, here ")
    assert "'steersman tune tuned/lqr --car mine.yaml'" in line
    line = told(f"{prefix}precision", "vehicle=bmw_320i")[-1]
    assert line.startswith("controller: precision was trained for carla_model3")


def test_the_car_of_a_tuning_is_known_without_its_file(mine: FilePath) -> None:
    folder = FilePath("runs")
    folder.mkdir()
    car = dump(VehicleFile(file=str(mine)))
    suite = [{"vehicle": car}, {"vehicle": {**(car or {}), "mass": 2500}}, {"vehicle": car}]
    (folder / "result.json").write_text(json.dumps({"suite": suite}), encoding="utf-8")
    found = tuned_on("runs")
    assert found is not None
    assert (found[1].kind, found[1].mass) == ("file", 2100.0)
    (folder / "config.yaml").write_text(json.dumps({"vehicle": car}), encoding="utf-8")
    mine.unlink()
    found = tuned_on("runs/tuned.yaml")
    assert found is not None
    assert (found[0], found[1].mass) == (str(folder / "config.yaml"), 2100.0)
    assert tuned_on("tuned/lqr") is None


def test_the_car_of_shipped_gains_is_the_one_that_their_file_names() -> None:
    for name in tuned.names():
        file = tuned.locate(name)
        assert file is not None
        assert tuned.VEHICLE == "carla_model3"
        assert "carla_model3_v1" not in file.read_text(encoding="utf-8")


@pytest.mark.parametrize("base", ["carla_model3", "bmw_320i", "custom"])
def test_a_height_of_ones_own_decides_the_load_transfer(base: str, tmp_path: FilePath) -> None:
    """What a base's arm was fitted to is its own height."""
    file = tmp_path / "van.yaml"
    limits = []
    for arm in ("", "roll_arm: 0.3\n"):
        file.write_text(f"base: {base}\ntrack_width: 1.7\nheight: 0.85\n{arm}", encoding="utf-8")
        limits.append(VehicleFile(file=str(file)).roll_over_acceleration)
    assert limits == pytest.approx([GRAVITY, GRAVITY / 0.3 * 0.85])
