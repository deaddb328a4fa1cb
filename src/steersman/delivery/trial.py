"""Compiles a delivery where a C compiler is at hand, and runs its test vector."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path as FilePath

from steersman.errors import DataError, one_line

COMPILERS = ("cc", "gcc", "clang")
_LONGEST = 120.0


def try_out(source: FilePath) -> str:
    """Says how the test vector beside a policy's C source went, or why it could not be run here.

    Raises:
        DataError: its answers are not those that are expected.
    """
    compiler = next((found for found in map(shutil.which, COMPILERS) if found), None)
    folder, vector = source.parent, source.name.replace("steersman", "test", 1)
    by_hand = f"make -C {folder} test"
    if compiler is None:
        return f"not compiled: there is no C compiler here; where there is one: {by_hand}"
    with tempfile.TemporaryDirectory() as scratch:
        program = FilePath(scratch, "test")
        files = [str(each.resolve()) for each in (source, source.with_name(vector))]
        words = [compiler, "-std=c99", "-O1", "-o", str(program), *files, "-lm"]
        try:
            made = _run(words)
            if made.returncode != 0:
                why = one_line(made.stderr)[:160]
                return f"not compiled: {FilePath(compiler).name} says {why}; by hand: {by_hand}"
            said = _run([str(program)])
        except (OSError, subprocess.SubprocessError) as error:
            return f"not tried: {one_line(str(error))[:160]}; by hand: {by_hand}"
    if said.returncode != 0:
        raise DataError(f"{folder}: the test vector fails: {one_line(said.stdout)[:160]}")
    return f"{one_line(said.stdout)} (again: {by_hand})"


def _run(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=_LONGEST)
