"""Lanes' centres: every geometry against its formula, and against CARLA's own reader."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import fresnel

from steersman.errors import DataError
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.segments import Segment
from steersman.types import Pose

from . import xodr_maps as maps
from .xodr_maps import WIDTH, cubic, geometry, lane, section, single

START = Pose(100.0, -50.0, 0.6)
HERE = Pose(0.0, 0.0, 0.0)


def followed(tmp_path: FilePath, text: str, **words: Any) -> OpenDrivePath:
    file = maps.write(tmp_path / "map.xodr", text)
    return OpenDrivePath(**{"file": file, "road": "1", **words})


def bent(segment: Segment, **words: Any) -> str:
    view, length, _ = maps.plan([segment], START)
    return single(view, length, **words)


def test_line(tmp_path: FilePath) -> None:
    path = followed(tmp_path, bent(Segment(30.0, 0.0, 0.0)))
    assert path.length == pytest.approx(30.0)
    c, s = math.cos(START.psi), math.sin(START.psi)
    half = WIDTH / 2.0  # the lane lies to the right
    expected = (START.x + 10.0 * c + half * s, START.y + 10.0 * s - half * c, START.psi, 0.0)
    assert path.at(10.0) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("kappa", [0.05, -0.05])
@pytest.mark.parametrize("number", [1, -1])
def test_arc(tmp_path: FilePath, kappa: float, number: int) -> None:
    path = followed(tmp_path, bent(Segment(30.0, kappa, kappa)), lane=number)
    # A lane at offset t of an arc is an arc of radius 1 / kappa - t, driven back on the left.
    radius = 1.0 / kappa - number * WIDTH / 2.0
    assert path.length == pytest.approx(30.0 * kappa * radius, abs=1e-8)
    for s in np.linspace(0.0, path.length, 7):
        assert path.at(s).curvature == pytest.approx(-number / radius, abs=1e-9)
    end = path.at(path.length if number < 0 else 0.0)
    turned = START.psi + 30.0 * kappa + (0.0 if number < 0 else math.pi)
    assert math.remainder(end.psi - turned, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_spiral(tmp_path: FilePath) -> None:
    lanes = section(0.0, "", lane(-1, cubic("width", "sOffset", 0.0, 0.0)))
    path = followed(tmp_path, bent(Segment(60.0, 0.0, 0.04), lanes=lanes))
    # Curvature grows by 0.04 / 60 per metre: x and y are Fresnel integrals (Abramowitz, 7.3).
    scale = math.sqrt(math.pi / (0.04 / 60.0))
    for s in (0.0, 17.0, 42.0, 60.0):
        y, x = (scale * float(value) for value in fresnel(s / scale))
        c, n = math.cos(START.psi), math.sin(START.psi)
        there = path.at(s)
        assert there.x == pytest.approx(START.x + c * x - n * y, abs=1e-7)
        assert there.y == pytest.approx(START.y + n * x + c * y, abs=1e-7)
        assert there.curvature == pytest.approx(0.04 / 60.0 * s, abs=1e-6)


POLY = (0.0, 0.05, 0.004, -5e-5)  # a to d


def poly(u: float) -> tuple[float, float]:
    a, b, c, d = POLY
    return a + u * (b + u * (c + u * d)), b + u * (2 * c + 3 * d * u)


def test_poly3_runs_by_arc_length(tmp_path: FilePath) -> None:
    length = quad(lambda u: math.hypot(1.0, poly(u)[1]), 0.0, 50.0, epsabs=1e-12)[0]
    shape = '<poly3 a="{}" b="{}" c="{}" d="{}"/>'.format(*POLY)
    thin = section(0.0, "", lane(-1, cubic("width", "sOffset", 0.0, 0.0)))
    path = followed(tmp_path, single(geometry(0.0, HERE, length, shape), length, thin))
    assert path.length == pytest.approx(length, abs=1e-6)
    for u in (0.0, 13.0, 31.0, 50.0):
        s = quad(lambda v: math.hypot(1.0, poly(v)[1]), 0.0, u, epsabs=1e-12)[0]
        assert path.at(s)[:2] == pytest.approx((u, poly(u)[0]), abs=1e-6)
        assert path.at(s).psi == pytest.approx(math.atan(poly(u)[1]), abs=1e-6)


# A curve whose parameter is far from its arc length: slow, then fast.
U, V = (0.0, 0.6, 0.01, 5e-5), (0.0, 0.0, 0.006, -4e-5)
SPAN = 40.0


def speed(p: float) -> float:
    return math.hypot(*(c[1] + p * (2 * c[2] + 3 * c[3] * p) for c in (U, V)))


def place(p: float) -> tuple[float, ...]:
    return tuple(c[0] + p * (c[1] + p * (c[2] + p * c[3])) for c in (U, V))


def parametric(p_range: str) -> tuple[str, float]:
    """The curve as a paramPoly3, and its length; slow to slightly wrong if taken as it stands."""
    length = quad(speed, 0.0, SPAN, epsabs=1e-12)[0]
    scale = SPAN / (length if p_range == "arcLength" else 1.0)
    names = [f"{letter}{axis}" for axis in "UV" for letter in "abcd"]
    if p_range == "arcLength":
        u, v = ([c[k] * scale**k for k in range(4)] for c in (U, V))
    else:
        u, v = ([c[k] * SPAN**k for k in range(4)] for c in (U, V))
    figures = " ".join(f'{n}="{x!r}"' for n, x in zip(names, [*u, *v], strict=True))
    return f'<paramPoly3 pRange="{p_range}" {figures}/>', length


@pytest.mark.parametrize("p_range", ["arcLength", "normalized"])
def test_param_poly3_runs_by_true_arc_length(tmp_path: FilePath, p_range: str) -> None:
    shape, length = parametric(p_range)
    # The lane widens along the road: where is a matter of true arc length.
    lanes = section(0.0, "", lane(-1, cubic("width", "sOffset", 0.0, 2.0, 0.1)))
    path = followed(tmp_path, single(geometry(0.0, HERE, length, shape), length, lanes))
    for p in (0.0, 9.0, 21.0, 40.0):
        s = quad(speed, 0.0, p, epsabs=1e-12)[0]
        du, dv = (c[1] + p * (2 * c[2] + 3 * c[3] * p) for c in (U, V))
        psi, t = math.atan2(dv, du), -(2.0 + 0.1 * s) / 2.0
        x, y = place(p)
        _, d = path.project(x - t * math.sin(psi), y + t * math.cos(psi))
        assert d == pytest.approx(0.0, abs=1e-5)
    # Taken for arc length, the parameter would be metres off.
    middle = quad(speed, 0.0, SPAN / 2.0, epsabs=1e-12)[0]
    assert abs(middle - length / 2.0) > 1.0


def test_widths_and_offsets_add_up(tmp_path: FilePath) -> None:
    inner = cubic("width", "sOffset", 0.0, 3.0, 0.0, 0.012, -4e-4)
    outer = cubic("width", "sOffset", 0.0, 2.0) + cubic("width", "sOffset", 8.0, 2.0, 0.05)
    lanes = section(0.0, "", lane(-1, inner) + lane(-2, outer))
    offset = cubic("laneOffset", "s", 0.0, 1.0) + cubic("laneOffset", "s", 5.0, 1.0, -0.02)
    view, length, _ = maps.plan([Segment(20.0, 0.0, 0.0)], HERE)
    path = followed(tmp_path, single(view, length, lanes, offset), lane=-2)
    for s in (0.0, 3.0, 8.0, 15.0, 20.0):
        t = 1.0 - (0.02 * (s - 5.0) if s > 5.0 else 0.0)
        t -= 3.0 + 0.012 * s**2 - 4e-4 * s**3
        t -= 0.5 * (2.0 + (0.05 * (s - 8.0) if s > 8.0 else 0.0))
        assert path.project(s, t)[1] == pytest.approx(0.0, abs=2e-5)


def test_the_tangent_is_that_of_the_widening_lane(tmp_path: FilePath) -> None:
    lanes = section(0.0, "", lane(-1, cubic("width", "sOffset", 0.0, 3.0, 0.2)))
    path = followed(tmp_path, bent(Segment(20.0, 0.0, 0.0), lanes=lanes))
    assert path.at(0.0).psi == pytest.approx(START.psi - math.atan(0.1))
    assert path.length == pytest.approx(math.hypot(20.0, 2.0))


def test_left_hand_traffic(tmp_path: FilePath) -> None:
    text = bent(Segment(20.0, 0.0, 0.0), more='rule="LHT"')
    forward, back = (followed(tmp_path, text, lane=number) for number in (1, -1))
    assert forward.at(0.0).psi == pytest.approx(START.psi)
    assert math.remainder(back.at(0.0).psi - START.psi, math.tau) == pytest.approx(math.pi)
    assert followed(tmp_path, text).at(0.0) == forward.at(0.0)


def test_sections_are_followed_by_their_links(tmp_path: FilePath) -> None:
    first = section(0.0, "", lane(-1, links='<successor id="-2"/>'))
    added = lane(-1, cubic("width", "sOffset", 0.0, 0.0, 0.0, 0.02625, -0.000875))
    last = section(10.0, "", added + lane(-2, links='<predecessor id="-1"/>'))
    path = followed(tmp_path, bent(Segment(30.0, 0.0, 0.0), lanes=first + last))
    assert path.length == pytest.approx(math.hypot(30.0, 0.0), abs=0.5)
    x, y = START.x, START.y
    c, s = math.cos(START.psi), math.sin(START.psi)
    t = -1.5 * WIDTH  # the added lane has pushed it aside
    assert path.at(path.length)[:2] == pytest.approx((x + 30 * c - t * s, y + 30 * s + t * c))
    alone = followed(tmp_path, bent(Segment(30.0, 0.0, 0.0), lanes=first + last), lane=-2)
    assert alone.length == pytest.approx(path.length - 10.0)


def test_sections_without_length_are_passed_through(tmp_path: FilePath) -> None:
    lanes = "".join(
        section(s, "", lane(-1, links=maps.goes_on(-1))) for s in (0.0, 10.0, 10.0, 10.00000002)
    )
    path = followed(tmp_path, bent(Segment(30.0, 0.02, 0.02), lanes=lanes))
    whole = followed(tmp_path, bent(Segment(30.0, 0.02, 0.02)))
    assert path.length == pytest.approx(whole.length, abs=1e-7)


def test_sections_of_one_side(tmp_path: FilePath) -> None:
    both = section(0.0, lane(1, links=maps.goes_on(1)), lane(-1, links='<successor id="-2"/>'))
    extra = 'singleSide="true"'
    right = section(20.0, "", lane(-1) + lane(-2, links='<predecessor id="-1"/>'), extra)
    text = bent(Segment(30.0, 0.0, 0.0), lanes=both + right)
    assert followed(tmp_path, text, lane=1).length == pytest.approx(30.0)
    # Where the lane jumps aside by its width, it does not go on.
    assert followed(tmp_path, text, lane=-1).length == pytest.approx(20.0)


def test_a_small_step_is_eased(tmp_path: FilePath) -> None:
    step, length = 0.05, 60.0
    offset = cubic("laneOffset", "s", 0.0, 0.0) + cubic("laneOffset", "s", 30.0, step)
    view, length, _ = maps.plan([Segment(length, 0.0, 0.0)], HERE)
    path = followed(tmp_path, single(view, length, offset=offset))
    found = [path.at(s) for s in np.linspace(0.0, path.length, 400)]
    assert found[0].y == pytest.approx(-WIDTH / 2.0)
    assert found[-1].y == pytest.approx(-WIDTH / 2.0 + step)
    assert max(abs(p.curvature) for p in found) < 0.007
    assert all(-1e-4 <= p.y + WIDTH / 2.0 <= step + 1e-4 for p in found)


def test_a_step_around_the_joint_of_a_lap(tmp_path: FilePath) -> None:
    ring = [Segment(math.tau * 30.0, 1 / 30.0, 1 / 30.0)]
    view, length, _ = maps.plan(ring, HERE)
    link = maps.to("predecessor", "road", "1", "end") + maps.to("successor", "road", "1", "start")
    offset = cubic("laneOffset", "s", 0.0, 0.0, 0.04 / length)
    text = maps.whole(maps.road("1", view, length, maps.ONE_WAY, link, offset))
    path = followed(tmp_path, text)
    assert path.closed
    kappa = [path.at(s).curvature for s in np.linspace(0.0, path.length, 400)]
    assert np.max(np.abs(np.array(kappa) - 1.0 / (30.0 + WIDTH / 2.0))) < 0.007


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (bent(Segment(20.0, -1.0, -1.0)), "a lane turns with a radius below 0.1 m here: it lies"),
        (
            bent(Segment(20.0, 0.0, 0.0), offset=cubic("laneOffset", "s", 0.0, 0.0, 1e8)),
            "<line>: a lane is 2e+09 m long here on 20 m of the road; widths and offsets are",
        ),
        (bent(Segment(20.0, 9.0, 9.0)), "<arc>: turns by 180 rad; curvatures are in 1/m"),
        (
            single(geometry(0.0, HERE, 20.0, parametric("arcLength")[0]), 20.0),
            "<paramPoly3>: its curve is 14.72 m long, its length is 20 m; is pRange right?",
        ),
        (
            single(geometry(0.0, HERE, 20.0, parametric("normalized")[0]), 20.0),
            "m long, its length is 20 m; is pRange right?",
        ),
        (
            single(geometry(0.0, HERE, 20.0, '<poly3 a="0" b="0" c="1e8" d="1e8"/>'), 20.0),
            "<poly3>: its figures are too large",
        ),
    ],
)
def test_what_cannot_be_followed(tmp_path: FilePath, text: str, message: str) -> None:
    with pytest.raises(DataError) as caught:
        _ = followed(tmp_path, text).table
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{tmp_path / 'map.xodr'}: road ")


def test_borders_are_edges(tmp_path: FilePath) -> None:
    """A lane between two borders, on both sides, and one with a width beyond a border."""
    right = lane(-1, cubic("border", "sOffset", 0.0, -3.0))
    right += lane(-2, cubic("border", "sOffset", 0.0, -7.0, -0.1))
    right += lane(-3, cubic("width", "sOffset", 0.0, 2.0))
    left = lane(1, cubic("border", "sOffset", 0.0, 4.0))
    view, length, _ = maps.plan([Segment(20.0, 0.0, 0.0)], HERE)
    text = single(view, length, lanes=section(0.0, left, right))
    found = ((-1, -1.5, 0.0), (-2, -5.0, -0.05), (-3, -8.0, -0.1), (1, 2.0, 0.0))
    for number, middle, slope in found:
        path = followed(tmp_path, text, lane=number)
        x, y = path.at(0.5 * path.length)[:2]
        assert y == pytest.approx(middle + slope * x, abs=1e-6)
