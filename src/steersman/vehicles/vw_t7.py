"""VW T7 of TUM-CONTROL."""

from __future__ import annotations

from steersman.config import param, register
from steersman.vehicles.base import AIR_DENSITY, LARGEST_ANGLE, Vehicle


@register("vehicle", "vw_t7")
class VwT7(Vehicle):
    """VW T7 of TUM-CONTROL (github.com/TUMFTM/TUM-CONTROL): its figures for simulation.

    Throttle gives up to 2.5, the brake 3.5 m/s^2 beside resistances, as its limits are. Track
    width is assumed; width and length are those of the production car.
    """

    mass: float = param(2520.0, "kg", "Mass.", gt=0)
    yaw_inertia: float = param(13600.0, "kg m^2", "Moment of inertia about the z axis.", gt=0)
    l_f: float = param(1.484, "m", "Centre of mass to front axle.", gt=0)
    l_r: float = param(1.644, "m", "Centre of mass to rear axle.", gt=0)
    track_width: float = param(1.7, "m", "Distance between left and right wheels.", gt=0)
    height: float = param(0.275, "m", "Height of the centre of mass.", gt=0)
    # Pacejka's B C D of each axle.
    c_f: float = param(
        10.0 * 1.3 * 15591.427, "N/rad", "Cornering stiffness of the front axle.", gt=0
    )
    c_r: float = param(
        10.0 * 1.6 * 24629.523, "N/rad", "Cornering stiffness of the rear axle.", gt=0
    )
    friction: float = param(1.0, "-", "Tyre friction coefficient.", gt=0)
    # Its air has 1.225 kg/m^3.
    drag_area: float = param(
        0.35 * 2.9 * 1.225 / AIR_DENSITY, "m^2", "Drag coefficient times frontal area.", ge=0
    )
    drive_front: float = param(0.0, "-", "Share of the drive force at the front.", ge=0, le=1)
    brake_force: float = param(8820.0, "N", "Brake force of all wheels at full brake.", ge=0)
    brake_front: float = param(2.0 / 3.0, "-", "Share of the brake force at the front.", ge=0, le=1)
    max_wheel_angle: float = param(0.610865, "rad", "Angle at full lock.", gt=0, le=LARGEST_ANGLE)
    ackermann: bool = param(False, "-", "Outer wheel by Ackermann, else parallel wheels.")
    steer_rate_up: float = param(
        0.322 / 0.610865, "1/s", "Steering rate away from centre, in full locks a second.", gt=0
    )
    steer_rate_down: float = param(
        0.322 / 0.610865, "1/s", "Steering rate to the centre, in full locks a second.", gt=0
    )
    width: float = param(1.941, "m", "Width of the body (drawing, lane widths).", gt=0)
    body_length: float = param(4.973, "m", "Length of the body (drawing).", gt=0)
    steer_curve_speed: tuple[float, ...] = param((0.0, 50.0), "m/s", "Speeds of the curve.")
    steer_curve_factor: tuple[float, ...] = param((1.0, 1.0), "-", "Share at those speeds.")
    map_throttle: tuple[float, ...] = param((0.0, 1.0), "-", "Throttles of the map.")
    map_speed: tuple[float, ...] = param((0.0, 50.0), "m/s", "Speeds of the map.")
    map_acceleration: tuple[tuple[float, ...], ...] = param(
        ((0.0, 0.0), (2.5, 2.5)), "m/s^2", "Acceleration without drag, a row for each throttle."
    )
    map_drag_area: float | None = param(
        0.0, "m^2", "Drag area the map was measured with (null: drag_area).", ge=0
    )
    fade_speed: float = param(50.0, "m/s", "Speed from which the drive power is constant.", gt=0)
