"""The example of a plug-in, installed as a package and used by name."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path as FilePath

import pytest

from steersman.controllers.policy import Policy
from steersman.errors import DataError
from steersman.vehicles import CarlaModel3

from .pages import ROOT

EXAMPLE = ROOT / "examples" / "steersman_example_plugin"
PAGE = ROOT / "docs" / "plugins.md"
QUOTED = re.compile(r"<!-- from (\S+) -->\s*```\w+\n(.*?)^```", re.MULTILINE | re.DOTALL)
# Several commands in one process, a list of words each.
COMMANDS = """
import json, sys
from steersman.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit as end:
        if end.code:
            raise
    print("---")
"""
# The demonstrator is shown at every step; who does as it shows, stays on the road.
IMITATE = """
import gymnasium, numpy, steersman
problem = {"roads": ["stadium"], "demonstration": {"controller": "vector_field"}}
env = gymnasium.make("steersman/PathFollowing-v0", problem=problem)
_, info = env.reset(seed=0)
for _ in range(100):
    action = numpy.array([info["demo_action"]], numpy.float32)
    _, _, terminated, _, info = env.step(action)
    assert not terminated
print(info["demo_action"][0])
"""


TRAINED = [
    "problem.encoding.kind=list",
    "problem.encoding.features=[road_curvatures, v_x, yaw_rate, steer, lateral_error, "
    "heading_error, last_command, {kind: lateral_acceleration_ahead, waypoints: 4}]",
    "problem.task.terms=[{kind: calm, weight: 0.02}]",
    "steps=400",
    "agent={hidden: [8, 8], batch: 16, buffer: 500, vehicles: 4, learning_starts: 100}",
    "validation={vehicles: 2, interval: 200}",
    "problem.episode_time=4.0",
]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """A folder into which pip installed the package, without a network."""
    source, target = (tmp_path_factory.mktemp(name) / "plugin" for name in ("source", "target"))
    shutil.copytree(EXAMPLE, source)  # building leaves files beside what it builds
    offline = ["--no-index", "--no-deps", "--no-build-isolation", "--quiet"]
    words = [sys.executable, "-m", "pip", "install", *offline, "--target", str(target), str(source)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


def python(installed: FilePath, *words: str, cwd: FilePath = ROOT) -> str:
    """Output of Python with the package on its path."""
    paths = os.pathsep.join([str(installed), str(ROOT / "src")])
    environment = {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run(
        [sys.executable, *words], cwd=cwd, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def commands(installed: FilePath, *each: list[str]) -> list[str]:
    """What each command prints."""
    return python(installed, "-c", COMMANDS, json.dumps(each)).split("---\n")[:-1]


def test_commands_know_it(installed: FilePath) -> None:
    words = ["controller=vector_field", "path=stadium", "vehicle=kei_car", "laps=1", "--json"]
    names = ["controller.vector_field", "path.stadium", "vehicle.kei_car"]
    driven, shown, *checked = commands(
        installed,
        ["drive", *words],
        ["show", "controller", "vector_field"],
        *(["check", name] for name in names),
    )
    assert checked == ["", "", ""]
    found = json.loads(driven)
    assert found["config"]["path"]["kind"] == "stadium"
    assert found["metrics"]["completed"]
    assert found["metrics"]["rms_lateral_error_m"] < 0.3
    assert "Follows the course" in shown


def test_its_own_tests_and_the_contract_hold(installed: FilePath) -> None:
    words = [
        "-m",
        "pytest",
        "-q",
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        "-k",
        "vector_field or plugin",
    ]
    tests = ["tests/test_contracts.py", str(EXAMPLE / "tests")]
    told = python(installed, *words, *tests)
    counted = re.search(r"(\d+) passed", told)
    assert counted is not None
    assert int(counted[1]) > 17, told


def test_it_demonstrates(installed: FilePath) -> None:
    assert abs(float(python(installed, "-c", IMITATE))) < 1.0


def test_its_feature_and_reward_train_and_are_delivered(
    installed: FilePath, tmp_path: FilePath
) -> None:
    out, delivered = tmp_path / "trained", tmp_path / "c"
    policy = f"controller.file={out / 'policy.onnx'}"
    commands(
        installed,
        ["train", *TRAINED, "--out", str(out)],
        ["drive", "controller=policy", policy, "path=circle", "duration=1"],
        ["export", str(out), "--to", "c", "--out", str(delivered)],
    )
    source = (delivered / "steersman_trained.c").read_text(encoding="utf-8")
    assert "lateralaccelerationahead_value(" in source
    with pytest.raises(DataError) as fault:
        Policy(file=str(out / "policy.onnx")).init(CarlaModel3(), 0.05)
    assert "unknown feature 'lateral_acceleration_ahead'" in str(fault.value)
    assert "steersman-example-plugin 0.1.0" in str(fault.value)


def test_without_it_nothing_of_it_is_known() -> None:
    from steersman.config import components

    assert "vector_field" not in components("controller")


@pytest.mark.parametrize(("name", "text"), QUOTED.findall(PAGE.read_text(encoding="utf-8")))
def test_the_page_quotes_what_is_there(name: str, text: str) -> None:
    assert text in (EXAMPLE / name).read_text(encoding="utf-8")


def test_the_page_quotes_every_part() -> None:
    names = {name for name, _ in QUOTED.findall(PAGE.read_text(encoding="utf-8"))}
    assert len(names) >= 4
