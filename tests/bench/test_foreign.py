"""Foreign worlds: which courses the user's files become, and who drives them on what plant."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path as FilePath

import numpy as np
import pytest
from typer.testing import CliRunner

from steersman.bench.drive import drive
from steersman.bench.entrants import entrant
from steersman.bench.foreign import ForeignFolders, foreign, published_noise
from steersman.bench.grip import demanded_grip, grip_class
from steersman.bench.suite import Scenario, Suite
from steersman.bench.suites import suite, write_suite
from steersman.cli import app
from steersman.config import build
from steersman.errors import ConfigError, DataError
from steersman.paths.tum_reference import TumReference

from ..paths import xodr_maps

SHARED = FilePath(os.environ.get("STEERSMAN_DATA", "../shared/data"))
ANGLES = np.linspace(0.0, math.tau, 80, endpoint=False)
X, Y = 120.0 * np.cos(ANGLES), 70.0 * np.sin(ANGLES)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> ForeignFolders:
    place = tmp_path_factory.mktemp("foreign")
    found = ForeignFolders(*(place / name for name in ForeignFolders._fields))
    for folder in found:
        folder.mkdir()
    rows = "\n".join(f"{x:.3f},{y:.3f},5,5" for x, y in zip(X, Y, strict=True))
    (found.tracks / "Oval.csv").write_text(f"# x_m,y_m,w_tr_right_m,w_tr_left_m\n{rows}\n")
    xodr_maps.write(found.maps / "town.xodr", xodr_maps.town())
    speeds = {"pos_x": [*X], "pos_y": [*Y], "ref_v": [12.0 + k % 2 for k in range(X.size)]}
    (found.tum / "reftraj_oval.json").write_text(json.dumps(speeds))
    line = "\n".join(f"{4 * k},{0.1 * k * k},{6 + 0.1 * k}" for k in range(30))
    (found.logs / "line.csv").write_text(f"x,y,speed\n{line}\n")
    (found.logs / "still.csv").write_text("x,y\n1,1\n1,1\n1,1\n")
    return found


@pytest.fixture(scope="module")
def made(folders: ForeignFolders) -> tuple[Suite, list[str]]:
    said: list[str] = []
    return foreign(folders, said.append)[0], said


@pytest.fixture(scope="module")
def by_name(made: tuple[Suite, list[str]]) -> dict[str, Scenario]:
    return {scenario.name: scenario for scenario in made[0].scenarios()}


def test_each_file_is_a_course_for_the_cars_it_is_meant_for(by_name: dict[str, Scenario]) -> None:
    cars: dict[str, set[str]] = {}
    for scenario in by_name.values():
        cars.setdefault(scenario.path, set()).add(scenario.vehicle)
    assert cars["Oval_carla_model3"] == {"carla_model3"}
    assert cars["Oval_bmw_320i"] == cars["multibody_figure_eight"] == {"bmw_320i"}
    assert cars["reftraj_oval"] == {"vw_t7"}
    assert cars["line"] == cars["town_0"] == {"carla_model3"}


def test_a_file_that_cannot_be_driven_is_left_out_with_its_reason(
    made: tuple[Suite, list[str]],
) -> None:
    assert "still" not in made[0].courses
    assert any(text.startswith("still.csv: left out: ") for text in made[1])
    assert any(text.startswith("town.xodr: courses of ") for text in made[1])


@pytest.mark.parametrize(("share", "group"), [(60, "within 60 %"), (80, "60 to 90 %")])
@pytest.mark.parametrize("car", ["carla_model3", "bmw_320i"])
def test_circuits_are_driven_at_a_share_of_the_cars_grip(
    by_name: dict[str, Scenario], car: str, share: int, group: str
) -> None:
    scenario = by_name[f"Oval_{car}/grip_{share}/clean/{car}/0"]
    found = demanded_grip(scenario.run)
    assert found <= 0.01 * share + 0.02
    if car == "bmw_320i":  # the other one's engine does not take it there
        assert grip_class(found - 0.02) == group


def test_references_meet_the_published_noise_on_their_own_plant(
    by_name: dict[str, Scenario],
) -> None:
    found = [s for s in by_name.values() if s.path == "reftraj_oval"]
    assert {s.disturbance for s in found} == {"clean", *published_noise()}
    assert {s.run.plant.kind for s in found} == {"tum_single_track"}
    assert {(s.run.corridor, s.run.duration) for s in found} == {(5.0, 120.0)}
    noisy = by_name["reftraj_oval/reference/published_noise_2/vw_t7/0"].run.sensor
    assert noisy.deviations == (0.0, 0.0, 0.0, 0.8, 0.35, 0.035)
    reference = found[0].run.path
    at, speed = reference.speeds() or ((), ())
    assert len(at) == X.size
    assert set(speed) == {12.0, 13.0}


def test_they_are_driven(by_name: dict[str, Scenario]) -> None:
    lqr = entrant("tuned/lqr")
    for name in ("reftraj_oval/reference/clean/vw_t7/0", "multibody_figure_eight/constant/clean"):
        (scenario,) = [one for key, one in by_name.items() if key.startswith(name)]
        short = scenario.run.model_copy(update={"duration": 2.0})
        episode = drive(scenario._replace(run=short), lqr)
        assert episode.end == "duration"
        assert episode.meta["config"]["plant"]["kind"] == scenario.run.plant.kind


def test_the_suite_survives_its_file(made: tuple[Suite, list[str]], tmp_path: FilePath) -> None:
    write_suite(made[0], tmp_path)
    assert suite(str(tmp_path / "suite.yaml")).scenarios() == made[0].scenarios()


def test_without_a_folder_its_world_is_left_out(folders: ForeignFolders) -> None:
    found, maps = foreign(ForeignFolders(tum=folders.tum))
    assert maps == []
    assert {course.split("_")[0] for course in found.courses} == {"multibody", "reftraj"}


def test_what_is_refused(folders: ForeignFolders, tmp_path: FilePath) -> None:
    with pytest.raises(DataError, match="no: no such folder"):
        foreign(ForeignFolders(tracks=FilePath("no")))
    with pytest.raises(DataError, match=r"holds no \*\.json"):
        foreign(ForeignFolders(tum=tmp_path))
    twice = folders.tracks.parent / "twice"  # type: ignore[union-attr]
    twice.mkdir()
    (twice / "reftraj_oval.csv").write_text((folders.logs / "line.csv").read_text())  # type: ignore[operator]
    with pytest.raises(ConfigError, match="two courses would be named 'reftraj_oval'"):
        foreign(ForeignFolders(tum=folders.tum, logs=twice))
    course = {"path": "circle", "speeds": {"a": "constant_speed"}, "vehicle": "carla_modl3"}
    with pytest.raises(ConfigError, match=r"courses\.x\.vehicle.*did you mean 'carla_model3'"):
        build(Suite, {"courses": {"x": course}})
    result = CliRunner().invoke(app, ["bench", "quick", "--tum", ".", "--out", str(tmp_path / "o")])
    assert result.exit_code == 2
    assert result.stderr == "error: --tum goes with the suite 'foreign'\n"


@pytest.mark.parametrize(
    "text", ["[]", "{", '{"pos_x": [1]}', '{"pos_x": [0, 1], "pos_y": [0, 1, 2], "ref_v": [1, 1]}']
)
def test_a_broken_reference_is_one_line(tmp_path: FilePath, text: str) -> None:
    (tmp_path / "broken.json").write_text(text)
    with pytest.raises(
        DataError, match=r"broken\.json: (needs lists|its lists|not valid JSON)"
    ) as error:
        TumReference(file=tmp_path / "broken.json").build_table()
    assert "\n" not in str(error.value)


@pytest.mark.skipif(
    not (SHARED / "tum_control").is_dir(), reason="needs the references in ../shared/data"
)
def test_the_published_reference_is_driven_within_centimetres() -> None:
    found, _ = foreign(ForeignFolders(tum=SHARED / "tum_control"))
    name = "reftraj_monteblanco_edgar/reference/clean/vw_t7/0"
    (scenario,) = [one for one in found.scenarios() if one.name == name]
    short = scenario.run.model_copy(update={"duration": 20.0})
    episode = drive(scenario._replace(run=short), entrant("tuned/lqr"))
    assert episode.end == "duration"
    assert float(np.max(np.abs(episode["lateral_error"]))) < 0.05
