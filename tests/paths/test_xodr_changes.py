"""Routes that change lanes."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from steersman.errors import DataError
from steersman.kernels.path import KAPPA0
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.segments import Segment
from steersman.types import Pose

from . import xodr_maps as maps


def street(curvature: float = 0.0, lanes: int = 2, against: bool = False) -> str:
    """Road "a" of several lanes, the outermost of which leads to road "b", the others nowhere.

    ``against``: both are driven from right to left, as they are laid.
    """
    sign, side = (1, "left") if against else (-1, "right")
    link, contact = ("predecessor", "end") if against else ("successor", "start")
    numbers = [sign * (k + 1) for k in range(lanes)]
    rows = "".join(
        maps.lane(n, links=f'<{link} id="{sign}"/>' if n == numbers[-1] else "") for n in numbers
    )
    start = Pose(5.0, 1.0, 0.3)
    view, length, end = maps.plan([Segment(120.0, curvature, curvature)], start)
    lanes_of_a = maps.section(0.0, **{side: rows})
    first = maps.road("a", view, length, lanes_of_a, maps.to(link, "road", "b", contact))
    shift = maps.cubic("laneOffset", "s", 0.0, sign * maps.WIDTH * (lanes - 1))
    back = Pose(start.x - 40.0 * math.cos(start.psi), start.y - 40.0 * math.sin(start.psi), 0.3)
    view, length, _ = maps.plan([Segment(40.0, 0.0, 0.0)], back if against else end)
    one = maps.section(0.0, **{side: maps.lane(sign, links=maps.goes_on(sign))})
    return maps.whole(first, maps.road("b", view, length, one, offset=shift))


@pytest.mark.parametrize("against", [False, True])
@pytest.mark.parametrize("lanes", [2, 3])
@pytest.mark.parametrize("curvature", [0.0, 0.01])
def test_a_route_changes_lanes_where_it_must(
    tmp_path: FilePath, curvature: float, lanes: int, against: bool
) -> None:
    file = maps.write(tmp_path / "street.xodr", street(curvature, lanes, against))
    lane = 1 if against else -1
    aside, length = (lanes - 1) * maps.WIDTH, (lanes - 1) * 50.0
    path = OpenDrivePath(file=file, route=("a", "b"), lane=lane, lane_change=50.0)
    own = OpenDrivePath(file=file, road="a", lane=lane)
    side = -1.0  # to the right, seen in driving direction, on either side of the road
    before, after = (own.project(*path.at(s)[:2])[1] for s in (5.0, 115.0))
    assert before == pytest.approx(0.0, abs=1e-4)
    assert after == pytest.approx(side * aside, abs=1e-3)
    # four clothoids: the curvature added is at most 8 distance / length^2, and never jumps
    kappa = path.table.pieces[:, KAPPA0]
    inner = np.array([path.at(s).curvature for s in np.arange(1.0, 112.0, 0.5)])
    added = inner - (0.0 if not curvature else own.at(30.0).curvature)
    assert np.abs(added).max() == pytest.approx(8.0 * aside / length**2, rel=0.25)
    assert np.abs(np.diff(inner)).max() < 32.0 * aside / length**3 * 0.5 * 1.5
    assert np.isfinite(kappa).all()


def test_no_lane_is_changed_without_need_or_leave(tmp_path: FilePath) -> None:
    file = maps.write(tmp_path / "street.xodr", street())
    straight = OpenDrivePath(file=file, route=("a", "b"))
    assert abs(straight.table.pieces[:, KAPPA0]).max() < 1e-9  # it begins in the lane that leads on
    with pytest.raises(DataError, match="without a change of lane"):
        _ = OpenDrivePath(file=file, route=("a", "b"), lane=-1, lane_change=0.0).table
    assert OpenDrivePath(file=file, route=("a", "b"), lane=-1).notes() == (
        "the way changes from lane -1 to lane -2 on road 'a'",
    )


def test_a_random_way_changes_lanes_where_it_would_end(tmp_path: FilePath) -> None:
    """Before the street lies a road that leads to the lane which leads nowhere."""
    start = Pose(5.0 - 40.0 * math.cos(0.3), 1.0 - 40.0 * math.sin(0.3), 0.3)
    view, length, _ = maps.plan([Segment(40.0, 0.0, 0.0)], start)
    before = maps.road("z", view, length, maps.ONE_WAY, maps.to("successor", "road", "a", "start"))
    file = maps.write(tmp_path / "map.xodr", street().replace("<road ", before + "<road ", 1))
    for seed in range(3):
        longest = OpenDrivePath(file=file, random=seed, distance=159.0, lane_change=0.0)
        same = OpenDrivePath(file=file, random=seed, distance=159.0)
        assert np.array_equal(same.table.pieces, longest.table.pieces)
        assert not same.notes()
        path = OpenDrivePath(file=file, random=seed, distance=195.0)
        assert path.length == pytest.approx(195.0)
        assert path.notes() == ("the way changes from lane -1 to lane -2 on road 'a'",)
        with pytest.raises(DataError, match=r"the longest is 160 m; set path\.distance"):
            _ = OpenDrivePath(file=file, random=seed, distance=195.0, lane_change=0.0).table
