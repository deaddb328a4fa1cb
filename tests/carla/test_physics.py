"""What CARLA tells of a vehicle becomes our parameters; the wheel's angle becomes steering."""

from __future__ import annotations

import math
from types import SimpleNamespace as Told
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steersman.errors import PlantError
from steersman.kernels import vehicle as kernel
from steersman.plants.carla_frame import CarlaFrame, Placement
from steersman.plants.carla_physics import offset_of, steering, vehicle_of
from steersman.vehicles import Bmw320i, CarlaMkz2020, CarlaModel3, Vehicle

MODEL3 = CarlaModel3()
ORIGIN = Placement(0.0, 0.0, 0.0)
CARS = st.sampled_from([MODEL3, CarlaMkz2020(), Bmw320i(), MODEL3.replace(steer_bias=0.02)])


def told(car: Vehicle, ahead: float = 0.45, at: Placement = ORIGIN, **changes: Any) -> Any:
    """A physics control as a server would have it for one of our cars; lengths in cm."""
    psi = CarlaFrame.radians_left(at.yaw)
    wheels = []
    for along in (ahead + car.l_f, ahead - car.l_r):
        for left in (0.5 * car.track_width, -0.5 * car.track_width):
            x, y = CarlaFrame.world_vector(psi, along, left)
            front = along > 0.0
            share = car.brake_front if front else 1.0 - car.brake_front
            wheels.append(
                Told(
                    position=Told(x=100.0 * (at.x + x), y=100.0 * (at.y + y), z=37.0),
                    radius=37.0,
                    max_brake_torque=0.5 * share * car.brake_force * 0.37,
                    tire_friction=car.friction,
                    max_steer_angle=math.degrees(car.max_wheel_angle) if front else 0.0,
                )
            )
    curve = zip(car.steer_curve_speed, car.steer_curve_factor, strict=True)
    figures = {
        "center_of_mass": Told(x=ahead, y=0.0, z=-0.3),
        "mass": car.mass,
        "drag_coefficient": car.drag_area / 2.2,
        "steering_curve": [Told(x=3.6 * v, y=f) for v, f in curve],
        "wheels": wheels,
    }
    return Told(**figures | changes)


def read(physics: Any, base: Vehicle, at: Placement = ORIGIN) -> Vehicle:
    return vehicle_of(physics, base, at, (base.body_length, base.width))


def test_another_cars_physics_is_read() -> None:
    found = read(told(CarlaMkz2020(), 0.6), MODEL3)
    wanted = CarlaMkz2020()
    for name in ("mass", "l_f", "l_r", "track_width", "friction", "drag_area", "max_wheel_angle"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-4), name
    # What CARLA does not tell is the given vehicle's.
    for name in ("yaw_inertia", "c_f", "c_r", "height", "steer_rate_up", "map_acceleration"):
        assert getattr(found, name) == getattr(MODEL3, name), name


@given(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(-180.0, 180.0))
def test_wheels_are_told_in_the_worlds_axes(x: float, y: float, yaw: float) -> None:
    at = Placement(x, y, yaw)
    found = read(told(Bmw320i(), 0.2, at), MODEL3, at)
    assert (found.l_f, found.l_r) == pytest.approx((1.1562, 1.4227), abs=1e-9)
    assert found.track_width == pytest.approx(1.39, abs=1e-9)


def test_a_car_that_is_as_believed_is_left_to_the_bit() -> None:
    wheels = told(MODEL3).wheels
    wheels[0].position.x += 1e-3  # what single precision leaves, far from the map's origin
    assert read(told(MODEL3, mass=1845.00001, wheels=wheels), MODEL3) is MODEL3


def test_wheels_at_zero_say_nothing_of_the_axles() -> None:
    wheels = told(CarlaMkz2020()).wheels
    for wheel in wheels:
        wheel.position = Told(x=0.0, y=0.0, z=0.0)
    found = read(told(CarlaMkz2020(), wheels=wheels), MODEL3)
    assert (found.l_f, found.l_r) == (MODEL3.l_f, MODEL3.l_r)
    assert found.mass == 1696.0


def test_a_curve_of_one_point_is_none() -> None:
    found = read(told(MODEL3, steering_curve=[Told(x=0.0, y=1.0)], mass=2000.0), MODEL3)
    assert found.steer_curve_factor == MODEL3.steer_curve_factor
    assert found.mass == 2000.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wheels": told(MODEL3).wheels[:2]}, "2 wheels; only cars with 4"),
        ({"mass": -1.0}, "no car's: .*mass"),
        ({"mass": math.nan}, "no car's"),
    ],
)
def test_what_is_no_car_is_refused(changes: Any, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        read(told(MODEL3, **changes), MODEL3)


def test_centre_of_mass_is_left_positive() -> None:
    assert offset_of(told(MODEL3, center_of_mass=Told(x=0.6, y=0.1, z=0.0))) == (0.6, -0.1)


@given(CARS, st.floats(-1.0, 1.0), st.floats(0.0, 40.0))
def test_steering_is_the_inverse_of_the_law(car: Vehicle, steer: float, speed: float) -> None:
    left, _, middle = kernel.wheel_tangents(car.table, 0, steer, speed)
    found, angle = steering(car, math.atan(left), speed)
    assert found == pytest.approx(steer, abs=1e-9)
    assert angle == pytest.approx(math.atan(middle), abs=1e-12)
