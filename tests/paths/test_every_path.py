"""What holds for every path: its contract, and what belongs to some."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from steersman.config import components, resolve
from steersman.contracts.path import apart, aside, offset
from steersman.contracts.path import check as contract
from steersman.paths.base import PathComponent

from .conftest import SHAPES


def test_all_kinds_are_tried() -> None:
    # Their files are other people's: tests of their own write some.
    elsewhere = {"json", "lanelet2", "log", "tum_reference"}
    tried = {str(fields["kind"]) for fields in SHAPES.values()}
    assert tried | elsewhere >= set(components("path"))


@pytest.mark.parametrize("check", contract.checks, ids=lambda check: check.__name__)
def test_paths_keep_their_contract(
    path: PathComponent, check: Callable[[PathComponent], Iterator[str]]
) -> None:
    assert list(check(path)) == []


def test_projection_undoes_evaluation(plain_path: PathComponent) -> None:
    path = plain_path
    rng = np.random.default_rng(1)
    for s in rng.uniform(0.0, path.length, 150):
        d = offset(path, s, rng)
        found, side = path.project(*aside(path, s, d))
        assert apart(path, found, s) < 1e-6
        assert side == pytest.approx(d, abs=1e-6)


def test_copies_do_not_keep_the_old_geometry() -> None:
    circle = resolve("path", "circle")
    assert isinstance(circle, PathComponent)
    assert circle.length == pytest.approx(100.0 * math.pi)
    assert circle.model_copy(update={"radius": 10.0}).length == pytest.approx(20.0 * math.pi)
