"""What holds for every path: geometry fits together, projection undoes evaluation."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

from steersman.config import components, dump, resolve
from steersman.kernels import path as kernel
from steersman.paths.base import PathComponent
from steersman.paths.segments import MAX_PIECE, MAX_TURN

from .conftest import SHAPES


def apart(path: PathComponent, a: float, b: float) -> float:
    """Difference of arc lengths, modulo the length on closed paths."""
    return abs(math.remainder(a - b, path.length)) if path.closed else abs(a - b)


def aside(path: PathComponent, s: float, d: float) -> tuple[float, float]:
    """The point at lateral offset d beside s."""
    x, y, psi, _ = path.at(s)
    return x - d * math.sin(psi), y + d * math.cos(psi)


def offset(path: PathComponent, s: float, rng: np.random.Generator) -> float:
    """An offset of up to 1.5 m, or as far as the curve of radius 1 / kappa allows."""
    return rng.uniform(-1.0, 1.0) * min(1.5, 0.8 / max(abs(path.at(s).kappa), 1e-9))


def test_all_kinds_are_tried() -> None:
    assert {str(fields["kind"]) for fields in SHAPES.values()} >= set(components("path"))


def test_load_undoes_dump(path: PathComponent) -> None:
    assert path.length > 0.0
    again = resolve("path", dump(path))
    assert again == path
    assert isinstance(again, PathComponent)
    assert hash(again) == hash(path)
    assert again.length == path.length
    # Once more, now that both hold their geometry.
    assert again == path
    assert np.array_equal(again.table.pieces, path.table.pieces)


def test_survives_pickling(path: PathComponent) -> None:
    again = pickle.loads(pickle.dumps(path))
    assert again == path
    assert again.at(1.0) == path.at(1.0)


def test_pieces_are_short_enough(path: PathComponent) -> None:
    pieces = path.table.pieces
    sizes = np.diff(pieces[:, kernel.S0], append=path.length)
    ends = pieces[:, kernel.KAPPA0] + sizes * pieces[:, kernel.SHARPNESS]
    turn = sizes * np.maximum(np.abs(pieces[:, kernel.KAPPA0]), np.abs(ends))
    assert np.all(sizes > 0.0)
    assert np.max(sizes) <= MAX_PIECE * (1.0 + 1e-6)
    assert np.max(turn) <= MAX_TURN * (1.0 + 1e-6)


def test_pieces_join(path: PathComponent) -> None:
    pieces = path.table.pieces
    sizes = np.diff(pieces[:, kernel.S0], append=path.length)
    ends = np.array([kernel._inside(pieces, i, u) for i, u in enumerate(sizes)])
    rows = slice(None) if path.closed else slice(-1)
    starts = np.roll(pieces, -1, axis=0)
    gap = np.hypot(ends[:, 0] - starts[:, kernel.X0], ends[:, 1] - starts[:, kernel.Y0])
    turn = np.remainder(ends[:, 2] - starts[:, kernel.PSI0] + np.pi, 2.0 * np.pi) - np.pi
    assert np.max(gap[rows]) < 1e-7
    assert np.max(np.abs(turn[rows])) < 1e-9


def test_curvature_is_continuous(path: PathComponent) -> None:
    pieces = path.table.pieces
    sizes = np.diff(pieces[:, kernel.S0], append=path.length)
    ends = pieces[:, kernel.KAPPA0] + sizes * pieces[:, kernel.SHARPNESS]
    jumps = np.abs(ends - np.roll(pieces[:, kernel.KAPPA0], -1))
    # Exact for segments; fitted curves jump by the square of their short pieces.
    assert np.max(jumps if path.closed else jumps[:-1]) < 1e-4


def test_projection_undoes_evaluation(plain_path: PathComponent) -> None:
    path = plain_path
    rng = np.random.default_rng(1)
    for s in rng.uniform(0.0, path.length, 150):
        d = offset(path, s, rng)
        found, side = path.project(*aside(path, s, d))
        assert apart(path, found, s) < 1e-6
        assert side == pytest.approx(d, abs=1e-6)


def test_projection_near_undoes_evaluation(path: PathComponent) -> None:
    rng = np.random.default_rng(2)
    for s in rng.uniform(0.0, path.length, 150):
        d = offset(path, s, rng)
        near = s + rng.uniform(-2.0, 2.0)
        found, side = path.project(*aside(path, s, d), near=near)
        assert apart(path, found, s) < 1e-6
        assert side == pytest.approx(d, abs=1e-6)


def test_projection_at_the_joint(path: PathComponent) -> None:
    for s in (-0.5, -1e-9, 0.0, 1e-9, 0.5):
        for lap in (0.0, path.length):
            target = s + lap
            place = aside(path, target, 0.4)
            found, d = path.project(*place, near=target + 0.3)
            assert apart(path, found, target) < 1e-6
            assert d == pytest.approx(0.4, abs=1e-6)
            if path.closed:
                assert 0.0 <= found < path.length
            found, _ = path.project(*place, near=target - 0.3)
            assert apart(path, found, target) < 1e-6


def test_arc_length_is_arc_length(path: PathComponent) -> None:
    ds = 0.01
    for s in np.linspace(0.0, path.length - ds, 97):
        a, b = path.at(s), path.at(s + ds)
        # The chord of an arc is shorter by its third power.
        assert math.dist(a[:2], b[:2]) == pytest.approx(ds, abs=1e-7)


def test_tangent_and_curvature_are_derivatives(path: PathComponent) -> None:
    ds = 1e-4
    for s in np.linspace(0.013, path.length - 0.017, 97):
        a, m, b = path.at(s - ds), path.at(s), path.at(s + ds)
        slope = math.atan2(b.y - a.y, b.x - a.x)
        assert math.remainder(slope - m.psi, math.tau) == pytest.approx(0.0, abs=1e-6)
        assert (b.psi - a.psi) / (2.0 * ds) == pytest.approx(m.kappa, abs=2e-5)


def test_open_paths_go_on_straight(path: PathComponent) -> None:
    start, end, far = path.at(0.0), path.at(path.length), path.at(path.length + 3.0)
    if path.closed:
        assert math.dist(start[:2], end[:2]) < 1e-9
        assert path.at(-1.0) == path.at(path.length - 1.0)
        return
    assert far.x == pytest.approx(end.x + 3.0 * math.cos(end.psi), abs=1e-9)
    assert far.y == pytest.approx(end.y + 3.0 * math.sin(end.psi), abs=1e-9)
    assert far.psi == end.psi
    assert far.kappa == 0.0
    assert path.project(far.x, far.y)[0] == pytest.approx(path.length + 3.0, abs=1e-6)
    before = path.at(-2.0)
    assert path.project(before.x, before.y)[0] == pytest.approx(-2.0, abs=1e-6)


def test_copies_do_not_keep_the_old_geometry() -> None:
    circle = resolve("path", "circle")
    assert isinstance(circle, PathComponent)
    assert circle.length == pytest.approx(100.0 * math.pi)
    assert circle.model_copy(update={"radius": 10.0}).length == pytest.approx(20.0 * math.pi)
