"""A vehicle: its figures, and what they give for the kernels."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from pydantic import field_validator, model_validator

from steersman.config import Built, Component, build, param, register
from steersman.kernels import vehicle as kernel
from steersman.kernels.vehicle import VehicleTable

_DEG = math.pi / 180.0
KMH = 1.0 / 3.6
"""Kilometres an hour in metres a second."""
AIR_DENSITY = 1.2
# Beyond this wheel angle the tangent says little [rad].
LARGEST_ANGLE = 1.5
# Integration step up to which every vehicle is stable at any speed [s].
LONGEST_STEP = 0.01
_LOADS = "give mass, l_f and l_r; the front axle carries the share l_r / (l_f + l_r) of the weight"

# Throttle to net acceleration on a straight, measured on CARLA 0.9.16's Model 3: throttles 0.4 to
# 1.0 at 0 to 20 m/s. The zero-throttle row is -2.6 up to 4 m/s and falls to -8.8 at 24 m/s. What
# was not measured (0.4 from 14 m/s, 0.5 at 20 m/s, all beyond 20 or 24 m/s) goes on with the last
# slope of its row: up to 38.7 m/s (9000 rpm) the engine's torque is constant and its damping
# proportional to speed, which is the straight line that the measured rows follow.
MAP_THROTTLE = (0.0, 0.4, 0.5, 0.6, 0.8, 1.0)
MAP_SPEED = (0.0, 4.0, 8.0, 14.0, 20.0, 24.0, 38.7)
_MODEL3_DRAG_AREA = 0.33
MODEL3_ACCEL = (
    (-2.6, -2.6, -3.84, -5.70, -7.56, -8.80, -13.36),
    (2.40, 1.25, 0.17, -1.45, -3.07, -4.15, -8.12),
    (2.62, 2.24, 1.15, 0.12, -0.91, -1.60, -4.12),
    (3.34, 3.18, 2.43, 1.18, 0.24, -0.39, -2.69),
    (4.92, 5.08, 4.46, 3.76, 3.00, 2.49, 0.63),
    (6.03, 7.10, 7.59, 6.44, 6.17, 5.99, 5.33),
)


# Fields that every written vehicle has, and what those fields stand for that once were not there.
_WHOLE = {"mass", "height", "c_f", "fade_speed", "map_throttle"}
_BEFORE = {
    "roll_arm": None,
    "stiffness_load_limit": None,
    "rotating_mass": 0.0,
    "map_drag_area": None,
}


@register("vehicle", "custom")
class Vehicle(Component):
    """A car with four wheels, steered in front. Defaults are those of carla_model3_v1."""

    answers: ClassVar[dict[str, str]] = {
        "wheelbase": "give l_f and l_r; their sum is the wheelbase",
        "wheel_base": "give l_f and l_r; their sum is the wheelbase",
        **{
            word: _LOADS
            for word in (
                *("axle_load", "axle_loads", "front_axle_load", "rear_axle_load"),
                "weight_distribution",
            )
        },
        **dict.fromkeys(
            ("steering_ratio", "steer_ratio"),
            "give max_wheel_angle: the steering wheel's angle at full lock over the ratio [rad]",
        ),
    }

    @property
    def title(self) -> str:
        """Name for tables and pages."""
        return self.kind

    mass: float = param(1845.0, "kg", "Mass.", gt=0)
    yaw_inertia: float = param(3958.0, "kg m^2", "Moment of inertia about the z axis.", gt=0)
    l_f: float = param(1.168, "m", "Centre of mass to front axle.", gt=0, le=1e3)
    l_r: float = param(1.836, "m", "Centre of mass to rear axle.", gt=0, le=1e3)
    track_width: float = param(1.667, "m", "Distance between left and right wheels.", gt=0)
    height: float = param(0.55, "m", "Height of the centre of mass.", gt=0)
    roll_arm: float | None = param(
        None,
        "m",
        "Arm of the tyre forces by which accelerations shift wheel loads (null: height).",
        ge=0,
    )
    c_f: float = param(106_500.0, "N/rad", "Cornering stiffness of the front axle.", gt=0)
    c_r: float = param(67_800.0, "N/rad", "Cornering stiffness of the rear axle.", gt=0)
    stiffness_load_limit: float | None = param(
        None,
        "-",
        "Static loads from which a tyre grows no stiffer, by PhysX's law (null: in proportion).",
        gt=0,
    )
    friction: float = param(3.5, "-", "Tyre friction coefficient.", gt=0)
    drag_area: float = param(_MODEL3_DRAG_AREA, "m^2", "Drag coefficient times frontal area.", ge=0)
    rotating_mass: float = param(
        0.0,
        "kg",
        "Rotating masses of engine and wheels, as the mass that drive and brakes move besides.",
        ge=0,
    )
    drive_front: float = param(0.5, "-", "Share of the drive force at the front.", ge=0, le=1)
    brake_force: float = param(7568.0, "N", "Brake force of all wheels at full brake.", ge=0)
    brake_front: float = param(0.5, "-", "Share of the brake force at the front.", ge=0, le=1)
    max_wheel_angle: float = param(
        70.0 * _DEG, "rad", "Inner wheel at full lock.", gt=0, le=LARGEST_ANGLE
    )
    ackermann: bool = param(True, "-", "Outer wheel by Ackermann, else parallel wheels.")
    steer_rate_up: float = param(
        2.5, "1/s", "Steering rate away from centre, in full locks a second.", gt=0
    )
    steer_rate_down: float = param(
        5.0, "1/s", "Steering rate to the centre, in full locks a second.", gt=0
    )
    steer_lag: float = param(0.0, "s", "Time constant of the steering; 0: none.", ge=0, le=1)
    steer_delay: float = param(
        0.0, "s", "Delay of the steering; plant.steering_delay adds to it.", ge=0, le=0.5
    )
    steer_bias: float = param(
        0.0, "rad", "Inner wheel angle at centred steering, at low speed.", ge=-0.2, le=0.2
    )
    pedal_rate_up: float = param(6.0, "1/s", "Rate at which pedals are pressed.", gt=0)
    pedal_rate_down: float = param(10.0, "1/s", "Rate at which pedals are released.", gt=0)
    load_lag: float = param(0.1, "s", "Time constant of load transfer.", ge=0.02)
    width: float = param(2.16, "m", "Width of the body (drawing, lane widths).", gt=0)
    body_length: float = param(4.79, "m", "Length of the body (drawing).", gt=0)
    steer_curve_speed: tuple[float, ...] = param(
        (0.0, 20.0 * KMH, 60.0 * KMH, 120.0 * KMH), "m/s", "Speeds of the steering curve."
    )
    steer_curve_factor: tuple[float, ...] = param(
        (1.0, 0.9, 0.8, 0.7), "-", "Share of the full wheel angle at those speeds."
    )
    map_throttle: tuple[float, ...] = param(MAP_THROTTLE, "-", "Throttles of the map.")
    map_speed: tuple[float, ...] = param(MAP_SPEED, "m/s", "Speeds of the map.")
    map_acceleration: tuple[tuple[float, ...], ...] = param(
        MODEL3_ACCEL, "m/s^2", "Net acceleration on a straight, a row for each throttle."
    )
    map_mass: float | None = param(None, "kg", "Mass the map was measured with (null: mass).")
    map_drag_area: float | None = param(
        _MODEL3_DRAG_AREA,
        "m^2",
        "Drag area the map was measured with (null: drag_area); null for a map of one's own.",
        ge=0,
    )
    fade_speed: float = param(38.7, "m/s", "Speed from which the drive power is constant.", gt=0)

    @field_validator("map_throttle", "map_speed", "steer_curve_speed")
    @classmethod
    def _increasing(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        if len(values) <= 1 or any(b <= a for a, b in pairwise(values)):
            raise ValueError("needs at least two values, each larger than the one before")
        return values

    @model_validator(mode="before")
    @classmethod
    def _earlier(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        # A map of one's own has one's own drag; a whole vehicle without a roll arm was written
        # before there were any, and stays what it was.
        if "map_acceleration" in data:
            whole = data.keys() >= _WHOLE and "roll_arm" not in data
            data = (_BEFORE if whole else {"map_drag_area": None}) | data
        if "height" in data:  # a base's arm fits its own height
            data = {"roll_arm": None} | data
        return data

    @model_validator(mode="after")
    def _shapes(self) -> Vehicle:
        if len(self.steer_curve_factor) != len(self.steer_curve_speed):
            raise ValueError("steer_curve_factor needs one value for each steer_curve_speed")
        if not all(
            0.0 < f * self.max_wheel_angle <= LARGEST_ANGLE for f in self.steer_curve_factor
        ):
            raise ValueError(
                "steer_curve_factor times max_wheel_angle must be above zero and at most "
                f"{LARGEST_ANGLE} rad"
            )
        rows, columns = len(self.map_throttle), len(self.map_speed)
        if [len(row) for row in self.map_acceleration] != rows * [columns]:
            raise ValueError(f"map_acceleration needs {rows} rows of {columns} values")
        return self

    @property
    def wheelbase(self) -> float:
        """Front to rear axle [m]."""
        return self.l_f + self.l_r

    @property
    def turning_radius(self) -> float:
        """Radius on which the centre of mass turns at full lock, slowly [m]."""
        return math.hypot(self.wheelbase / math.tan(self.wheel_angle(1.0, 0.0)), self.l_r)

    @property
    def roll_over_acceleration(self) -> float:
        """Lateral acceleration at which the inner wheels lift, g track / (2 roll arm) [m/s^2]."""
        arm = self._arm()
        return kernel.GRAVITY * self.track_width / (2.0 * arm) if arm > 0.0 else math.inf

    def _arm(self) -> float:
        return self.height if self.roll_arm is None else self.roll_arm

    def replace(self, **figures: Any) -> Vehicle:
        """The same vehicle with other figures, validated.

        Raises:
            ConfigError: one of them is not allowed.
        """
        return build(type(self), self.model_dump() | figures)

    def row(self) -> Any:
        """Parameters as the kernels read them, shape (N_PARAMS,)."""
        out = np.zeros(kernel.N_PARAMS)
        air = 0.5 * AIR_DENSITY
        drag, measured = air * self.drag_area, self.map_drag_area
        columns = (
            (kernel.MASS, self.mass),
            (kernel.INERTIA, self.yaw_inertia),
            (kernel.L_F, self.l_f),
            (kernel.L_R, self.l_r),
            (kernel.TRACK, self.track_width),
            (kernel.ROLL_ARM, self._arm()),
            (kernel.C_F, self.c_f),
            (kernel.C_R, self.c_r),
            (kernel.MU, self.friction),
            (kernel.DRAG, drag),
            (kernel.DRIVE_FRONT, self.drive_front),
            (kernel.BRAKE_FORCE, self.brake_force),
            (kernel.BRAKE_FRONT, self.brake_front),
            (kernel.MAX_STEER, self.max_wheel_angle),
            (kernel.ACKERMANN, self.track_width / self.wheelbase if self.ackermann else 0.0),
            (kernel.STEER_UP, self.steer_rate_up),
            (kernel.STEER_DOWN, self.steer_rate_down),
            (kernel.PEDAL_UP, self.pedal_rate_up),
            (kernel.PEDAL_DOWN, self.pedal_rate_down),
            (kernel.MAP_MASS, self.mass if self.map_mass is None else self.map_mass),
            (kernel.MAP_DRAG, drag if measured is None else air * measured),
            (kernel.LOAD_LAG, self.load_lag),
            (kernel.FADE_SPEED, self.fade_speed),
            (kernel.SLIP_SPEED, self._slip_speed()),
            (kernel.STEER_LAG, self.steer_lag),
            (kernel.STEER_BIAS, self.steer_bias / self.max_wheel_angle),
            (kernel.LOAD_LIMIT, self.stiffness_load_limit or 0.0),
            (kernel.ROTATING, self.rotating_mass),
            (kernel.GRIP_LEFT, 1.0),
            (kernel.GRIP_RIGHT, 1.0),
        )
        for column, value in columns:
            out[column] = value
        return out

    def _slip_speed(self) -> float:
        """Speed below which slip angles are softened [m/s].

        The side-slip of a slow car decays at a rate of stiffness / (mass x this speed), and its
        yaw likewise; the explicit integration needs that rate times its step below 2. At the
        longest step it is at most 1 here, which leaves room for training's stiffer, lighter cars.
        """
        sideways = (self.c_f + self.c_r) / self.mass
        turning = (self.l_f**2 * self.c_f + self.l_r**2 * self.c_r) / self.yaw_inertia
        return max(1.0, LONGEST_STEP * max(sideways, turning))

    @property
    def table(self) -> VehicleTable:
        """This vehicle alone as the kernels read it."""
        return self._built.value

    @cached_property
    def _built(self) -> Built[VehicleTable]:
        table = VehicleTable(
            rows=self.row()[None, :],
            steer_speed=np.array(self.steer_curve_speed),
            steer_factor=np.array(self.steer_curve_factor),
            map_throttle=np.array(self.map_throttle),
            map_speed=np.array(self.map_speed),
            map_accel=np.array(self.map_acceleration),
        )
        return Built(table)

    def wheel_angle(self, steer: float, speed: float) -> float:
        """Single-track wheel angle [rad] of a normalised steering at a speed [m/s]."""
        return math.atan(kernel.wheel_tangents(self.table, 0, steer, speed)[2])

    def steer_for_wheel_angle(self, wheel_angle: float, speed: float) -> float:
        """Normalised steering for a single-track wheel angle [rad] at a speed [m/s]."""
        return kernel.steer_for_wheel(self.table, 0, wheel_angle, speed)
