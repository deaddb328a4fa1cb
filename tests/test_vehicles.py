"""Vehicles: the figures of the built-in ones, and vehicles from the user's file."""

from __future__ import annotations

import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from pydantic import ValidationError

from steersman.config import build, components, lookup
from steersman.errors import ConfigError, SteersmanError
from steersman.kernels import vehicle as kernel
from steersman.vehicles import Bmw320i, CarlaModel3, CarlaModel3V1, Vehicle

KINDS = sorted(set(components("vehicle")) - {"file"})


@pytest.mark.parametrize("kind", KINDS)
def test_every_vehicle_is_a_car(kind: str) -> None:
    car = build(lookup("vehicle", kind), {})
    assert car.table.rows.shape == (1, kernel.N_PARAMS)
    assert np.isfinite(car.row()).all()
    assert car.wheelbase == car.l_f + car.l_r
    if kind == "vw_t7":  # as TUM-CONTROL has it: low, on tyres that understeer
        assert 30.0 < car.roll_over_acceleration < 31.0
        assert car.c_f * car.l_f < car.c_r * car.l_r
        return
    # Where wheels lift below the grip, it is at a lateral acceleration that a car can have.
    assert 9.0 < min(car.roll_over_acceleration, car.friction * kernel.GRAVITY) < 35.0
    # The published stiffnesses are in proportion to the axle loads: neutral steer.
    assert car.c_f / car.c_r == pytest.approx(car.l_r / car.l_f, rel=0.06)


def test_model3() -> None:
    car = CarlaModel3()
    assert (car.mass, car.l_f, car.l_r, car.track_width) == (1845.0, 1.168, 1.836, 1.667)
    assert math.degrees(car.max_wheel_angle) == pytest.approx(70.0)
    assert (car.pedal_rate_up, car.pedal_rate_down) == (6.0, 10.0)
    first = CarlaModel3V1()
    assert (first.steer_rate_up, first.steer_rate_down) == (2.5, 5.0)
    assert first.roll_over_acceleration == pytest.approx(14.87, abs=0.005)
    # Real logs corner at 27 m/s^2: grip ends first.
    assert car.roll_over_acceleration > 1.5 * car.friction * kernel.GRAVITY


def test_model3s_stiffness_is_physxs_law() -> None:
    car = CarlaModel3()
    share = 20.0 * (1.0 - 1.0 / 3.0 + 1.0 / 27.0)
    weight = car.mass * kernel.GRAVITY
    assert car.c_f == pytest.approx(share * weight * car.l_r / car.wheelbase, rel=1e-3)
    assert car.c_r == pytest.approx(share * weight * car.l_f / car.wheelbase, rel=1e-3)


@pytest.mark.parametrize("kind", ["carla_model3", "carla_model3_v1", "carla_mkz2020", "custom"])
def test_a_vehicle_written_before_there_were_roll_arms_stays_what_it_was(kind: str) -> None:
    new = {"roll_arm", "stiffness_load_limit", "rotating_mass", "map_drag_area"}
    first = CarlaModel3V1()
    written = {name: value for name, value in first.model_dump().items() if name not in new}
    car = build(lookup("vehicle", kind), written)
    assert (car.row() == first.row()).all()
    assert car.map_acceleration == first.map_acceleration


@pytest.mark.parametrize("kind", KINDS)
def test_a_vehicle_survives_being_written(kind: str) -> None:
    car = build(lookup("vehicle", kind), {})
    assert build(lookup("vehicle", kind), car.model_dump()) == car


def test_steer_for_wheel_angle() -> None:
    car = CarlaModel3()
    for speed in (0.0, 10.0, 40.0):
        steer = car.steer_for_wheel_angle(0.1, speed)
        middle = kernel.wheel_tangents(car.table, 0, steer, speed)[2]
        assert math.atan(middle) == pytest.approx(0.1)
        assert car.steer_for_wheel_angle(-0.1, speed) == -steer


def test_replace() -> None:
    car = CarlaModel3()
    heavier = car.replace(mass=2000.0, height=0.7)
    assert isinstance(heavier, CarlaModel3)
    assert (heavier.mass, heavier.height, heavier.l_f) == (2000.0, 0.7, 1.168)
    assert heavier.table.rows[0, kernel.MASS] == 2000.0
    assert car.table.rows[0, kernel.MASS] == 1845.0
    assert car.replace() == car
    with pytest.raises(ConfigError, match="mass"):
        car.replace(mass=-1.0)


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"map_throttle": [0.0, 1.0]}, "map_acceleration needs 2 rows of 7 values"),
        ({"map_acceleration": [[0.0] * 6] * 6}, "map_acceleration needs 6 rows of 7 values"),
        ({"map_speed": [0.0, 4.0, 4.0, 14.0, 20.0, 24.0, 30.0]}, "each larger than the one before"),
        ({"map_throttle": [0.5]}, "at least two values"),
        ({"steer_curve_factor": [1.0, 0.9]}, "one value for each steer_curve_speed"),
        # A wheel that turns nowhere, or beyond a right angle.
        ({"steer_curve_factor": [1.0, 0.9, 0.8, 0.0]}, "steer_curve_factor times max_wheel_angle"),
        ({"steer_curve_factor": [1.0, 0.9, 0.8, 1.4]}, "steer_curve_factor times max_wheel_angle"),
        ({"drive_front": 1.2}, "less than or equal to 1"),
        # Faster than the integration follows.
        ({"load_lag": 0.001}, "greater than or equal to 0.02"),
    ],
)
def test_maps_and_figures_are_checked(figures: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        Vehicle(**figures)


def test_slip_is_softened_for_stiff_light_cars_only() -> None:
    assert CarlaModel3V1().row()[kernel.SLIP_SPEED] == 1.0
    # Rate of decay (215 and 216 per second) times the longest step of 0.01 s.
    assert Bmw320i().row()[kernel.SLIP_SPEED] == pytest.approx(2.16, abs=0.02)


# --------------------------------------------------------------------------------- from files


def from_file(folder: FilePath, text: str, **figures: object) -> Vehicle:
    file = folder / "car.yaml"
    file.write_text(text, encoding="utf-8")
    car = build(lookup("vehicle", "file"), {"file": str(file), **figures})
    assert isinstance(car, Vehicle)
    return car


def test_vehicle_from_a_file(tmp_path: FilePath) -> None:
    car = from_file(tmp_path, "base: bmw_320i\nmass: 1200\nmap_throttle: [0, 0.3, .5, .6, .8, 1]\n")
    bmw = Bmw320i()
    assert (car.mass, car.l_f, car.ackermann) == (1200.0, bmw.l_f, False)
    assert car.map_throttle[1] == 0.3
    assert car.table.rows[0, kernel.C_F] == bmw.c_f


def test_without_base_the_default_car_is_meant(tmp_path: FilePath) -> None:
    car = from_file(tmp_path, "height: 0.6\n")
    assert (car.height, car.mass) == (0.6, Vehicle().mass)


def test_values_beside_the_file_win(tmp_path: FilePath) -> None:
    car = from_file(tmp_path, "mass: 1200\nheight: 0.6\n", mass=1300.0)
    assert (car.mass, car.height) == (1300.0, 0.6)
    assert car.replace(height=0.5).mass == 1300.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mass: -3\n", "mass"),
        ("mas: 1200\n", "mass"),
        ("base: bmw_320\n", "bmw_320i"),
        ("base: file\n", "base must name a vehicle that is not a file"),
        ("map_throttle: [0, 1]\n", "map_acceleration needs 2 rows"),
        ("- 1\n- 2\n", ""),
        ("mass: [\n", ""),
    ],
)
def test_faults_name_the_file(tmp_path: FilePath, text: str, said: str) -> None:
    with pytest.raises(SteersmanError) as caught:
        from_file(tmp_path, text)
    assert "car.yaml" in str(caught.value)
    assert said in str(caught.value)


def test_missing_file(tmp_path: FilePath) -> None:
    with pytest.raises(SteersmanError, match=r"absent\.yaml"):
        build(lookup("vehicle", "file"), {"file": str(tmp_path / "absent.yaml")})
