"""Whatever is done to the bytes of a recording: it is read as it was, or refused with one line."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steersman.errors import DataError
from steersman.logs import MotionLog, read

from . import bags

KINDS = ("mcap", "db3")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Small recordings in both formats."""
    folder = tmp_path_factory.mktemp("whole")
    return {kind: bags.write(folder, bags.drive(10), kind).read_bytes() for kind in KINDS}


def survives(folder: FilePath, kind: str, data: bytes) -> bool:
    """Whether it is refused with one line about the file, or read with finite figures."""
    file = folder / f"damaged.{kind}"
    file.write_bytes(data)
    try:
        log = read(file)
    except DataError as error:
        return str(error).startswith(str(file)) and "\n" not in str(error)
    finite = all(np.all(np.isfinite(column)) for column in log.columns.values())
    return isinstance(log, MotionLog) and len(log) <= 10 and finite


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Where the damaged files go."""
    return tmp_path_factory.mktemp("damaged")


@settings(max_examples=60, deadline=10_000)
@given(
    kind=st.sampled_from(KINDS),
    place=st.floats(0.0, 1.0),
    changes=st.binary(min_size=1, max_size=9),
)
def test_changed_bytes(
    whole: dict[str, bytes], folder: FilePath, kind: str, place: float, changes: bytes
) -> None:
    data = bytearray(whole[kind])
    at = int(place * (len(data) - len(changes)))
    data[at : at + len(changes)] = changes
    assert survives(folder, kind, bytes(data))


@settings(max_examples=40, deadline=10_000)
@given(kind=st.sampled_from(KINDS), cut=st.floats(0.0, 1.0), more=st.binary(max_size=50))
def test_cut_off_and_continued(
    whole: dict[str, bytes], folder: FilePath, kind: str, cut: float, more: bytes
) -> None:
    data = whole[kind]
    assert survives(folder, kind, data[: int(cut * len(data))] + more)


@settings(max_examples=20, deadline=10_000)
@given(kind=st.sampled_from(KINDS), noise=st.binary(max_size=300))
def test_noise_after_the_magic(
    whole: dict[str, bytes], folder: FilePath, kind: str, noise: bytes
) -> None:
    assert survives(folder, kind, whole[kind][:16] + noise)
