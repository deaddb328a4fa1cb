"""Cars of CARLA, each figure with its source."""

from __future__ import annotations

from steersman.config import param, register
from steersman.vehicles.base import MODEL3_ACCEL, Vehicle


@register("vehicle", "carla_model3_v1")
class CarlaModel3V1(Vehicle):
    """The Model 3 of the first stage: results made before ``carla_model3`` was fitted to logs.

    Yaw inertia and cornering stiffnesses are those derived by others; wheels lift by the assumed
    height of the centre of mass, at half the lateral acceleration of the real one's logs.
    """


# The map above, with what seven logs of a server say besides: a row for throttle 0.25, near which
# 5 m/s are held (the closed throttle's row brakes by more than the engine), and the launch at full
# throttle, both fitted to the logs' speeds.
_FITTED_THROTTLE = (0.0, 0.25, 0.4, 0.5, 0.6, 0.8, 1.0)
_FITTED_ACCEL = (
    MODEL3_ACCEL[0],
    (1.12, 0.25, -1.11, -2.99, -4.91, -6.20, -10.90),
    *MODEL3_ACCEL[1:5],
    (4.25, 6.65, 6.60, 6.76, 6.17, 5.99, 5.33),
)


@register("vehicle", "carla_model3")
class CarlaModel3(Vehicle):
    """Tesla Model 3 of CARLA 0.9.15/0.9.16, fitted to the logs of a real server.

    Mass, geometry, drag: CARLA's blueprint. Steering law and throttle map: measured on 0.9.16.
    Cornering stiffnesses, their growth with load, rotating masses: PhysX's laws with the
    blueprint's figures, which the logs confirm. Yaw inertia, friction, roll arm, steering rates
    and some of the map: fitted to the logs (docs/vehicle.md has intervals and what is not told).
    """

    yaw_inertia: float = param(2870.0, "kg m^2", "Moment of inertia about the z axis.", gt=0)
    roll_arm: float | None = param(
        0.08, "m", "Arm of the tyre forces by which accelerations shift wheel loads.", ge=0
    )
    # 2 x 20 F_rest S(1) for the two tyres of an axle, S of PhysX's law.
    c_f: float = param(155_690.0, "N/rad", "Cornering stiffness of the front axle.", gt=0)
    c_r: float = param(99_040.0, "N/rad", "Cornering stiffness of the rear axle.", gt=0)
    stiffness_load_limit: float | None = param(
        3.0, "-", "Static loads from which a tyre grows no stiffer, by PhysX's law.", gt=0
    )
    friction: float = param(3.0, "-", "Tyre friction coefficient.", gt=0)
    # J_engine i^2 / R^2 + 4 J_wheel / R^2 = 592 + 40 kg.
    rotating_mass: float = param(
        632.0, "kg", "Rotating masses of engine and wheels, as the mass moved besides.", ge=0
    )
    steer_rate_up: float = param(
        5.0, "1/s", "Steering rate away from centre, in full locks a second.", gt=0
    )
    steer_rate_down: float = param(
        10.0, "1/s", "Steering rate to the centre, in full locks a second.", gt=0
    )
    map_throttle: tuple[float, ...] = param(_FITTED_THROTTLE, "-", "Throttles of the map.")
    map_acceleration: tuple[tuple[float, ...], ...] = param(
        _FITTED_ACCEL, "m/s^2", "Net acceleration on a straight, a row for each throttle."
    )


@register("vehicle", "carla_mkz2020")
class CarlaMkz2020(Vehicle):
    """Lincoln MKZ 2020 of CARLA: mass, geometry, inertia and stiffnesses from public sources.

    Steering law and throttle map are those of the Model 3 (not measured for this car).
    """

    mass: float = param(1696.0, "kg", "Mass.", gt=0)
    yaw_inertia: float = param(2916.0, "kg m^2", "Moment of inertia about the z axis.", gt=0)
    l_f: float = param(1.172, "m", "Centre of mass to front axle.", gt=0)
    l_r: float = param(1.689, "m", "Centre of mass to rear axle.", gt=0)
    c_f: float = param(82_900.0, "N/rad", "Cornering stiffness of the front axle.", gt=0)
    c_r: float = param(54_400.0, "N/rad", "Cornering stiffness of the rear axle.", gt=0)
    drag_area: float = param(0.66, "m^2", "Drag coefficient times frontal area.", ge=0)
    map_drag_area: float | None = param(
        None, "m^2", "Drag area the map was measured with (null: drag_area).", ge=0
    )
