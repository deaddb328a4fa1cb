"""The way from a tuning to a running binary on docs/deploy.md, with fewer trials."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path as FilePath

import pytest
from typer.testing import CliRunner

from steersman.cli import app

from ..scripts import script
from .building import needs_compiler

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
