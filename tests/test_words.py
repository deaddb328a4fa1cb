"""One resolver: every word for every family means the same in Python, files and commands."""

from __future__ import annotations

from pathlib import Path as FilePath

import pytest

import steersman as sm
from steersman import policies, tuned, words
from steersman.config import Component, components, dump, families, resolve
from steersman.controllers.lqr import Lqr
from steersman.controllers.supervisor import Supervisor

CAR = "base: bmw_320i\nmass: 1500\n"
LQR = {"kind": "lqr", "r": 3.0}


@pytest.fixture(autouse=True)
def files(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    """One file or folder of each sort that a word may name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gains.yaml").write_text("controller: {kind: lqr, r: 3.0}\n")
    (tmp_path / "bare.yaml").write_text("{kind: lqr, r: 3.0}\n")
    (tmp_path / "based.yaml").write_text("controller: {kind: tuned/lqr, r: 3.0}\n")
    (tmp_path / "car.yaml").write_text(CAR)
    (tmp_path / "track.csv").write_text("x,y\n0,0\n50,0\n50,50\n0,50\n")
    (tmp_path / "pace.csv").write_text("time_s,speed_m_s\n0,5\n9,6\n")
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "tuned.yaml").write_text("controller: {kind: lqr, r: 3.0}\n")


WORDS = [
    ("controller", "lqr", {"kind": "lqr"}),
    ("controller", "gains.yaml", LQR),
    ("controller", "bare.yaml", LQR),
    ("controller", "study", LQR),
    ("controller", "precision", {"kind": "policy", "file": "precision"}),
    ("controller", "my.onnx", {"kind": "policy", "file": "my.onnx"}),
    ("controller", "supervised/lqr", {"kind": "supervisor", "inner": {"kind": "lqr"}}),
    ("controller", "supervised/gains.yaml", {"kind": "supervisor", "inner": LQR}),
    ("path", "track.csv", {"kind": "csv", "file": "track.csv"}),
    ("path", "town.xodr", {"kind": "opendrive", "file": "town.xodr"}),
    ("path", "drive.mcap", {"kind": "mcap", "file": "drive.mcap"}),
    ("speed", "pace.csv", {"kind": "csv", "file": "pace.csv"}),
    ("vehicle", "car.yaml", {"kind": "file", "file": "car.yaml"}),
]


@pytest.mark.parametrize(("family", "word", "expected"), WORDS, ids=[w for _, w, _ in WORDS])
def test_a_word_is_a_component(family: str, word: str, expected: dict[str, object]) -> None:
    assert words.fields_of(family, word) == expected
    assert words.means(family, word)


@pytest.mark.parametrize("family", families())
def test_every_kind_is_a_word_and_a_misspelt_one_names_the_nearest(family: str) -> None:
    for kind in components(family):
        assert words.fields_of(family, kind) == {"kind": kind}
    kind = max(components(family), key=len)
    with pytest.raises(sm.ConfigError, match=f"unknown {family}.*did you mean") as error:
        words.fields_of(family, f"{kind}x")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("family", ["path", "controller", "vehicle"])
def test_a_file_that_names_itself_is_one_line(tmp_path: FilePath, family: str) -> None:
    (tmp_path / "a.yaml").write_text("kind: b.yaml\n")
    (tmp_path / "b.yaml").write_text("kind: a.yaml\n")
    assert words.means(family, "a.yaml")
    with pytest.raises(sm.ConfigError, match="leads back to itself"):
        words.fields_of(family, "a.yaml")


@pytest.mark.parametrize("family", ["path", "controller", "vehicle"])
def test_a_word_that_no_file_can_have_is_unknown(family: str) -> None:
    with pytest.raises(sm.ConfigError, match=f"unknown {family}"):
        words.fields_of(family, "x" * 5000)


@pytest.mark.parametrize("name", [*tuned.names(), *policies.names()])
def test_controllers_of_the_package_are_words_also_under_supervision(name: str) -> None:
    found = resolve("controller", name)
    watched = resolve("controller", f"supervised/{name}")
    assert isinstance(watched, Supervisor)
    assert watched.inner == found


def test_fields_are_laid_over_what_a_word_gives() -> None:
    found = sm.make("controller", "tuned/lqr", r=3)
    assert isinstance(found, Lqr)
    assert found == sm.make("controller", "based.yaml")
    assert found.q_heading == sm.load("gains.yaml").q_heading or found.q_heading > 0.0
    watched = sm.make("controller", "supervised/tuned/lqr", inner={"r": 3})
    assert isinstance(watched, Supervisor)
    assert watched.inner == found


# The same drive in many words.
DRIVES = [
    ("tuned/lqr", "circle", "path.radius=60"),
    ("circle", "tuned/lqr", "path.radius=60"),
    ("controller=tuned/lqr", "path=circle", "path.radius=60"),
    ("config.yaml", "path.radius=60"),
]


@pytest.mark.parametrize("given", DRIVES, ids=" ".join)
def test_words_of_a_drive(given: tuple[str, ...]) -> None:
    FilePath("config.yaml").write_text("controller: tuned/lqr\npath: circle\n")
    python = sm.configure("drive", "tuned/lqr", path={"kind": "circle", "radius": 60})
    assert sm.configure("drive", *given) == python
    circle = sm.make("path", "circle", radius=60)
    assert sm.configure("drive", sm.make("controller", "tuned/lqr"), circle) == python
    assert sm.configure("drive", "tuned/lqr", "path.radius=60", path="circle") == python


@pytest.mark.parametrize("command", ["drive", "tune", "falsify"])
@pytest.mark.parametrize("word", [word for family, word, _ in WORDS[:5] if family == "controller"])
def test_a_word_alone_is_the_controller(command: str, word: str) -> None:
    found = sm.configure(command, word).controller
    assert found == resolve("controller", word) == sm.configure(command, controller=word).controller


def test_nested_words_of_a_training() -> None:
    assigned = ["problem.demonstration.controller=gains.yaml", "problem.base=tuned/lqr"]
    problem = sm.configure("train", "demo", *assigned, "problem.action=residual").problem
    assert dump(problem.demonstration.controller) == dump(resolve("controller", "gains.yaml"))
    assert problem.base == resolve("controller", "tuned/lqr")
    roads = sm.configure("train", "demo", problem={"roads": ["track.csv", "circle"]}).problem.roads
    assert [road.kind for road in roads] == ["csv", "circle"]


def test_a_field_of_the_default_plant_needs_no_name_of_the_plant() -> None:
    for word in ("problem.plant.dt=0.02", "plant.dt=0.02"):
        problem = sm.configure("train", "demo", word).problem
        assert (problem.plant.kind, problem.plant.dt) == ("simulator", 0.02)


def test_components_of_your_own_go_as_objects() -> None:
    class Straight(sm.Controller):
        def init(self, vehicle: object, dt: float) -> None:
            return None

        def decide(self, state: None, observation: sm.Observation) -> tuple[float, sm.Status, None]:
            return 0.0, sm.Status.SOLVED, None

    assert sm.drive(Straight(), path="straight", duration=1).end == "duration"
    assert sm.attempt(controller=Straight(), path="circle").outcome == "left_road"


def test_load_gives_back_what_was_written() -> None:
    episode = sm.drive("gains.yaml", duration=1, out="run")
    assert sm.load("run").end == episode.end == sm.load("run/episode.npz").end
    assert sm.load("run/config.yaml").controller == sm.load("study") == sm.load("gains.yaml")
    assert isinstance(sm.load("study"), Component)
    with pytest.raises(sm.DataError, match="holds nothing to load"):
        sm.load(".")
    with pytest.raises(sm.DataError, match="no such file"):
        sm.load("no.npz")
    with pytest.raises(sm.DataError, match="holds a drive already"):
        sm.drive(duration=1, out="run")


def test_bench_takes_dotted_settings_and_load_gives_the_typed_result(
    tmp_path: FilePath,
) -> None:
    words = ("pid", "mine=tuned/lqr", "corridor=2")
    found = sm.bench(*words, suite="quick", out=tmp_path, jobs=1)
    assert set(found.summary.controllers) == {"pid", "mine"}
    assert "corridor: 2" in (tmp_path / "suite.yaml").read_text()
    assert sm.load(tmp_path) == found
    assert type(sm.load(tmp_path / "results.json")) is type(found)


def test_an_interrupted_drive_keeps_what_was_driven(tmp_path: FilePath) -> None:
    def stop(share: float) -> None:
        if share > 0.1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sm.drive("pid", duration=60, out=tmp_path, progress=stop)
    assert 0.0 < sm.load(tmp_path)["time"][-1] < 59.0


class Handed(sm.Controller):
    """What a user writes; it has no registered name."""

    gain: float = sm.param(0.3, "1/m", "Gain.")

    def init(self, vehicle: sm.Vehicle, dt: float) -> None:
        """Nothing is kept."""

    def decide(self, state: None, observation: sm.Observation) -> tuple[float, sm.Status, None]:
        """Feedback of the lateral error alone."""
        return -self.gain * observation.lateral_error, sm.Status.SOLVED, state


NO_WORDS = [
    (Handed, r"Handed is a class.*write Handed\(\)"),
    (lambda seen: 0.0, "<lambda> is a function"),
    (["lqr"], r"\['lqr'\] of type list is neither a word"),
    (42, "42 of type int"),
    (None, "None of type NoneType"),
]


@pytest.mark.parametrize(("value", "message"), NO_WORDS)
@pytest.mark.parametrize("command", ["drive", "train", "tune", "falsify", "imitate"])
def test_what_names_nothing_is_not_passed_over(command: str, value: object, message: str) -> None:
    with pytest.raises(sm.ConfigError, match=message):
        sm.configure(command, value)  # type: ignore[arg-type]


@pytest.mark.parametrize(("value", "message"), NO_WORDS)
def test_nor_by_what_takes_names_alone(value: object, message: str) -> None:
    for verb in (sm.bench, sm.identify):
        if not (verb is sm.identify and isinstance(value, list)):  # a list of recordings
            with pytest.raises(sm.ConfigError, match=message):
                verb(value)  # type: ignore[operator]


def test_a_component_has_its_name_first() -> None:
    with pytest.raises(sm.ConfigError, match="a Handed was handed over, expected a word"):
        sm.bench(Handed())  # type: ignore[arg-type]
    for family in ("controller", "vehicle"):
        with pytest.raises(sm.ConfigError, match="Handed is a class"):
            sm.make(family, Handed)


def test_a_component_is_handed_over_as_object_path_or_fields(tmp_path: FilePath) -> None:
    mine = Handed(gain=0.4)
    assert sm.configure("drive", mine).controller is mine
    for word in (LQR, tmp_path / "gains.yaml"):
        assert sm.configure("drive", word, path="circle").controller == Lqr(r=3.0)
    with pytest.raises(sm.ConfigError, match="'lqq' is neither a file nor"):
        sm.configure("drive", {"kind": "lqq"})
