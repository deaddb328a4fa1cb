"""Controllers in C are the Python ones: drawn observations, whole drives, parameters."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path as FilePath

import pytest

from steersman.delivery.controller import Setting
from steersman.delivery.controller_package import write_controller

from ..scripts import script
from .building import COMPILER, SANITISERS, STRICT, needs_compiler

bench = script("benchmarks/controllers_in_c.py")


def made(word: str, folder: FilePath, *, single: bool = False) -> Setting:
    setting: Setting = bench.setting_of(word, single)
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
    said = run_vector(setting, tmp_path, *SANITISERS)
    assert said.returncode == 0, said.stdout + said.stderr
    assert "0 other statuses: as expected" in said.stdout
    file = tmp_path / f"{setting.prefix}.c"  # a vector that nothing can fail proves nothing
    changed = re.sub(r"(_defaults = \{\n    )[^,]+,", r"\g<1>0.9,", file.read_text())
    file.write_text(changed, encoding="ascii")
    assert "NOT AS EXPECTED" in run_vector(setting, tmp_path).stdout


@needs_compiler
@pytest.mark.parametrize(
    ("word", "single"),
    [
        ("tuned/lqr", True),
        ("tuned/mpc_pid_scheduled", False),
        ("estimated/predicted/tuned/stanley_cm", False),
        ("supervised/tuned/lqr controller.fallback=pure_pursuit controller.last=pid", False),
    ],
)
def test_drawn_observations_and_a_drive(word: str, single: bool, tmp_path: FilePath) -> None:
    setting = made(word, tmp_path, single=single)
    code = bench.compiled(setting, tmp_path, (COMPILER, "-O0"))
    known = bench.known(setting, bench.drawn_rows(setting, 500))
    found = bench.parity(setting, code, known)
    assert found.other_statuses == 0
    assert found.steering <= (1e-6 if single else 1e-12)
    assert (100 if setting.controller.gaps else 300) < found.usable < 490
    if not single:
        assert bench.drive_difference(word, code, duration=5) <= 1e-12
