"""From CARLA's physics control to our parameters, and from its wheel to our steering.

``get_physics_control`` has mass, centre of mass, wheels, steering curve, drag and brakes. It does
not have the yaw inertia (its ``moi`` is the engine's), axle stiffnesses in N/rad, the height of
the centre of mass, pedal and steering rates, or what acceleration a throttle gives: these come from
the vehicle that is given, by name, by file, or from ``steersman carla calibrate``.
"""

from __future__ import annotations

import math
from typing import Any

from steersman.config import build
from steersman.errors import ConfigError, PlantError
from steersman.kernels import vehicle as kernel
from steersman.plants.carla_frame import CarlaFrame, Placement
from steersman.vehicles import KMH, Vehicle

_CM = 0.01
_WHEELS = 4
# Frontal area that goes with the drag coefficient [m^2]; vehicles.py assumes the same.
_FRONTAL_AREA = 2.2
# Figures that differ by less are the same; wheels are given in cm from the map's origin.
_SINGLE = 1e-4
# Axles nearer to each other are none: some servers leave the wheels' positions at zero [m].
_SHORTEST = 0.5


def offset_of(physics: Any) -> CarlaFrame:
    """Where the centre of mass is."""
    centre = physics.center_of_mass
    return CarlaFrame(float(centre.x), 0.0 - float(centre.y))


def vehicle_of(physics: Any, base: Vehicle, at: Placement, size: tuple[float, float]) -> Vehicle:
    """``base`` with CARLA's figures; those that agree are kept as they are given.

    Args:
        physics: ``carla.VehiclePhysicsControl``.
        base: the figures that CARLA does not give.
        at: where the vehicle stood: its wheels are given in the world's axes.
        size: length and width of the body [m].

    Raises:
        PlantError: it has not four wheels, or its figures are no car's.
    """
    wheels = list(physics.wheels)
    if len(wheels) != _WHEELS:
        raise PlantError(f"the vehicle has {len(wheels)} wheels; only cars with {_WHEELS} can be")
    force = sum(w.max_brake_torque / max(_CM * w.radius, 0.1) for w in wheels)
    front = sum(w.max_brake_torque / max(_CM * w.radius, 0.1) for w in wheels[:2])
    curve = [(point.x * KMH, point.y) for point in physics.steering_curve]
    figures: dict[str, Any] = {
        "mass": physics.mass,
        "drag_area": _FRONTAL_AREA * physics.drag_coefficient,
        "friction": sum(w.tire_friction for w in wheels) / _WHEELS,
        "max_wheel_angle": math.radians(max(w.max_steer_angle for w in wheels[:2])),
        "brake_force": force,
        "brake_front": front / force if force > 0.0 else base.brake_front,
        "body_length": size[0],
        "width": size[1],
        **_axles(wheels, offset_of(physics), at),
    }
    if len(curve) > 1:
        figures["steer_curve_speed"] = tuple(speed for speed, _ in curve)
        figures["steer_curve_factor"] = tuple(factor for _, factor in curve)
    news = {name: value for name, value in figures.items() if not _same(getattr(base, name), value)}
    if not news:
        return base
    try:
        return build(type(base), base.model_dump() | news)
    except ConfigError as error:
        raise PlantError(f"the vehicle's physics control is no car's: {error}") from None


def _same(known: Any, given: Any) -> bool:
    """Whether two figures agree but for CARLA's single precision, which is not to spread here."""
    if isinstance(given, tuple):
        return len(known) == len(given) and all(map(_same, known, given))
    return math.isclose(known, given, rel_tol=_SINGLE, abs_tol=_SINGLE)


def _axles(wheels: list[Any], offset: CarlaFrame, at: Placement) -> dict[str, float]:
    """Distances of the axles from the centre of mass and of the wheels from each other [m]."""
    psi = CarlaFrame.radians_left(at.yaw)
    places = [
        CarlaFrame.body_vector(psi, _CM * w.position.x - at.x, _CM * w.position.y - at.y)
        for w in wheels
    ]
    front = 0.5 * (places[0][0] + places[1][0]) - offset.ahead
    rear = offset.ahead - 0.5 * (places[2][0] + places[3][0])
    width = places[0][1] - places[1][1]
    if min(front, rear, width) < _SHORTEST:
        return {}
    return {"l_f": front, "l_r": rear, "track_width": width}


def steering(vehicle: Vehicle, left_wheel: float, v_x: float) -> tuple[float, float]:
    """Normalised steering and single-track angle [rad] from the left front wheel's angle [rad].

    The inverse of :func:`steersman.kernels.vehicle.wheel_tangents`.
    """
    row = vehicle.table.rows[0]
    tangent = math.tan(abs(left_wheel))
    if left_wheel < 0.0:  # then it is the outer one
        tangent /= max(1.0 - row[kernel.ACKERMANN] * tangent, 1e-9)
    factor = kernel.interpolate(vehicle.table.steer_speed, vehicle.table.steer_factor, abs(v_x))
    steer = math.copysign(math.atan(tangent) / (row[kernel.MAX_STEER] * factor), left_wheel)
    middle = math.atan(tangent / (1.0 + 0.5 * row[kernel.ACKERMANN] * tangent))
    return float(steer - row[kernel.STEER_BIAS]), math.copysign(middle, left_wheel)
