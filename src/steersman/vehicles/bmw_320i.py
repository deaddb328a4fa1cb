"""BMW 320i of CommonRoad, each figure with its source."""

from __future__ import annotations

from steersman.config import param, register
from steersman.kernels.vehicle import GRAVITY
from steersman.vehicles.base import AIR_DENSITY, LARGEST_ANGLE, MAP_SPEED, MAP_THROTTLE, Vehicle

# BMW 320i, Althoff and Wuersching, CommonRoad: Vehicle Models, 2020: axle stiffness
# mu C_S F_z with C_S = 20.898 1/rad and the static axle load.
_BMW_MASS, _BMW_LF, _BMW_LR, _BMW_MU, _BMW_CS = 1093.3, 1.1562, 1.4227, 1.0489, 20.898
_BMW_WEIGHT = _BMW_MU * _BMW_CS * _BMW_MASS * GRAVITY / (_BMW_LF + _BMW_LR)
_BMW_DRAG_AREA = 0.6
# Its length and width there are those of the 320i of 1977 (E21): an engine of 92 kW, rear axle
# driven, 100 km/h in about 10 s. Assumed: a tenth of the power is lost on the way to the wheels,
# gears that always fit, 3.5 m/s^2 as the most that the first ones give; rolling resistance 1.5 % of
# the weight; 0.4 m/s^2 of engine braking, less of it the wider the throttle.
_BMW_POWER, _BMW_LAUNCH, _BMW_ROLLING, _BMW_ENGINE_BRAKE = 0.9 * 92e3, 3.5, 0.147, 0.4


def _bmw_acceleration(throttle: float, speed: float) -> float:
    drive = min(_BMW_LAUNCH, _BMW_POWER / (_BMW_MASS * max(speed, 1.0)))
    drag = 0.5 * AIR_DENSITY * _BMW_DRAG_AREA * speed * speed / _BMW_MASS
    return throttle * drive - (1.0 - throttle) * _BMW_ENGINE_BRAKE - _BMW_ROLLING - drag


_BMW_ACCEL = tuple(tuple(_bmw_acceleration(t, v) for v in MAP_SPEED) for t in MAP_THROTTLE)


@register("vehicle", "bmw_320i")
class Bmw320i(Vehicle):
    """BMW 320i with real-world grip: Althoff and Wuersching, CommonRoad: Vehicle Models (2020).

    Split of drive and brakes as there. The longitudinal map is computed from the power of that
    car's engine; drag, and the brake force, are assumed.
    """

    mass: float = param(_BMW_MASS, "kg", "Mass.", gt=0)
    yaw_inertia: float = param(1791.6, "kg m^2", "Moment of inertia about the z axis.", gt=0)
    l_f: float = param(_BMW_LF, "m", "Centre of mass to front axle.", gt=0)
    l_r: float = param(_BMW_LR, "m", "Centre of mass to rear axle.", gt=0)
    track_width: float = param(1.39, "m", "Distance between left and right wheels.", gt=0)
    height: float = param(0.6137, "m", "Height of the centre of mass.", gt=0)
    c_f: float = param(
        _BMW_WEIGHT * _BMW_LR, "N/rad", "Cornering stiffness of the front axle.", gt=0
    )
    c_r: float = param(
        _BMW_WEIGHT * _BMW_LF, "N/rad", "Cornering stiffness of the rear axle.", gt=0
    )
    friction: float = param(_BMW_MU, "-", "Tyre friction coefficient.", gt=0)
    drag_area: float = param(_BMW_DRAG_AREA, "m^2", "Drag coefficient times frontal area.", ge=0)
    # Four wheels of 1.7 kg m^2 on a radius of 0.344 m; the engine's own is not known.
    rotating_mass: float = param(
        57.0, "kg", "Rotating masses of engine and wheels, as the mass moved besides.", ge=0
    )
    drive_front: float = param(0.0, "-", "Share of the drive force at the front.", ge=0, le=1)
    brake_front: float = param(0.66, "-", "Share of the brake force at the front.", ge=0, le=1)
    map_acceleration: tuple[tuple[float, ...], ...] = param(
        _BMW_ACCEL, "m/s^2", "Net acceleration on a straight, a row for each throttle."
    )
    map_drag_area: float | None = param(
        None, "m^2", "Drag area the map was measured with (null: drag_area).", ge=0
    )
    max_wheel_angle: float = param(1.066, "rad", "Angle at full lock.", gt=0, le=LARGEST_ANGLE)
    ackermann: bool = param(False, "-", "Outer wheel by Ackermann, else parallel wheels.")
    steer_rate_up: float = param(
        0.4 / 1.066, "1/s", "Steering rate away from centre, in full locks a second.", gt=0
    )
    steer_rate_down: float = param(
        0.4 / 1.066, "1/s", "Steering rate to the centre, in full locks a second.", gt=0
    )
    steer_curve_speed: tuple[float, ...] = param((0.0, 50.0), "m/s", "Speeds of the curve.")
    steer_curve_factor: tuple[float, ...] = param((1.0, 1.0), "-", "Share at those speeds.")
