"""Compiled code survives a cache that is damaged, or that cannot be written."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import pytest

from steersman.kernels import compiled

SOURCE = """
from steersman.kernels.compiled import kernel

@kernel
def doubled(x):
    return 2.0 * x
"""


@pytest.fixture(autouse=True)
def _nothing_told() -> Iterator[None]:
    compiled.tell.cache_clear()
    yield
    compiled.tell.cache_clear()


def _fresh(file: FilePath) -> Any:
    """The kernel as a new process imports it."""
    spec = importlib.util.spec_from_file_location("kernels_of_a_test", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.doubled


def _file(folder: FilePath) -> FilePath:
    file = folder / "kernels_of_a_test.py"
    file.write_text(SOURCE)
    assert _fresh(file)(2.0) == 4.0
    assert list(folder.rglob("*.nbc"))
    return file


@pytest.mark.parametrize("kind", ["nbc", "nbi"])
@pytest.mark.parametrize("content", [b"", b"\x80\x04", b"cos\nnothing\n.", b"x" * 400])
def test_a_damaged_cache_is_one_line_and_mended(
    tmp_path: FilePath, caplog: pytest.LogCaptureFixture, kind: str, content: bytes
) -> None:
    file = _file(tmp_path)
    for cached in tmp_path.rglob(f"*.{kind}"):
        cached.write_bytes(content)
    assert _fresh(file)(3.0) == 6.0
    assert [record.message for record in caplog.records] == [
        compiled.COMPILING,
        f"damaged files in {tmp_path / '__pycache__'} are compiled anew",
    ]
    compiled.tell.cache_clear()
    caplog.clear()
    again = _fresh(file)
    assert again(4.0) == 8.0
    assert again.stats.cache_hits
    assert not caplog.records


def test_compiling_is_told_once_wherever_standard_error_goes(tmp_path: FilePath) -> None:
    (tmp_path / "kernels_of_a_test.py").write_text(SOURCE)
    code = "import kernels_of_a_test; kernels_of_a_test.doubled(2.0)"
    told = []
    for _ in range(2):  # the second finds what the first compiled
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        told.append(done.stderr.splitlines())
    assert told == [[compiled.COMPILING], []]


def test_without_a_folder_for_the_cache_it_compiles_at_every_start(
    tmp_path: FilePath, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("numba.core.caching.CacheImpl._locator_classes", [])
    file = tmp_path / "kernels_of_a_test.py"
    file.write_text(SOURCE)
    assert _fresh(file)(2.0) == 4.0
    assert _fresh(file)(3.0) == 6.0
    assert [record.message for record in caplog.records] == [
        "no folder for compiled code can be written, so it is compiled at every start; "
        "NUMBA_CACHE_DIR names one"
    ]


def test_a_cache_that_fills_the_disk_costs_nothing(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    file = tmp_path / "kernels_of_a_test.py"
    file.write_text(SOURCE)
    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)
    assert _fresh(file)(2.0) == 4.0
