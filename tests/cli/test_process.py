"""The installed command as a shell runs it: exit codes, streams, no traceback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path as FilePath

import pytest

from steersman.kernels.compiled import COMPILING

Done = subprocess.CompletedProcess[str]
HEAVY = (
    *("numba", "onnxruntime", "optuna", "pydantic", "scipy", "stable_baselines3"),
    *("torch", "yaml"),
)


def run(
    folder: FilePath, *words: str, shell: str | None = None
) -> subprocess.CompletedProcess[str]:
    """``steersman`` in its own process; ``shell`` goes on after it, like ``| head -1``."""
    command = [sys.executable, "-c", "from steersman.cli import main; main()", *words]
    if shell is not None:
        command = ["bash", "-c", f'set -o pipefail; "$@" {shell}', "bash", *command]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


def test_json_is_all_there_is_on_stdout(tmp_path: FilePath) -> None:
    done = run(tmp_path, "drive", "duration=1", "--json")
    assert done.returncode == 0
    assert set(done.stderr.splitlines()) <= {COMPILING}  # where nothing was driven before
    assert json.loads(done.stdout)["metrics"]["completed"] is True


def test_the_fault_is_all_there_is_on_stderr(tmp_path: FilePath) -> None:
    done = run(tmp_path, "drive", "path.radius=50km")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "error: path.radius: '50km' is not a number; the unit is m, write the value in m\n"
    )


@pytest.mark.skipif(sys.platform == "win32", reason="needs a POSIX shell")
def test_a_reader_that_goes_away_is_no_fault(tmp_path: FilePath) -> None:
    done = run(tmp_path, "list", shell="| true")
    assert done.stderr == ""
    assert done.returncode in {0, 141}


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_is_one_line(tmp_path: FilePath) -> None:
    done = run(tmp_path, "list", shell="> /dev/full")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "standard output: cannot be written (No space left on device)" in done.stderr


def test_nothing_heavy_is_imported_for_the_help(tmp_path: FilePath) -> None:
    code = (
        "import sys; from steersman.cli import main\n"
        "try: main(['--help'])\n"
        f"finally: print(sorted(set(sys.modules) & set({HEAVY})), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "[]\n")
