"""The way from a tuning to a running binary on docs/deploy.md, with fewer trials."""

from __future__ import annotations

import json
import shlex
import subprocess
from pathlib import Path as FilePath

import numpy as np
import pytest
from typer.testing import CliRunner

from steersman.cli import app
from steersman.config import resolve
from steersman.types import Observation
from steersman.vehicles import CarlaModel3

from ..scripts import script
from .building import COMPILER, STRICT, needs_compiler

page = script("benchmarks/deploy_walk.py")


def run(line: str) -> None:
    words = shlex.split(line.replace("--trials 20", "--trials 1"))
    if words[0] == "steersman":
        result = CliRunner().invoke(app, words[1:])
        assert result.exit_code == 0, result.output
    else:
        subprocess.run(words, check=True, capture_output=True)


@needs_compiler
def test_the_page_leads_to_a_binary_that_drives_as_python_does(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    kinds = [step["command"].split()[0] for step in page.walk(tmp_path, run)]
    assert kinds == ["steersman", "steersman", "make", "cc", "steersman", "steersman"]
    binary, python = page.driven(tmp_path)
    assert page.apart(binary, python) < 1e-9
    assert abs(python["steer_command"]).max() > 0.05


@needs_compiler
@pytest.mark.parametrize("precision", ["double", "mixed", "single"])
def test_the_program_takes_the_numbers_of_every_precision(
    precision: str, tmp_path: FilePath
) -> None:
    run(f"steersman export tuned/lqr --to c --name steering --precision {precision}"
        f" --out {tmp_path}")  # fmt: skip
    flags, made = (*STRICT, "-O1", "-I", str(tmp_path)), tmp_path / "steersman_steering.c"
    words = [COMPILER, *flags, str(page.PROGRAM), str(made), "-lm", "-o", str(tmp_path / "steer")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    ahead = np.column_stack([2.0 * np.arange(15.0), np.full(15, -0.2)])
    seen = Observation(0.0, 0.2, 0.01, 9.0, 0.0, 0.0, 0.0, 0.0, ahead, 2.0)
    controller = resolve("controller", "tuned/lqr")
    expected = controller.decide(controller.init(CarlaModel3(), 0.05), seen)[0]
    line = {"drive": 0, **seen._asdict(), "preview": ahead.tolist(), "wished": []}
    said = subprocess.run(
        [tmp_path / "steer"], input=f"{json.dumps(line)}\n", capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert json.loads(said.stdout)["steer"] == pytest.approx(expected, abs=1e-6)
    assert abs(expected) > 0.01
