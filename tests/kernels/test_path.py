"""Path kernels against their Python source, against closed forms, and at the edges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.special import fresnel

from steersman.kernels import path as kernel
from steersman.paths.segments import Segment, end_pose, from_segments

CLOTHOID = from_segments([Segment(200.0, 0.0, 0.05)])
CIRCLE = from_segments([Segment(math.tau * 20.0, 0.05, 0.05)], closed=True)
MIXED = from_segments(
    [
        Segment(1.3, 0.0, 0.0),
        Segment(12.0, 0.0, 0.06),
        Segment(0.004, 0.06, 0.06),
        Segment(30.0, 0.06, -0.04),
        Segment(17.0, -0.04, 0.0),
    ]
)
TABLES = {"clothoid": CLOTHOID, "circle": CIRCLE, "mixed": MIXED}

kappas = st.floats(-0.06, 0.06)
roads = st.lists(st.tuples(st.floats(0.01, 40.0), kappas, kappas), min_size=1, max_size=5)
arc = st.floats(0.0, 1.0)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_compiled_equals_python(table: kernel.PathTable) -> None:
    length = table.meta[0, kernel.LENGTH]
    for s in np.linspace(-3.0, length + 3.0, 61):
        assert kernel.at(table, 0, s) == pytest.approx(kernel.at.py_func(table, 0, s), abs=1e-13)
        inside = min(max(s, 0.0), length)
        assert kernel.locate(table, 0, inside) == kernel.locate.py_func(table, 0, inside)
        x, y, _, _ = kernel.at(table, 0, s)
        near = kernel.project_near(table, 0, x + 0.3, y - 0.2, s)
        assert near == pytest.approx(
            kernel.project_near.py_func(table, 0, x + 0.3, y - 0.2, s), abs=1e-12
        )
        found = kernel.project(table, 0, x + 0.3, y - 0.2)
        assert found == pytest.approx(kernel.project.py_func(table, 0, x + 0.3, y - 0.2), abs=1e-12)


def test_clothoid_is_the_fresnel_integral() -> None:
    # kappa = c s: x = sqrt(pi / c) C(s / sqrt(pi / c)), y the same with S.
    scale = math.sqrt(math.pi / (0.05 / 200.0))
    for s in np.linspace(0.0, 200.0, 101):
        sine, cosine = fresnel(s / scale)
        x, y, psi, kappa = kernel.at(CLOTHOID, 0, s)
        assert (x, y) == pytest.approx((scale * cosine, scale * sine), abs=1e-9)
        assert psi == pytest.approx(0.5 * 0.05 / 200.0 * s * s, abs=1e-12)
        assert kappa == pytest.approx(0.05 / 200.0 * s, abs=1e-14)


@given(st.floats(0.0, math.tau), st.floats(0.5, 60.0), st.floats(-1.5, 1.5))
def test_projection_on_a_circle(angle: float, radius: float, ahead: float) -> None:
    # The circle's centre is (0, 20); the closest point lies on the ray from there.
    x, y = radius * math.sin(angle), 20.0 - radius * math.cos(angle)
    s, d, psi, kappa = kernel.project_near(CIRCLE, 0, x, y, 20.0 * (angle + ahead))
    assert math.remainder(s - 20.0 * angle, 40.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    assert d == pytest.approx(20.0 - radius, abs=1e-9)
    assert math.remainder(psi - angle, math.tau) == pytest.approx(0.0, abs=1e-8)
    assert kappa == pytest.approx(0.05)
    s, d = kernel.project(CIRCLE, 0, x, y)
    assert math.remainder(s - 20.0 * angle, 40.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    assert d == pytest.approx(20.0 - radius, abs=1e-9)


@settings(max_examples=60)
@given(roads, arc, st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_projection_undoes_evaluation(
    road: list[tuple[float, float, float]], share: float, d: float, ahead: float
) -> None:
    table = from_segments([Segment(*part) for part in road])
    s = share * table.meta[0, kernel.LENGTH]
    x, y, psi, _ = kernel.at(table, 0, s)
    x, y = x - d * math.sin(psi), y + d * math.cos(psi)
    found, side, tangent, _ = kernel.project_near(table, 0, x, y, s + ahead)
    assert (found, side, tangent) == pytest.approx((s, d, psi), abs=1e-7)


@settings(max_examples=60)
@given(roads, arc, st.floats(1e-4, 0.05))
def test_arc_length_and_tangent(
    road: list[tuple[float, float, float]], share: float, ds: float
) -> None:
    table = from_segments([Segment(*part) for part in road])
    s = share * table.meta[0, kernel.LENGTH]
    a, b = kernel.at(table, 0, s), kernel.at(table, 0, s + ds)
    assert math.dist(a[:2], b[:2]) == pytest.approx(ds, abs=1e-7)
    middle = kernel.at(table, 0, s + 0.5 * ds)
    # Curvature may jump between segments by 0.12 at most.
    assert abs(b[2] - a[2] - middle[3] * ds) < 0.13 * ds


@settings(max_examples=60)
@given(roads)
def test_node_positions_do_not_drift(road: list[tuple[float, float, float]]) -> None:
    segments = [Segment(*part) for part in road]
    table = from_segments(segments)
    end = kernel.at(table, 0, table.meta[0, kernel.LENGTH])
    assert end[:3] == pytest.approx(tuple(end_pose(segments)), abs=2e-9)


@settings(max_examples=60)
@given(roads, st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
@example([(1.0, -0.03125, 0.0)], -0.0, -33.0)
def test_no_sampled_point_is_closer(
    road: list[tuple[float, float, float]], x: float, y: float
) -> None:
    table = from_segments([Segment(*part) for part in road])
    length = table.meta[0, kernel.LENGTH]
    s, d = kernel.project(table, 0, x, y)
    nearest = min(
        math.dist((x, y), kernel.at(table, 0, value)[:2]) for value in np.linspace(0, length, 200)
    )
    # Beyond a bend's centre many points are about as near: which of them is found decides nothing.
    assert abs(d) <= nearest + 1e-4
    foot = kernel.at(table, 0, s)
    assert math.dist((x, y), foot[:2]) == pytest.approx(abs(d), abs=1e-6)


def test_parallel_stretches() -> None:
    # A hairpin of 1.2 m between its branches: the closest node is often on the wrong one.
    table = from_segments(
        [Segment(101.0, 0.0, 0.0), Segment(0.6 * math.pi, 1 / 0.6, 1 / 0.6), Segment(99.7, 0, 0)]
    )
    for x in np.linspace(1.0, 99.0, 333):
        assert kernel.project(table, 0, x, 0.55) == pytest.approx((x, 0.55), abs=1e-9)
        s, d = kernel.project(table, 0, x, 0.65)
        assert (s, d) == pytest.approx((101.0 + 0.6 * math.pi + 101.0 - x, 0.55), abs=1e-9)


@pytest.mark.parametrize("near", [-0.3, -140.0, 125.66, 125.664, 126.0, 700.0])
def test_near_beyond_the_joint(near: float) -> None:
    length = CIRCLE.meta[0, kernel.LENGTH]
    x, y, _, _ = kernel.at(CIRCLE, 0, near + 0.4)
    s, d, _, _ = kernel.project_near(CIRCLE, 0, x, y, near)
    assert 0.0 <= s < length
    assert math.remainder(s - near - 0.4, length) == pytest.approx(0.0, abs=1e-8)
    assert d == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, -1e300])
@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_absurd_input_reads_no_foreign_memory(table: kernel.PathTable, bad: float) -> None:
    rows = range(len(table.pieces))
    assert kernel.locate(table, 0, bad) in rows
    kernel.at(table, 0, bad)
    kernel.project_near(table, 0, bad, 0.0, 0.0)
    kernel.project_near(table, 0, 0.0, 0.0, bad)
    kernel.project(table, 0, bad, bad)
    if math.isnan(bad):
        assert math.isnan(kernel.at(table, 0, bad)[0])
        assert math.isnan(kernel.project(table, 0, bad, 0.0)[1])


def test_every_node_is_found() -> None:
    for table in TABLES.values():
        for row, s in enumerate(table.pieces[:, kernel.S0]):
            assert kernel.locate(table, 0, s) == row
            assert kernel.locate(table, 0, np.nextafter(s, -1.0)) == max(row - 1, 0)
