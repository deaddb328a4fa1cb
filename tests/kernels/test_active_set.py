"""The dual active-set method against DAQP, and where there is no solution."""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np
import pytest

from steersman.controllers.quadratic import optimum
from steersman.kernels import active_set
from steersman.types import FloatArray

N = 12
CHANGES = np.eye(N) - np.eye(N, k=-1)


class Program(NamedTuple):
    hessian: FloatArray
    linear: FloatArray
    rows: FloatArray
    lower: FloatArray
    upper: FloatArray


def drawn(seed: int) -> Program:
    """A program like those of the MPCs: limits of the angle, and of its changes."""
    rng = np.random.default_rng(seed)
    forced = np.tril(rng.normal(size=(N, N)))
    hessian = forced.T @ forced + rng.uniform(1e-3, 0.1) * np.eye(N)
    upper = np.repeat(rng.uniform([0.1, 0.01], [1.2, 0.2]), N)
    lower, first = -upper, np.eye(2 * N)[N] * rng.uniform(-0.1, 0.1)
    linear = 10.0 ** rng.uniform(-3.0, 1.0) * rng.normal(size=N)
    return Program(hessian, linear, CHANGES, lower + first, upper + first)


def test_it_finds_what_daqp_finds() -> None:
    active = 0
    for seed in range(300):
        p = drawn(seed)
        expected, _, flag, _ = daqp.solve(p.hessian, p.linear, p.rows, p.upper, p.lower)
        found = optimum(*p)
        assert flag in {1, 2}
        assert found is not None
        assert found == pytest.approx(expected, abs=1e-7)
        active += bool(abs(found + np.linalg.solve(p.hessian, p.linear)).max() > 1e-3)
    assert active > 200


def test_the_root_is_that_of_the_inverse() -> None:
    p, root = drawn(1), np.empty((N, N))
    assert active_set.inverse_root(p.hessian, root)
    assert root @ root.T == pytest.approx(np.linalg.inv(p.hessian), rel=1e-9)
    assert not np.tril(root, -1).any()
    assert not active_set.inverse_root(-p.hessian, root)


def test_limits_that_contradict_each_other_have_no_solution() -> None:
    p = drawn(2)
    lower = p.lower.copy()
    lower[N - 1] = 3.0 * p.upper[N - 1]
    assert optimum(*p._replace(lower=lower)) is None
    lower, upper = p.lower.copy(), p.upper.copy()
    lower[:N], upper[:N] = 1.0, 2.0  # farther than the first change reaches
    assert optimum(*p._replace(lower=lower, upper=upper)) is None


def test_numbers_that_are_not_finite_have_no_solution() -> None:
    p = drawn(3)
    for name in ("hessian", "linear"):
        wrong = getattr(p, name).copy()
        wrong.flat[0] = np.nan
        assert optimum(*p._replace(**{name: wrong})) is None
