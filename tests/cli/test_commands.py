"""What each command prints and writes."""

from __future__ import annotations

import io
import json
import math
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from tests.loops import random_policy
from typer.testing import Result

import steersman as sm
from steersman import commands, files, policies, tuned
from steersman.cli import output
from steersman.config import build, components, families, read_yaml, resolve, to_yaml
from steersman.episode import load_episode
from steersman.errors import ConfigError, DataError
from steersman.learning.config import TrainConfig
from steersman.learning.progress import TrainRow
from steersman.metrics.base import metrics
from steersman.ranges import split_seeds
from steersman.rollout import RunConfig
from steersman.types import Decision
from steersman.world import Simulation

Steersman = Callable[..., Result]
COMMANDS = (
    *("list", "show", "drive", "train", "imitate", "demo", "tune", "falsify", "bench", "reproduce"),
    *("report", "path", "export"),
)
# Figures that differ from run to run.
TIMES = [name for name in metrics() if name.startswith("control_time")]


def without_times(metrics: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in metrics.items() if name not in TIMES}


NARROW = ("3.579e-05", "0.0001244")


class Terminal:
    """Standard error that says it is a terminal."""

    def __init__(self, stream: Any) -> None:
        self.stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def isatty(self) -> bool:
        return True


class TestHelp:
    def test_alone_it_shows_the_help(self, steersman: Steersman) -> None:
        result = steersman()
        assert result.stdout == steersman("--help").stdout
        assert result.exit_code == 0
        for command in COMMANDS:
            assert f"\n  {command} " in result.stdout

    @pytest.mark.parametrize("command", COMMANDS)
    def test_every_command_has_examples(self, steersman: Steersman, command: str) -> None:
        result = steersman(command, "--help")
        assert "Examples:\n" in result.stdout
        assert f"\n    steersman {command}" in result.stdout
        assert result.exit_code == 0

    def test_version(self, steersman: Steersman) -> None:
        assert steersman("--version").stdout == f"steersman {version('steersman')}\n"

    def test_version_says_what_made_a_result(self, steersman: Steersman) -> None:
        found = json.loads(steersman("version", "--json").stdout)
        assert found["versions"]["steersman"] == version("steersman")
        assert {"commit", "platform", "machine"} <= set(found)
        assert found["extras"]["tune"] == []  # the tests need it
        assert not {"dev", "docs"} & set(found["extras"])

    def test_a_missing_extra_is_named_with_what_it_lacks(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(
            "steersman.cli.version.requires", lambda _: ["no-such>=1; extra == 'tune'"]
        )
        shown = steersman("version").stdout
        assert re.search(r"extra tune +lacks no-such", shown)


class TestList:
    def test_everything_as_json(self, steersman: Steersman) -> None:
        result = steersman("list", "--json")
        listed = json.loads(result.stdout)
        expected = {family: list(components(family)) for family in families()}
        expected["controller"] += [*tuned.names(), *policies.names()]
        assert {family: list(names) for family, names in listed.items()} == expected
        # Other tests may have declared components of their own, without a word of explanation.
        ours = {
            (family, name)
            for family in families()
            for name, cls in components(family).items()
            if cls.__module__.startswith("steersman.")
        }
        assert all(listed[family][name] for family, name in ours)

    def test_one_family_as_a_table_of_80_columns(self, steersman: Steersman) -> None:
        lines = steersman("list", "path").stdout.splitlines()
        assert lines[0].split() == ["kind", "name", "what", "it", "is"]
        assert any(line.startswith("path  monza ") for line in lines)
        assert not any(line.startswith("controller") for line in lines)
        assert max(map(len, lines)) <= 80
        assert "\x1b" not in "".join(lines)


class TestShow:
    @pytest.mark.parametrize("word", ["lqr", "controller.lqr", "tuned/lqr"])
    def test_a_word_of_one_family_needs_no_kind(self, steersman: Steersman, word: str) -> None:
        shown = steersman("show", word).stdout
        assert shown.startswith(f"controller {word.removeprefix('controller.')}\n\nLinear-quadr")

    @pytest.mark.parametrize(
        ("word", "hint"),
        [
            ("lqrr", "did you mean 'lqr'?"),
            ("csv", "write path.csv or speed.csv"),
            ("q", "allowed: agent, controller,"),
        ],
    )
    def test_a_word_of_no_family(self, steersman: Steersman, word: str, hint: str) -> None:
        result = steersman("show", word)
        assert result.exit_code == 2
        assert hint in result.stderr

    @pytest.mark.parametrize(
        ("kind", "name", "text", "field", "value"),
        [
            ("vehicle", "car.yaml", "base: bmw_320i\nmass: 1234\n", "mass", 1234.0),
            ("controller", "mine.yaml", "kind: lqr\nr: 3\n", "r", 3.0),
            (
                "controller",
                "tuned.yaml",
                "controller: {kind: pid, k_heading: 2}\n",
                "k_heading",
                2.0,
            ),
            ("path", "ring.yaml", "path: {kind: circle, radius: 33}\n", "radius", 33.0),
            ("path", "line.csv", "x,y\n0,0\n10,0\n20,1\n", "file", "line.csv"),
            ("sensor", "eye.yaml", "kind: waypoints\ncount: 9\n", "count", 9),
            ("drive", "drive.yaml", "duration: 7\n", "duration", 7.0),
            ("train", "mine.yaml", "like: demo\nsteps: 1234\n", "steps", 1234),
            ("bench", "quick", "", "corridor", 1.5),
        ],
    )
    def test_a_file_is_shown_as_a_name_is(
        self, steersman: Steersman, kind: str, name: str, text: str, field: str, value: object
    ) -> None:
        if text:
            FilePath(name).write_text(text)
        shown = json.loads(steersman("show", kind, name, "--json").stdout)
        assert (shown["kind"], shown["name"]) == (kind, name)
        assert next(f["default"] for f in shown["fields"] if f["name"] == field) == value

    def test_a_file_of_another_kind_says_what_it_holds(self, steersman: Steersman) -> None:
        FilePath("mine.yaml").write_text("kind: lqr\n")
        result = steersman("show", "vehicle", "mine.yaml")
        assert result.exit_code == 2
        assert "mine.yaml: holds a controller, kind: lqr; expected a vehicle" in result.stderr

    def test_a_component(self, steersman: Steersman) -> None:
        result = steersman("show", "path", "circle")
        assert "path circle\n\nA full circle" in result.stdout
        row = next(line for line in result.stdout.splitlines() if line.startswith("radius"))
        assert row.split()[1:6] == ["50", "m", ">=", "0.1,", "<="]
        assert "left | right" in result.stdout

    def test_fields_as_json(self, steersman: Steersman) -> None:
        data = json.loads(steersman("show", "controller", "mpc_pid", "--json").stdout)
        assert (data["kind"], data["name"]) == ("controller", "mpc_pid")
        fields = {field["name"]: field for field in data["fields"]}
        assert fields["horizon"] == {
            "name": "horizon",
            "type": "whole number",
            "required": False,
            "default": 20,
            "unit": "-",
            "bounds": {"ge": 2, "le": 200},
            "choices": [],
            "meaning": "Steps of the MPC, one control period each.",
        }
        # The group's default here need not be that of the group's own class.
        default = getattr(resolve("controller", "mpc_pid"), "gains").k_p  # noqa: B009
        assert fields["gains.k_p"]["default"] == default
        assert fields["corridor"]["type"] == "number or null"

    @pytest.mark.parametrize("family", families())
    def test_every_component_can_be_shown(self, steersman: Steersman, family: str) -> None:
        for name, cls in components(family).items():
            text = steersman("show", family, name).stdout
            assert text.startswith(f"{family} {name}\n")
            assert max(map(len, text.splitlines())) <= 80
            data = json.loads(steersman("show", family, name, "--json").stdout)
            shown = {field["name"].partition(".")[0] for field in data["fields"]}
            assert shown == set(cls.model_fields)

    @pytest.mark.parametrize("command", ["drive", "train", "imitate", "tune", "falsify"])
    def test_settings_of_a_command(self, steersman: Steersman, command: str) -> None:
        data = json.loads(steersman("show", command, "--json").stdout)
        assert data["name"] is None
        assert "seed" in {field["name"] for field in data["fields"]}

    def test_settings_whose_defaults_are_many(self, steersman: Steersman) -> None:
        result = steersman("show", "bench")
        assert result.exit_code == 0
        assert "vehicles      {carla_model3:" in result.stdout

    def test_settings_of_drive_are_those_of_a_run(self, steersman: Steersman) -> None:
        data = json.loads(steersman("show", "drive", "--json").stdout)
        names = dict.fromkeys(field["name"].partition(".")[0] for field in data["fields"])
        assert list(names) == list(RunConfig.model_fields)
        path = next(field for field in data["fields"] if field["name"] == "path")
        assert path["type"] == "a path"
        assert "a path" in steersman("show", "drive").stdout

    def test_a_required_field(self, steersman: Steersman) -> None:
        row = next(
            line
            for line in steersman("show", "path", "csv").stdout.splitlines()
            if line.startswith("file")
        )
        assert "(required)" in row


class TestTuned:
    def test_it_is_listed_and_shown_with_its_gains(self, steersman: Steersman) -> None:
        listed = json.loads(steersman("list", "controller", "--json").stdout)["controller"]
        assert set(tuned.names()) < set(listed)
        shown = json.loads(steersman("show", "controller", "tuned/mpc_pid", "--json").stdout)
        plain = json.loads(steersman("show", "controller", "mpc_pid", "--json").stdout)
        assert [f["name"] for f in shown["fields"]] == [f["name"] for f in plain["fields"]]
        assert shown["fields"] != plain["fields"]


class TestDrive:
    def test_json_is_one_object_with_config_and_metrics(self, steersman: Steersman) -> None:
        result = steersman("drive", "path.radius=40", "duration=2", "--json")
        assert result.exit_code == 0
        assert result.stderr == ""
        data = json.loads(result.stdout)
        assert list(data) == ["config", "metrics"]
        assert data["config"]["path"] == {"kind": "circle", "radius": 40.0, "direction": "left"}
        assert set(metrics()) < set(data["metrics"])
        assert data["metrics"]["end"] == "duration"
        assert data["metrics"]["plant"] == "embedded simulator"
        assert data["metrics"]["duration_s"] == pytest.approx(2.0)
        assert build(RunConfig, data["config"]).duration == 2.0

    def test_table(self, steersman: Steersman) -> None:
        result = steersman("drive", "controller=pid", "duration=1")
        lines = result.stdout.splitlines()
        assert lines[0] == (
            "pid drives carla_model3 on circle, constant_throttle; ended by: duration"
        )
        (error,) = (line for line in lines if line.startswith("mean |lateral error|"))
        unit, value, _ = error.split()[-3:]
        driven = sm.drive("pid", "duration=1").metrics.mean_abs_lateral_error_m
        assert (unit, float(value)) == ("mm", pytest.approx(1e3 * driven, rel=1e-3))
        assert max(map(len, lines)) <= 80
        assert "\x1b" not in result.stdout

    def test_a_bend_that_was_too_fast_is_named_with_its_cure(self, steersman: Steersman) -> None:
        words = ("drive", "tuned/lqr", "path.radius=15", "duration=5")
        result = steersman(*words, "speed=constant_speed", "speed.speed=25")
        assert "ended by: " in result.stdout
        assert "m/s in a bend of 15 m ask for " in result.stderr
        cure = re.search(r"; (speed.a_lat_max=[0-9.]+) slows down for bends", result.stderr)
        assert cure is not None
        cured = steersman(*words, "speed=constant_speed", "speed.speed=25", cure[1])
        assert "ended by: duration" in cured.stdout
        assert "speed: " not in cured.stderr

    def test_files_in_the_folder(self, steersman: Steersman, tmp_path: FilePath) -> None:
        result = steersman("drive", "duration=1", "seed=3", "--json", "--out", "a/b")
        folder = tmp_path / "a" / "b"
        names = {file.name for file in folder.iterdir()}
        assert names == {"config.yaml", "episode.npz", "metrics.json"}
        printed = json.loads(result.stdout)
        assert json.loads((folder / "metrics.json").read_text()) == printed["metrics"]
        assert read_yaml(folder / "config.yaml") == printed["config"]
        episode = load_episode(folder / "episode.npz")
        assert len(episode) == 20
        assert episode.meta["config"] == printed["config"]

    def test_its_config_drives_the_same_again(self, steersman: Steersman) -> None:
        words = ["sensor.error_range=0.1", "duration=2", "seed=5", "controller=pid"]
        first = json.loads(steersman("drive", *words, "--json", "--out", "run").stdout)
        again = json.loads(steersman("drive", "run/config.yaml", "--json").stdout)
        assert again["config"] == first["config"]
        assert without_times(again["metrics"]) == without_times(first["metrics"])

    def test_an_earlier_drive_is_replaced_only_if_told(
        self, steersman: Steersman, tmp_path: FilePath
    ) -> None:
        assert steersman("drive", "duration=1", "--out", "run").exit_code == 0
        before = (tmp_path / "run" / "episode.npz").read_bytes()
        refused = steersman("drive", "duration=2", "--out", "run")
        assert refused.exit_code == 2
        assert "run: holds a drive already; give another folder or --overwrite" in refused.stderr
        assert (tmp_path / "run" / "episode.npz").read_bytes() == before
        assert steersman("drive", "duration=2", "--out", "run", "--overwrite").exit_code == 0
        assert len(load_episode(tmp_path / "run" / "episode.npz")) == 40

    def test_a_tuned_controller_of_the_package(self, steersman: Steersman) -> None:
        words = ("duration=1", "--json")
        one = json.loads(steersman("drive", "controller=tuned/lqr", *words).stdout)["config"]
        two = json.loads(steersman("drive", "tuned/lqr", *words).stdout)["config"]
        assert one == two
        words = ("controller=tuned/pid", "controller.gains.k_i=0.5", *words)
        gains = json.loads(steersman("drive", *words).stdout)["config"]["controller"]["gains"]
        assert gains["k_i"] == 0.5
        assert gains["k_p"] == read_yaml(tuned.locate("tuned/pid"))["controller"]["gains"]["k_p"]

    def test_settings_go_over_the_file(self, steersman: Steersman, tmp_path: FilePath) -> None:
        (tmp_path / "run.yaml").write_text("path: {kind: circle, radius: 30}\nduration: 9\n")
        words = ["duration=1", "run.yaml", "path.direction=right", "--json"]
        config = json.loads(steersman("drive", *words).stdout)["config"]
        assert config["path"] == {"kind": "circle", "radius": 30.0, "direction": "right"}
        assert config["duration"] == 1.0

    def test_leaving_the_road_is_a_result(self, steersman: Steersman) -> None:
        words = ["controller.c_mpc=0", "controller.c_pid=0", "path=training_circuit"]
        result = steersman("drive", *words, "laps=1", "speed=constant_speed", "--json")
        assert result.exit_code == 0
        metrics = json.loads(result.stdout)["metrics"]
        assert metrics["off_track"] is True
        assert metrics["completed"] is False

    def test_a_failing_controller_loses_nothing(
        self, steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        pid = components("controller")["pid"]

        def step(self: Any, state: Any, observation: Any) -> Any:
            return Decision(math.nan if observation.time >= 1.499 else 0.1), state

        monkeypatch.setattr(pid, "step", step)
        result = steersman("drive", "controller=pid", "--json", "--out", "run")
        assert result.exit_code == 2
        assert result.stdout == ""
        assert result.stderr.startswith("error: controller 'pid' returned steering nan")
        assert "at t = 1.50 s; what was driven until then is in run" in result.stderr
        assert result.stderr.count("\n") == 1
        episode = load_episode(tmp_path / "run" / "episode.npz")
        assert (episode.end, len(episode)) == ("error", 30)
        assert json.loads((tmp_path / "run" / "metrics.json").read_text())["end"] == "error"

    def test_interrupted_it_saves_what_was_driven(
        self, steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        original, calls = Simulation.step, iter(range(1000))

        def step(self: Any, command: Any) -> Any:
            if next(calls) == 10:
                raise KeyboardInterrupt
            return original(self, command)

        monkeypatch.setattr(Simulation, "step", step)
        result = steersman("drive", "--json", "--out", "run")
        assert result.exit_code == 130
        assert json.loads(result.stdout)["metrics"]["completed"] is False
        assert load_episode(tmp_path / "run" / "episode.npz").end == "interrupted"

    def test_interrupted_before_the_run(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def interrupt(*_: Any) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("steersman.rollout.attempt", interrupt)
        result = steersman("drive")
        assert (result.exit_code, result.stdout, result.stderr) == (130, "", "")


class TestReport:
    def test_runs_become_a_page(self, steersman: Steersman, tmp_path: FilePath) -> None:
        pytest.importorskip("jinja2")
        assert steersman("drive", "duration=1", "--out", "one").exit_code == 0
        assert steersman("drive", "duration=1", "controller=pid", "--out", "two").exit_code == 0
        result = steersman("report", "one", "two", "--out", "new/page.html", "--title", "Both")
        assert result.exit_code == 0
        assert result.stderr == "written: new/page.html\n"
        page = (tmp_path / "new" / "page.html").read_text(encoding="utf-8")
        assert "<title>Both</title>" in page

    def test_a_drive_is_written_as_a_page(self, steersman: Steersman, tmp_path: FilePath) -> None:
        result = steersman("drive", "duration=1", "--report", "new/page.html", "--json")
        assert result.exit_code == 0
        assert "replay: new/page.html" in result.stderr
        assert json.loads(result.stdout)["metrics"]["completed"]
        page = (tmp_path / "new" / "page.html").read_text(encoding="utf-8")
        assert "<title>mpc pid on circle</title>" in page
        assert 'id="replay"' in page

    def test_a_page_that_cannot_be_written_is_told_before_the_drive(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("steersman.rollout.run", lambda *_: pytest.fail("it drove"))
        result = steersman("drive", "--report", ".")
        assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
        assert "--report: expected the name of a file" in result.stderr
        monkeypatch.setitem(sys.modules, "jinja2", None)
        assert "pip install 'steersman[report]'" in steersman("drive", "--report", "x").stderr

    def test_a_missing_extra_is_named(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        assert steersman("drive", "duration=1", "--out", "one").exit_code == 0
        monkeypatch.setitem(sys.modules, "jinja2", None)
        result = steersman("report", "one", "--out", "page.html")
        assert "pip install 'steersman[report]'" in result.stderr

    def test_a_folder_with_a_page_of_its_own_is_left_out(
        self, steersman: Steersman, tmp_path: FilePath
    ) -> None:
        pytest.importorskip("jinja2")
        steersman("drive", "duration=1", "--out", "one")
        for name in ("tuned", "benchmark", "demo"):
            (tmp_path / name).mkdir()
            (tmp_path / name / "report.html").touch()
        shutil.copytree(tmp_path / "one", tmp_path / "demo" / "episodes")
        result = steersman("report", "tuned", "one", "benchmark", "demo", "--out", "page.html")
        assert result.exit_code == 0
        left_out = "no drive or training, left out; its own page is"
        assert result.stderr == (
            f"tuned: {left_out} tuned/report.html\n"
            f"benchmark: {left_out} benchmark/report.html\n"
            "written: page.html\n"
        )
        assert "demo" in (tmp_path / "page.html").read_text()
        result = steersman("report", "tuned", "--out", "other.html")
        assert result.exit_code == 2
        assert result.stderr == (
            "error: tuned: no drive or training to report; its own page is tuned/report.html\n"
        )
        # What is merely empty may be mistyped.
        (tmp_path / "empty").mkdir()
        result = steersman("report", "one", "empty", "--out", "other.html")
        assert result.stderr.startswith("error: empty: nothing to report")
        assert result.exit_code == 2


class TestTrain:
    @pytest.fixture
    def trained(self, monkeypatch: pytest.MonkeyPatch) -> list[TrainConfig]:
        """What was asked for; nothing is trained."""
        asked: list[TrainConfig] = []

        def train(config: TrainConfig, out: FilePath, reporter: Any, **_: Any) -> SimpleNamespace:
            asked.append(config)
            scores = {"reward_mean": 0.51, "validation_error_mm": 12.3, "off_track_resets": 4.0}
            reporter(TrainRow(steps=500.0, validation_score=0.01345, **scores))
            return SimpleNamespace(policy=out / "policy.onnx")

        monkeypatch.setattr("steersman.learning.train.train", train)
        return asked

    def test_preset_and_settings(self, steersman: Steersman, trained: list[TrainConfig]) -> None:
        result = steersman("train", "demo", "steps=1000", "seed=4", "--out", "agent")
        assert result.exit_code == 0
        assert result.stdout == "agent/policy.onnx\n"
        assert result.stderr.startswith(
            "500/1000 steps: reward 0.51, error 12.3 mm, score 0.01345 (less is better), off"
        )
        assert (trained[0].steps, trained[0].seed) == (1000, 4)

    def test_a_folder_does_not_hide_a_preset(
        self, steersman: Steersman, trained: list[TrainConfig], tmp_path: FilePath
    ) -> None:
        (tmp_path / "demo").mkdir()
        assert steersman("train", "demo", "steps=1000", "--out", "agent").exit_code == 0
        assert trained[0].steps == 1000

    def test_a_file(
        self, steersman: Steersman, trained: list[TrainConfig], tmp_path: FilePath
    ) -> None:
        (tmp_path / "mine.yaml").write_text("steps: 700\n")
        assert steersman("train", "mine.yaml", "--out", "agent").exit_code == 0
        assert trained == [TrainConfig(steps=700)]

    def test_interrupted(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
    ) -> None:
        def train(*_: Any, **__: Any) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("steersman.learning.train.train", train)

        def told() -> str:
            result = steersman("train", "--out", "agent")
            assert result.exit_code == 130
            return str(result.stderr)

        nothing = "interrupted before the first checkpoint: there is nothing to resume in agent"
        policy = "; the policy there is the best until the last validation"
        assert told() == f"{nothing}\n"
        (tmp_path / "agent" / "resume").mkdir(parents=True)
        assert told() == f"{nothing}\n"
        (tmp_path / "agent" / "policy.onnx").touch()
        assert told() == f"{nothing}{policy}\n"
        (tmp_path / "agent" / "resume" / "step_000000700.npz").touch()
        goes_on = "interrupted; --resume goes on from the last checkpoint in agent"
        assert told() == f"{goes_on}{policy}\n"

    @pytest.mark.parametrize("module", ["torch", "stable_baselines3", "torch.utils.tensorboard"])
    def test_a_missing_extra_is_named(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch, module: str
    ) -> None:
        def train(*_: Any, **__: Any) -> None:
            raise ModuleNotFoundError(f"No module named {module!r}", name=module)

        monkeypatch.setattr("steersman.learning.train.train", train)
        result = steersman("train", "--out", "agent")
        assert result.exit_code == 2
        assert result.stderr == (
            f"error: {module}: not installed; this needs the extra 'train': "
            "pip install -c constraints.txt -e '.[train]' in a source checkout, else "
            "pip install 'steersman[train]'\n"
        )

    def test_our_own_missing_module_is_a_fault_of_ours(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def train(*_: Any, **__: Any) -> None:
            raise ModuleNotFoundError("No module named 'steersman.x'", name="steersman.x")

        monkeypatch.setattr("steersman.learning.train.train", train)
        with pytest.raises(ModuleNotFoundError):
            steersman("train", "--out", "agent")

    def test_a_finished_training_says_so(
        self, steersman: Steersman, monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
    ) -> None:
        (tmp_path / "agent" / "checkpoints").mkdir(parents=True)
        (tmp_path / "agent" / "checkpoints" / "step_000000700.npz").touch()
        (tmp_path / "agent" / "policy.onnx").touch()
        (tmp_path / "agent" / "config.yaml").write_text(to_yaml(TrainConfig(steps=700)))
        left = SimpleNamespace(policy=FilePath("agent/policy.onnx"))
        monkeypatch.setattr("steersman.learning.train.learned", lambda *_: left)
        result = steersman("train", "--out", "agent", "--resume")
        assert (result.exit_code, result.stdout) == (0, "agent/policy.onnx\n")
        assert result.stderr == "agent: finished already\n"
        # Assignments alone are laid over what the folder has, not over the defaults.
        result = steersman("train", "seed=1", "--out", "agent", "--resume")
        assert result.exit_code == 2
        assert result.stderr.startswith("error: seed: 1 is given, but agent/config.yaml has 0;")

    @pytest.mark.parametrize(
        ("text", "expected"),
        [("0..4", [0, 1, 2, 3, 4]), ("0,3,7", [0, 3, 7]), ("[9, 1..2]", [9, 1, 2]), ("5", [5])],
    )
    def test_seeds(self, text: str, expected: list[int]) -> None:
        assert split_seeds(["demo", f"seeds={text}", "a=1"]) == (expected, ["demo", "a=1"])

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (["seeds="], "seeds: '' is not a list of seeds; write 0..4 or 0,3,7"),
            (["seeds=1.5"], "seeds: '1.5' is not a list of seeds"),
            (["seeds=-1"], "seeds: '-1' is not a list of seeds"),
            (["seeds=3..1"], "seeds: 3..1 is not a range of seeds"),
            (["seeds=0..99999999999"], "seeds: 0..99999999999 is not a range of seeds"),
            (["seeds=1,0..1"], "seeds: '1,0..1' names a seed twice"),
            (["seeds=1", "seeds=2"], "seeds: given twice: seeds=1 and seeds=2"),
            (["seeds=1", "seed=2"], "seeds=1 and seed=2 contradict each other"),
            (["--jobs", "2"], "--jobs: there is one training"),
            (["--resume", "--overwrite"], "--overwrite and --resume contradict each other"),
        ],
    )
    def test_wrong_seeds(self, steersman: Steersman, words: list[str], message: str) -> None:
        result = steersman("train", *words, "--out", "new")
        assert result.exit_code == 2
        assert result.stderr.startswith(f"error: {message}")


class TestSettings:
    def test_the_first_word_without_a_sign_is_the_name(self) -> None:
        assert commands.split(["a=1", "file", "b.c=x=y"]) == ("file", ["a=1", "b.c=x=y"])
        assert commands.split([]) == (None, [])

    def test_what_would_be_undone_is_refused(self) -> None:
        with pytest.raises(ConfigError, match=r"a: a=pid would undo a\.b\.c=1; put a=pid first"):
            commands.split(["a.b.c=1", "a=pid"])
        commands.split(["a=pid", "a.b.c=1", "ab=2"])

    def test_an_unwritable_folder_is_found(
        self, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def refuse(**_: Any) -> None:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(files.tempfile, "TemporaryFile", refuse)
        with pytest.raises(DataError, match=r"cannot be written \(Permission denied\)"):
            files.out_folder(str(tmp_path))


class TestOutput:
    def test_progress_bars_in_a_terminal(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        with output.share_bar("driving") as progress:
            assert progress is None
        monkeypatch.setattr(sys, "stderr", Terminal(sys.stderr))
        with output.share_bar("driving") as progress:
            assert progress is not None
            progress(0.5)
        with output.steps_bar(10, "training") as update:
            update(5, "reward [m] 0.5")
        with output.steps_bars(10, ["seed 0", "seed 1"]) as update_one:
            update_one("seed 1", 5, "reward 0.7", False)
        printed = capsys.readouterr()
        assert "driving" in printed.err
        assert "reward [m] 0.5" in printed.err
        assert "seed 1: reward 0.7" in printed.err
        assert printed.out == ""

    def test_numbers_never_break(self, capsys: pytest.CaptureFixture[str]) -> None:
        table = output.table("measured", "unit", "run", "late", right=("run", "late"))
        table.add_row("a meaning of many words that is far too long for the line", "m/s^2", *NARROW)
        output.show(table)
        shown = capsys.readouterr().out
        assert all(number in shown for number in NARROW)
        assert max(len(line) for line in shown.splitlines()) <= 80

    def test_a_closed_pipe_ends_quietly(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "stdout", Failing(BrokenPipeError(32, "Broken pipe")))
        with pytest.raises(typer.Exit) as ended:
            output.write("text")
        assert ended.value.exit_code == 141

    def test_a_full_disk_is_said(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(sys, "stdout", Failing(OSError(28, "No space left on device")))
        with pytest.raises(DataError, match=r"^standard output: .* \(No space left on device\)$"):
            output.write("text")

    def test_tables_without_unicode(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        stream = Terminal(sys.stdout)
        stream.encoding = "ascii"
        stream.isatty = lambda: False  # type: ignore[method-assign]
        monkeypatch.setattr(sys, "stdout", stream)
        rows = output.table("a", "b")
        rows.add_row("\u2013", "2")
        output.show(rows)
        printed = capsys.readouterr().out
        assert printed.isascii()
        assert "-+-" in printed


class Failing:
    """A stream that cannot be written, and has no descriptor."""

    encoding = "utf-8"

    def __init__(self, error: OSError) -> None:
        self.error = error

    def write(self, text: str) -> int:
        raise self.error

    def fileno(self) -> int:
        raise io.UnsupportedOperation


def test_ctrl_c_while_the_demo_drives_ends_it(
    steersman: Steersman, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = random_policy(tmp_path)
    original, calls = Simulation.step, iter(range(1000))

    def step(self: Any, command: Any) -> Any:
        if next(calls) == 10:
            raise KeyboardInterrupt
        return original(self, command)

    monkeypatch.setattr(Simulation, "step", step)
    result = steersman("demo", "--policy", str(policy), "--out", "out")
    assert result.exit_code == 130
    assert result.stderr.startswith("interrupted; ")
    assert not [file for file in (tmp_path / "out").rglob("*") if file.is_file()]


def test_without_the_extra_a_training_is_one_line(tmp_path: FilePath) -> None:
    """In a process of its own, where nothing of the extra has been imported yet."""
    requirements = tomllib.loads(
        (FilePath(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    )["project"]["optional-dependencies"]["train"]
    modules = [re.split("[^A-Za-z0-9-]", words)[0].replace("-", "_") for words in requirements]
    assert set(modules) >= {"torch", "threadpoolctl"}
    for missing in (modules, ["threadpoolctl"]):
        code = (
            f"import sys; sys.modules.update(dict.fromkeys({missing}))\n"
            "from steersman.cli import main\n"
            "for command in ('train', 'demo'):\n"
            "    try: main([command, 'steps=700', '--out', 'out'])\n"
            "    except SystemExit as end: print(command, end.code)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.stdout == "train 2\ndemo 2\n", done.stderr
        lines = done.stderr.splitlines()
        assert len(lines) == 2, done.stderr
        for line in lines:
            assert line.startswith("error: ")
            assert (
                "not installed; this needs the extra 'train': pip install -c constraints.txt -e"
                " '.[train]'" in line
            )


def test_check_takes_a_component_or_a_whole_family(steersman: Steersman) -> None:
    one = steersman("check", "schedule.linear", "until=0.5")
    assert (one.exit_code, one.stdout) == (0, "")
    assert one.stderr == "schedule.linear: no findings\n"
    whole = steersman("check", "schedule")
    assert whole.exit_code == 0
    names = [line.partition(":")[0] for line in whole.stderr.splitlines()]
    assert names == [f"schedule.{kind}" for kind in components("schedule")]
    left_out = steersman("check", "vehicle").stderr
    assert "vehicle.file: left out: file: required" in left_out
    given = steersman("check", "schedule", "until=0.5")
    assert given.exit_code == 2
    assert "fields go with one component" in given.stderr
