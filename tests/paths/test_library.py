"""Each kind of path has the shape it should have."""

from __future__ import annotations

import math

import numpy as np
import pytest

from steersman.config import resolve
from steersman.errors import ConfigError
from steersman.kernels import path as kernel
from steersman.paths.analytic import Circle, DoubleLaneChange, FigureEight, Lemniscate, Straight
from steersman.paths.base import PathComponent
from steersman.paths.random_road import RandomRoad
from steersman.paths.tracks import Monza, Track, TrainingCircuit


def test_circle() -> None:
    for direction, side in (("left", 1.0), ("right", -1.0)):
        circle = Circle(radius=50.0, direction=direction)
        assert circle.closed
        assert circle.length == pytest.approx(100.0 * math.pi, abs=1e-9)
        assert circle.at(0.0) == pytest.approx((0.0, 0.0, 0.0, side / 50.0))
        for s in np.linspace(0.0, circle.length, 41):
            angle = s / 50.0
            x, y, _, kappa = circle.at(s)
            assert x == pytest.approx(50.0 * math.sin(angle), abs=1e-9)
            assert y == pytest.approx(side * 50.0 * (1.0 - math.cos(angle)), abs=1e-9)
            assert kappa == pytest.approx(side / 50.0, abs=1e-12)


def test_straight() -> None:
    straight = Straight(distance=123.0)
    assert not straight.closed
    assert straight.length == pytest.approx(123.0)
    assert straight.at(77.7) == pytest.approx((77.7, 0.0, 0.0, 0.0))
    assert straight.project(50.0, -2.0) == pytest.approx((50.0, -2.0))


def test_monza() -> None:
    monza = Monza()
    assert monza.closed
    assert monza.length == pytest.approx(5793.0, abs=1e-3)
    names = [corner.name for corner in monza.corners()]
    assert names == [
        "Rettifilo",
        "Curva Grande",
        "Roggia",
        "Lesmo 1",
        "Lesmo 2",
        "Serraglio",
        "Ascari",
        "Rettifilo Opposto",
        "Alboreto/Parabolica",
    ]
    lesmo = monza.corners()[3]
    assert monza.at(0.5 * (lesmo.s_start + lesmo.s_end)).curvature < 0.0
    # Clockwise: one whole turn to the right.
    assert monza.at(monza.length - 1e-6).psi == pytest.approx(-math.tau, abs=1e-6)


def test_training_circuit() -> None:
    circuit = TrainingCircuit()
    assert circuit.closed
    assert circuit.length == pytest.approx(1502.360, abs=1e-3)
    assert np.max(np.abs(circuit.table.pieces[:, kernel.KAPPA0])) == pytest.approx(
        1.0 / 15.0, abs=1e-6
    )


@pytest.mark.parametrize("track", [Monza(), TrainingCircuit()], ids=lambda t: t.kind)
def test_reverse_and_mirror(track: Track) -> None:
    reverse = track.model_copy(update={"reverse": True})
    mirror = track.model_copy(update={"mirror": True})
    both = track.model_copy(update={"reverse": True, "mirror": True})
    for s in np.linspace(0.0, track.length, 57):
        here = track.at(s)
        there = reverse.at(track.length - s)
        assert there[:2] == pytest.approx(here[:2], abs=1e-4)
        assert there.curvature == pytest.approx(-here.curvature, abs=1e-7)
        assert math.cos(there.psi - here.psi) == pytest.approx(-1.0, abs=1e-6)
        x, y, psi, kappa = mirror.at(s)
        assert (x, -y, -psi, -kappa) == pytest.approx(tuple(here), abs=1e-9)
        x, y, _, kappa = both.at(track.length - s)
        assert (x, -y, kappa) == pytest.approx((here.x, here.y, here.curvature), abs=1e-4)


def test_names_follow_direction() -> None:
    forward = TrainingCircuit().corners()
    back = TrainingCircuit(reverse=True)
    assert forward[0].name == "soft left R90"
    last = back.corners()[-1]
    assert last.name == "soft right R90"
    assert last.s_start == pytest.approx(back.length - forward[0].s_end, abs=1e-3)
    assert TrainingCircuit(mirror=True).corners()[0].name == "soft right R90"
    assert TrainingCircuit(mirror=True, reverse=True).corners()[-1].name == "soft left R90"
    assert Circle().corners() == []


def test_lemniscate() -> None:
    path = Lemniscate(size=30.0)
    assert path.closed
    assert path.length == pytest.approx(5.244115108584240 * 30.0, rel=1e-8)
    points = np.array([path.at(s) for s in np.linspace(0.0, path.length, 301)])
    x, y, _, kappa = points.T
    # (x^2 + y^2)^2 = a^2 (x^2 - y^2), kappa = 3 r / a^2
    square = x**2 + y**2
    assert np.max(np.abs(square**2 - 900.0 * (x**2 - y**2))) < 1e-3
    assert np.max(np.abs(np.abs(kappa) - 3.0 * np.sqrt(square) / 900.0)) < 1e-5
    assert path.at(0.25 * path.length)[:2] == pytest.approx((30.0, 0.0), abs=1e-6)
    assert path.at(0.25 * path.length).curvature == pytest.approx(0.1, rel=1e-4)


def test_figure_eight() -> None:
    path = FigureEight()
    lengths = [segment.length for segment in path.segments()]
    assert path.length == pytest.approx(337.204, abs=1e-3)
    assert lengths[:4] == pytest.approx([17.896241, 15.0, 102.809725, 15.0], abs=1e-5)
    middle = path.at(0.5 * path.length)
    assert middle[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert math.cos(middle.psi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("path", [FigureEight(), Lemniscate()], ids=lambda p: p.kind)
def test_branches_of_a_crossing(path: PathComponent) -> None:
    for crossing in (0.0, 0.5 * path.length):
        for ds in (-3.0, -0.5, 0.0, 0.5, 3.0):
            x, y, psi, _ = path.at(crossing + ds)
            place = (x - 0.3 * math.sin(psi), y + 0.3 * math.cos(psi))
            s, d = path.project(*place, near=crossing + ds - 1.0)
            assert math.remainder(s - crossing - ds, path.length) == pytest.approx(0.0, abs=1e-6)
            assert d == pytest.approx(0.3, abs=1e-6)


def test_double_lane_change() -> None:
    path = DoubleLaneChange()
    out, back = path.segments()[1], path.segments()[6]
    assert (out.length, out.kappa_end) == pytest.approx((7.578105, 0.030652), abs=1e-6)
    assert (back.length, -back.kappa_end) == pytest.approx((6.343642, 0.043854), abs=1e-6)
    end = path.at(path.length)
    assert end == pytest.approx((125.0, 0.0, 0.0, 0.0), abs=1e-9)
    beside = path.at(15.0 + 4.0 * out.length + 12.5)
    assert beside == pytest.approx((57.5, 3.5, 0.0, 0.0), abs=1e-9)
    mirrored = DoubleLaneChange(direction="right").at(60.0)
    assert mirrored.y == pytest.approx(-path.at(60.0).y)


def test_random_road_is_what_its_seed_says() -> None:
    one, same, other = RandomRoad(seed=3), RandomRoad(seed=3), RandomRoad(seed=4)
    assert np.array_equal(one.table.pieces, same.table.pieces)
    assert not np.array_equal(one.table.pieces, other.table.pieces)


@pytest.mark.parametrize("seed", range(8))
def test_random_road_keeps_its_bounds(seed: int) -> None:
    road = RandomRoad(seed=seed, distance=700.0, min_radius=20.0)
    pieces = road.table.pieces
    assert road.length == pytest.approx(700.0, abs=1e-6)
    assert np.max(np.abs(pieces[:, kernel.KAPPA0])) <= 1.0 / 20.0 + 1e-9
    assert np.max(np.abs(pieces[:, kernel.PSI0])) <= road.max_heading + 0.11
    assert np.all(np.diff(pieces[:, kernel.X0]) > 0.0)
    assert road.at(0.0) == pytest.approx((0.0, 0.0, 0.0, 0.0))


def test_random_road_share_of_straights() -> None:
    for wanted in (0.0, 0.5, 1.0):
        parts = [
            segment
            for seed in range(20)
            for segment in RandomRoad(seed=seed, distance=2000.0, straights=wanted).segments()
        ]
        flat = sum(p.length for p in parts if p.kappa_start == 0.0 == p.kappa_end)
        assert flat / sum(p.length for p in parts) == pytest.approx(wanted, abs=0.06)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"kind": "circle", "radius": 0.0}, "radius"),
        ({"kind": "circle", "radius": -5.0}, "radius"),
        ({"kind": "circle", "radius": math.nan}, "radius"),
        ({"kind": "circle", "radius": math.inf}, "radius"),
        ({"kind": "circle", "direction": "up"}, "direction"),
        ({"kind": "circle", "radios": 5.0}, "did you mean 'radius'"),
        ({"kind": "straight", "distance": 0.0}, "distance"),
        ({"kind": "straight", "distance": -1.0}, "distance"),
        ({"kind": "lemniscate", "size": 0.0}, "size"),
        ({"kind": "figure_eight", "radius": 1.0}, "leaves no arc"),
        ({"kind": "double_lane_change", "offset": 30.0}, "too much for a lane change"),
        ({"kind": "double_lane_change", "out": 0.0}, "out"),
        ({"kind": "random_road", "seed": -1}, "seed"),
        ({"kind": "random_road", "distance": 0.0}, "distance"),
        ({"kind": "random_road", "straights": 1.5}, "straights"),
        ({"kind": "random_road", "min_radius": 300.0}, "min_radius 300.0 m is more than"),
        ({"kind": "csv"}, "file"),
    ],
)
def test_bad_fields_are_refused(data: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        resolve("path", data)
    assert "\n" not in str(caught.value)
