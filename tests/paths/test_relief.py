"""Height and banking of roads: read, kept along the path, felt by the car, and written."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

import steersman as sm
from steersman.logs.write import sampled
from steersman.paths.opendrive import OpenDrivePath
from steersman.paths.segments import Segment
from steersman.paths.table import csv_table
from steersman.paths.xodr.write import opendrive
from steersman.types import Pose

from . import xodr_maps as maps

BEND, BANK, SPEED = 1.0 / 120.0, 0.08, 14.0
START = Pose(3.0, -2.0, 0.5)


def hill(bank: float, lanes: str = maps.TWO_WAYS, fall: str = "", turns: float = 2.9) -> str:
    """A bend to the left that rises by 3 %, banked by ``bank`` [rad], left side up."""
    view, length, _ = maps.plan([Segment(turns / BEND, BEND, BEND)], START)
    height = maps.cubic("elevation", "s", 0.0, 7.0, 0.03)
    tilt = maps.cubic("superelevation", "s", 0.0, bank)
    shape = (
        f"<elevationProfile>{height}</elevationProfile>"
        f"<lateralProfile>{tilt}{fall}</lateralProfile>"
    )
    whole = maps.single(view, length, lanes)
    return whole.replace("</planView>", f"</planView>{shape}")


def followed(folder: FilePath, text: str, **words: object) -> OpenDrivePath:
    file = maps.write(folder / "hill.xodr", text)
    return sm.make("path", "opendrive", file=str(file), **{"road": "1", **words})


@pytest.mark.parametrize(("lane", "way"), [(-1, 1.0), (1, -1.0)])
def test_height_and_banking_are_those_under_the_lane(
    tmp_path: FilePath, lane: int, way: float
) -> None:
    path = followed(tmp_path, hill(0.1), lane=lane)
    surface = path.surface()
    assert surface is not None
    aside = way * -0.5 * maps.WIDTH  # lane -1 is on the right of the reference line
    length = 2.9 / BEND
    for share in (0.0, 0.3, 1.0):
        along = share if way > 0.0 else 1.0 - share
        expected = 7.0 + 0.03 * along * length + aside * math.sin(0.1)
        assert surface.at(share * path.length) == pytest.approx((expected, way * 0.1), abs=2e-3)


def test_crossfall_falls_outwards(tmp_path: FilePath) -> None:
    fall = maps.cubic("crossfall", "s", 0.0, 0.04).replace("/>", ' side="both"/>')
    right = followed(tmp_path, hill(0.0, fall=fall), lane=-1).surface()
    left = followed(tmp_path, hill(0.0, fall=fall), lane=1).surface()
    assert right is not None
    assert left is not None
    # On both sides the car's left, seen in its direction, is towards the middle and higher.
    assert right.at(50.0)[1] == left.at(50.0)[1] == pytest.approx(0.04)
    assert right.at(0.0)[0] == pytest.approx(7.0 - 0.5 * maps.WIDTH * math.sin(0.04), abs=1e-3)


def understeering() -> sm.Vehicle:
    """A car with so much grip that its tyres are as good as linear."""
    return sm.make("vehicle", "bmw_320i", c_f=60e3, c_r=120e3, friction=10.0)


def wheel(path: OpenDrivePath) -> float:
    """Wheel angle of a car that drives steadily along it [rad]."""
    car = understeering()
    speed = {"kind": "constant_speed", "speed": SPEED}
    drive = sm.drive("pid", path=path, vehicle=car, speed=speed, duration=14.0)
    assert drive.completed
    assert np.abs(drive["lateral_error"][-20:]).max() < 0.1
    return float(np.mean(drive["wheel_angle"][-60:]))


def test_a_banked_bend_needs_the_steering_that_theory_says(tmp_path: FilePath) -> None:
    """Rajamani, section 3.3: delta = L kappa + K_us (a_y + g sin(bank)), left side up."""
    flat = wheel(followed(tmp_path, hill(0.0)))
    car = understeering()
    gradient = car.mass / car.wheelbase * (car.l_r / 60e3 - car.l_f / 120e3)
    for bank in (BANK, -BANK):
        banked = wheel(followed(tmp_path, hill(bank)))
        expected = gradient * 9.81 * math.sin(bank)
        assert banked - flat == pytest.approx(expected, rel=0.05)


def test_what_is_written_is_read_back(tmp_path: FilePath) -> None:
    path = followed(tmp_path, hill(0.06))
    before = path.surface()
    text = opendrive(path, surface=before)
    back = followed(tmp_path, text)
    after = back.surface()
    assert before is not None
    assert after is not None
    for s in np.linspace(0.0, path.length, 17):
        assert after.at(s) == pytest.approx(before.at(s), abs=2e-3)
    assert followed(tmp_path, opendrive(path)).surface() is None


def test_tables_and_recordings_have_the_height(tmp_path: FilePath) -> None:
    path = followed(tmp_path, hill(0.06))
    surface = path.surface()
    assert surface is not None
    (tmp_path / "hill.csv").write_text(csv_table(path))
    table = np.genfromtxt(tmp_path / "hill.csv", delimiter=",", names=True)
    for row in table[::40]:
        assert surface.at(row["s_m"]) == pytest.approx((row["height_m"], row["bank_rad"]), abs=1e-6)
    again = sm.make("path", "csv", file=str(tmp_path / "hill.csv"))
    assert again.length == pytest.approx(path.length, abs=1e-3)
    assert sampled(path)[:, 3] == pytest.approx(
        [surface.at(s)[0] for s in np.linspace(0.0, path.length, len(sampled(path)))]
    )


def test_one_height_that_is_none_costs_the_heights(tmp_path: FilePath) -> None:
    path = followed(tmp_path, hill(0.05).replace('a="7.0"', 'a="seven"'))
    surface = path.surface()
    assert surface is not None
    assert surface.at(9.0)[1] == pytest.approx(0.05)
    assert path.notes()[0].endswith("not a number; the road's height is left out")
    steep = followed(tmp_path, hill(3.0)).notes()[0]
    assert steep.endswith("is beyond 1.5; superelevation is left out")
