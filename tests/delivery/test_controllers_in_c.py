"""Controllers in C are the Python ones: drawn observations, whole drives, parameters."""

from __future__ import annotations

import ctypes
import math
import re
import subprocess
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from steersman.cli import app
from steersman.delivery.controller import Setting, translated
from steersman.delivery.controller_package import write_controller
from steersman.delivery.ros2 import write_package
from steersman.errors import ConfigError
from steersman.learning.config import TrainConfig
from steersman.learning.export import export_policy
from steersman.rollout import run

from ..learning.problems import problem
from ..loops import random_net
from ..scripts import script
from .building import COMPILER, SANITISERS, STRICT, needs_compiler

bench = script("benchmarks/controllers_in_c.py")


def made(word: str, folder: FilePath, precision: str = "double") -> Setting:
    setting: Setting = bench.setting_of(word, precision)
    write_controller(setting, folder)
    return setting


def run_vector(setting: Setting, folder: FilePath, *flags: str) -> subprocess.CompletedProcess[str]:
    name = setting.prefix.removeprefix("steersman_")
    sources = [f"test_{name}.c", f"{setting.prefix}.c"]
    words = [COMPILER, *STRICT, *flags, "-ffp-contract=off", "-o", "run", *sources, "-lm"]
    subprocess.run(words, check=True, cwd=folder)
    return subprocess.run([folder / "run"], check=False, capture_output=True, text=True)


@needs_compiler
def test_the_vector_runs_under_sanitisers(tmp_path: FilePath) -> None:
    setting = made("tuned/pid_feedforward", tmp_path)
    code = bench.compiled(setting, tmp_path, (COMPILER, "-O0"))
    change, numbers = code.function("set"), (ctypes.c_double * 20)()
    change.restype = ctypes.c_int
    wanted = ((0, 0.5), (0, -0.5), (0, math.nan), (-1, 0.5), (99, 0.5))
    assert [change(numbers, i, ctypes.c_double(x)) for i, x in wanted] == [1, 0, 0, 0, 0]
    assert list(numbers) == [0.5, *[0.0] * 19]
    said = run_vector(setting, tmp_path, *SANITISERS)
    assert said.returncode == 0, said.stdout + said.stderr
    assert "0 other statuses: as expected" in said.stdout
    file = tmp_path / f"{setting.prefix}.c"  # a vector that nothing can fail proves nothing
    changed = re.sub(r"(_defaults = \{\n    )[^,]+,", r"\g<1>0.9,", file.read_text())
    file.write_text(changed, encoding="ascii")
    assert "NOT AS EXPECTED" in run_vector(setting, tmp_path).stdout


def test_a_number_of_the_design_changes_wherever_a_state_holds_it() -> None:
    word = "supervised/tuned/lqr controller.fallback=pure_pursuit controller.last=pid"
    setting = bench.setting_of(word)._replace(values={"design.candidates.0.state.gains[40]": 0.5})
    inner = setting.start().candidates[0]
    assert inner.state.gains is inner.fresh.gains
    assert inner.state.gains.flat[40] == 0.5


def compared(setting: Setting, folder: FilePath, flag: str, count: int) -> tuple[Any, Any]:
    """The C code of a controller, and how far it is from Python over drawn observations."""
    code = bench.compiled(setting, folder, (COMPILER, flag))
    known = bench.known(setting, bench.drawn_rows(setting, count))
    found = bench.parity(setting, code, known)
    assert found.other_statuses == 0
    assert known.answers[:, 0].std() > 0.01
    return code, found


def away_in_a_drive(word: str, code: Any) -> float:
    """Of the C code from Python, over 5 s."""
    config = bench.drive_of(word, 5.0)
    away: float = bench.drive_difference(config, run(config), code)
    return away


@needs_compiler
@pytest.mark.parametrize("fields", [{}, {"base": {"kind": "stanley"}}], ids=["memory", "residual"])
def test_a_policy_behind_a_predictor(fields: dict[str, Any], tmp_path: FilePath) -> None:
    encoding = {"kind": "extended", "history": 3, "waypoints": 4}
    action = {"action": "residual", "authority": 0.2} if fields else {}
    config = TrainConfig(problem=problem(encoding=encoding, **action, **fields), trim=0.5)
    net = random_net(len(config.problem.layout.scale), 8)
    file = export_policy(net, config, tmp_path, {}, ("Relu", "Tanh"), 0.6 if fields else 1.0)
    setting = made(f"predicted/{file}", tmp_path)
    _, found = compared(setting, tmp_path, "-O0", 400)
    assert found.steering <= 1e-12
    assert 250 < found.usable < 390


SETS: dict[str, Any] = {
    "action": "parameters",
    "base": {"kind": "pid", "feedforward": True},
    "parameters": {"gains.k_p": "0.004..0.4:log", "k_heading": (0.2, 1.0, 3.0)},
    "period": 3,
    "demonstration": {"enabled": False},
}


def policy_file(folder: FilePath, fields: dict[str, Any]) -> FilePath:
    config = TrainConfig(problem=problem(encoding={"kind": "extended", "history": 2}, **fields))
    net = random_net(len(config.problem.layout.scale), 8, actions=2)
    return export_policy(net, config, folder, {})


@needs_compiler
@pytest.mark.parametrize("fields", [SETS, {"joint": True}], ids=["adaptive", "joint"])
def test_a_policy_of_several_actions(fields: dict[str, Any], tmp_path: FilePath) -> None:
    word = f"{policy_file(tmp_path, fields)}"
    setting = made(word, tmp_path)
    said = run_vector(setting, tmp_path, "-O1")  # of joint ones it compares the speed, too
    assert said.returncode == 0, said.stdout
    code, found = compared(setting, tmp_path, "-O1", 400)
    assert found.steering <= 1e-12
    assert 300 < found.usable < 390
    # Python's network is in float here, C's in double.
    assert away_in_a_drive(f"{word} speed=constant_speed", code) <= 1e-5


def setting_a_design(tmp_path: FilePath, base: dict[str, Any], **parameters: Any) -> Setting:
    fields = SETS | {"base": base, "parameters": parameters}
    setting: Setting = bench.setting_of(str(policy_file(tmp_path, fields)))
    return setting


DESIGNS: dict[str, dict[str, Any]] = {
    "Riccati equations over speed": {
        "base": {"kind": "lqr"}, "q_heading": "0.3..3:log", "r": "1..4",
    },
    "a condensed program, its speed chosen": {
        "base": {"kind": "mpc_pid", "horizon": 4, "rate_limit": True}, "v0": (5.0, 18.0),
        "model_error.mass": "0.5..2",
    },
    "tyres and weights of a plan": {
        "base": {"kind": "mpc_delay", "horizon": 4, "estimate_friction": False},
        "model_error.friction": "0.1..1.2:log", "r_change": "0.1..20:log",
    },
}  # fmt: skip


@needs_compiler
@pytest.mark.parametrize("design", DESIGNS)
def test_what_a_policy_sets_is_designed_anew_in_c(design: str, tmp_path: FilePath) -> None:
    setting = setting_a_design(tmp_path, **DESIGNS[design])
    write_controller(setting, tmp_path)
    _, found = compared(setting, tmp_path, "-O1", 200)
    assert found.steering <= (1e-12 if "Riccati" in design else 1e-9)
    assert found.usable > 130


@needs_compiler
def test_a_design_without_a_solution_leaves_the_former(tmp_path: FilePath) -> None:
    limits = {"q_heading": "1e-3..1e22:log", "r": "1e-20..1e3:log"}
    setting = setting_a_design(tmp_path, {"kind": "lqr"}, **limits)
    write_controller(setting, tmp_path)
    _, found = compared(setting, tmp_path, "-O0", 200)
    assert found.steering <= 1e-12
    start = setting.start()
    hopeless = np.array([1.0, -1.0])
    assert start.adjuster.adjust(start.base_state, hopeless) is start.base_state


def test_a_horizon_that_a_policy_sets_has_no_c(tmp_path: FilePath) -> None:
    setting = setting_a_design(tmp_path, {"kind": "mpc"}, horizon="5..40", q="1..2")
    with pytest.raises(ConfigError, match=r"no C code can be made of .*horizon\w*, which changes"):
        translated(setting)


@needs_compiler
@pytest.mark.parametrize("to", ["c", "fmu"])
def test_what_float_is_too_coarse_for_is_refused(to: str, tmp_path: FilePath) -> None:
    words = ["export", "predicted/tuned/pid", "--to", to, "--precision", "single"]
    result = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert re.search(r"test vector fails: .*--precision mixed or double", result.stderr)
    assert not (tmp_path / "out").exists()


def test_ros_has_no_speed(tmp_path: FilePath) -> None:
    with pytest.raises(ConfigError, match="limits the speed"):
        write_package(bench.setting_of("grip_speed"), tmp_path)


@needs_compiler
@pytest.mark.parametrize(
    ("word", "precision"),
    [
        ("tuned/mpc_pid_scheduled", "single"),
        ("grip_speed controller.inner=tuned/stanley speed=constant_speed", "mixed"),
        ("tuned/mpc_pid", "double"),
        ("joint_nmpc controller.horizon=4 controller.found=true speed=constant_speed", "double"),
        ("estimated/predicted/tuned/stanley_cm", "double"),
        ("supervised/tuned/lqr controller.fallback=pure_pursuit controller.last=pid", "mixed"),
    ],
)
def test_drawn_observations_and_a_drive(word: str, precision: str, tmp_path: FilePath) -> None:
    setting = made(word, tmp_path, precision)
    said = run_vector(setting, tmp_path, "-O0")
    assert said.returncode == 0, said.stdout
    code, found = compared(setting, tmp_path, "-O0", 500)
    assert found.steering <= {"single": 1e-6, "mixed": 1e-7, "double": 1e-12}[precision]
    assert (100 if setting.controller.gaps else 300) < found.usable < 490
    if precision == "double":
        assert away_in_a_drive(word, code) <= 1e-12
