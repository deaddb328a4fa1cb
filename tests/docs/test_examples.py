"""The examples' programs answer wrong arguments with one line and exit code 2."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path as FilePath

import pytest
from tests.scripts import ROOT

PROGRAMS = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda file: file.name)
@pytest.mark.parametrize("words", [(), ("nothing.fmu", "text.fmu"), ("a", "b", "c", "d"), ("1",)])
def test_wrong_arguments_are_one_line(
    tmp_path: FilePath, program: FilePath, words: tuple[str, ...]
) -> None:
    (tmp_path / "text.fmu").write_text("no archive")
    done = subprocess.run(
        [sys.executable, program, *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith(f"{program.name}: ")
