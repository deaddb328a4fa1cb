"""CARLA's physics control of a vehicle, from our parameters and back into them.

What our model knows is translated; the rest is filled in with the figures of CARLA's Model 3 (or
the engine's defaults), kept when a client changes it, and without effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import steersman as sm
from carla_standin.actors import Actor
from carla_standin.catalogue import VehicleBlueprint
from carla_standin.wire import Refused, Transform, shaped

_KMH_PER_M_S = 3.6
_CM = 100.0
_FRONTAL_AREA = 2.2
_WHEELS = 4
# Clients set none at all, as CARLA's own tests do; the tyre model needs some.
_LEAST_FRICTION = 1e-3
# Model 3: engine torque [Nm] over speed [rpm], and final ratio; lateral stiffness at that load.
_TORQUE = [[0.0, 743.0], [9000.0, 743.0], [15000.0, 502.0]]
_MAX_RPM, _FINAL_RATIO = 15000.0, 9.0
_DAMPING = (0.15, 2.0, 0.35)
_MAX_LOAD, _SIDE_STIFFNESS, _LONG_STIFFNESS = 3.0, 20.0, 3000.0


class PhysicsControl(NamedTuple):
    """The seventeen values, in the order in which they travel."""

    torque_curve: list[list[float]]
    max_rpm: float
    moi: float
    damping_full_throttle: float
    damping_zero_throttle_engaged: float
    damping_zero_throttle_disengaged: float
    use_gear_autobox: bool
    gear_switch_time: float
    clutch_strength: float
    final_ratio: float
    forward_gears: list[list[float]]
    mass: float
    drag_coefficient: float
    center_of_mass: list[float]
    steering_curve: list[list[float]]
    wheels: list[list[Any]]
    use_sweep_wheel_collision: bool


class WheelPhysics(NamedTuple):
    """The ten values of a wheel, in the order in which they travel; lengths in cm."""

    tire_friction: float
    damping_rate: float
    max_steer_angle: float
    radius: float
    max_brake_torque: float
    max_handbrake_torque: float
    lat_stiff_max_load: float
    lat_stiff_value: float
    long_stiff_value: float
    position: list[float]


_PAIRS, _TRIPLE = [(0.0, 0.0)], (0.0, 0.0, 0.0)
# What a physics control looks like on the wire.
_LIKE = (
    _PAIRS,
    *(0.0,) * 5,
    False,
    *(0.0,) * 3,
    [_TRIPLE],
    0.0,
    0.0,
    _TRIPLE,
    _PAIRS,
    [(*(0.0,) * 9, _TRIPLE)],
    False,
)


def read_out(actor: Actor) -> list[Any]:
    """The physics control of a vehicle; positions of wheels are in the world's axes."""
    model = _model(actor)
    kept = actor.applied_physics
    physics = PhysicsControl(*kept) if kept is not None else describe(model)
    places = _wheel_places(model, actor.transform)
    wheels = [[*wheel[:9], place] for wheel, place in zip(physics.wheels, places, strict=True)]
    return list(physics._replace(wheels=wheels))


def describe(model: VehicleBlueprint) -> PhysicsControl:
    """The physics control of a vehicle as it is spawned."""
    car = model.vehicle
    torque = car.brake_force * model.radius / _WHEELS
    shares = (car.brake_front, 1.0 - car.brake_front)
    wheels = [
        list(
            WheelPhysics(
                tire_friction=car.friction,
                damping_rate=0.25,
                max_steer_angle=math.degrees(car.max_wheel_angle) if front else 0.0,
                radius=_CM * model.radius,
                max_brake_torque=2.0 * torque * shares[0 if front else 1],
                max_handbrake_torque=0.0 if front else 1400.0,
                lat_stiff_max_load=_MAX_LOAD,
                lat_stiff_value=_SIDE_STIFFNESS,
                long_stiff_value=_LONG_STIFFNESS,
                position=[0.0, 0.0, 0.0],
            )
        )
        for front in (True, True, False, False)
    ]
    return PhysicsControl(
        torque_curve=_TORQUE,
        max_rpm=_MAX_RPM,
        moi=1.0,
        damping_full_throttle=_DAMPING[0],
        damping_zero_throttle_engaged=_DAMPING[1],
        damping_zero_throttle_disengaged=_DAMPING[2],
        use_gear_autobox=True,
        gear_switch_time=0.0,
        clutch_strength=10.0,
        final_ratio=_FINAL_RATIO,
        forward_gears=[[1.0, 0.5, 0.65]],
        mass=car.mass,
        drag_coefficient=car.drag_area / _FRONTAL_AREA,
        center_of_mass=[model.offset, 0.0, model.below],
        steering_curve=[
            [v * _KMH_PER_M_S, f]
            for v, f in zip(car.steer_curve_speed, car.steer_curve_factor, strict=True)
        ],
        wheels=wheels,
        use_sweep_wheel_collision=False,
    )


def apply(actor: Actor, values: Any) -> list[str]:
    """Take a physics control from the wire, value by value; says what has no effect, and why.

    Mass, drag, centre of mass along the car, steering curve, lock, friction, brakes and lateral
    stiffness act. Stiffness goes with the load that stands on the axle and yaw inertia with mass,
    as they do in the engine; the drive force stays what it was. Where a value describes no car,
    the one before stays.

    Raises:
        Refused: it is none.
    """
    spawned = _model(actor)
    new, old = PhysicsControl(*shaped(values, _LIKE)), describe(spawned)
    taken = old if actor.applied_physics is None else PhysicsControl(*actor.applied_physics)
    standard, idle = _vehicle(spawned, old), []
    for name in PhysicsControl._fields:
        for what, part in _parts(new, name):
            try:
                _vehicle(spawned, part(taken))
            except sm.ConfigError as error:
                idle.append(f"{what} ({error})")
                continue
            taken = part(taken)
            if not _alike(getattr(part(old), name), getattr(old, name)) and _same(
                spawned, part(old), standard
            ):
                idle.append(what)
    vehicle, offset = _vehicle(spawned, taken)
    assert actor.car is not None
    actor.car.fit(vehicle, offset)
    actor.applied_physics = list(taken)
    return list(dict.fromkeys(idle))


def _same(
    spawned: VehicleBlueprint, changed: PhysicsControl, standard: tuple[sm.Vehicle, float]
) -> bool:
    """Whether a physics control makes the car that its blueprint has."""
    try:
        return _vehicle(spawned, changed) == standard
    except sm.ConfigError:  # beside what else was changed before, it made one
        return False


_Change: TypeAlias = Callable[[PhysicsControl], PhysicsControl]


def _parts(new: PhysicsControl, name: str) -> list[tuple[str, _Change]]:
    """The changes of a field that stand for themselves, each with its name.

    Of wheels each figure of all four, but for their places, which are only told; of a vector each
    component.
    """
    if name == "wheels" and len(new.wheels) == _WHEELS:

        def column(k: int, taken: PhysicsControl) -> PhysicsControl:
            rows = zip(taken.wheels, new.wheels, strict=True)
            return taken._replace(wheels=[[*old[:k], row[k], *old[k + 1 :]] for old, row in rows])

        figures = WheelPhysics._fields[:-1]
        return [(f"wheels.{each}", partial(column, k)) for k, each in enumerate(figures)]
    if name == "center_of_mass":

        def component(k: int, taken: PhysicsControl) -> PhysicsControl:
            old, values = taken.center_of_mass, new.center_of_mass
            return taken._replace(center_of_mass=[*old[:k], values[k], *old[k + 1 :]])

        return [(f"{name}.{axis}", partial(component, k)) for k, axis in enumerate("xyz")]
    return [(name, lambda taken: taken._replace(**{name: getattr(new, name)}))]


def _vehicle(spawned: VehicleBlueprint, new: PhysicsControl) -> tuple[sm.Vehicle, float]:
    """Our parameters, and the offset of the centre of mass [m], of a physics control."""
    base = spawned.vehicle
    if len(new.wheels) != _WHEELS:
        raise sm.ConfigError(f"{len(new.wheels)} wheels; {_WHEELS} are known here")
    wheels = [WheelPhysics(*values) for values in new.wheels]
    if new.mass <= 0.0 or not math.isfinite(new.mass):
        raise sm.ConfigError(f"mass {new.mass} kg; must be above 0")
    offset = float(new.center_of_mass[0])
    l_f = base.l_f - (offset - spawned.offset)
    l_r = base.wheelbase - l_f
    if min(l_f, l_r) <= 0.0:
        raise sm.ConfigError(f"centre of mass at {offset} m; must lie between the axles")
    heavier = new.mass / base.mass
    stiffer = [
        0.5 * (a.lat_stiff_value + b.lat_stiff_value) / _SIDE_STIFFNESS
        for a, b in (wheels[:2], wheels[2:])
    ]
    front, rear = (
        0.5 * (a.max_brake_torque + b.max_brake_torque) for a, b in (wheels[:2], wheels[2:])
    )
    force = 2.0 * (front + rear) / spawned.radius
    vehicle = base.replace(
        mass=new.mass,
        map_mass=base.mass if base.map_mass is None else base.map_mass,
        map_drag_area=base.drag_area if base.map_drag_area is None else base.map_drag_area,
        yaw_inertia=base.yaw_inertia * heavier,
        l_f=l_f,
        l_r=l_r,
        c_f=base.c_f * heavier * l_r / base.l_r * stiffer[0],
        c_r=base.c_r * heavier * l_f / base.l_f * stiffer[1],
        friction=max(sum(w.tire_friction for w in wheels) / _WHEELS, _LEAST_FRICTION),
        drag_area=new.drag_coefficient * _FRONTAL_AREA,
        brake_force=force,
        brake_front=front / (front + rear) if force > 0.0 else base.brake_front,
        max_wheel_angle=math.radians(wheels[0].max_steer_angle),
        steer_curve_speed=tuple(v / _KMH_PER_M_S for v, _ in new.steering_curve),
        steer_curve_factor=tuple(f for _, f in new.steering_curve),
    )
    return vehicle, offset


def _wheel_places(model: VehicleBlueprint, where: Transform) -> list[list[float]]:
    """Where the wheels are in CARLA's world [cm]; left is negative y."""
    car, half = model.vehicle, 0.5 * model.vehicle.track_width
    ahead = (car.l_f + model.offset, model.offset - car.l_r)
    places = []
    for along, across in ((0, -half), (0, half), (1, -half), (1, half)):
        at = where.placed(Transform(ahead[along], across, model.radius))
        places.append([_CM * at.x, _CM * at.y, _CM * at.z])
    return places


def _model(actor: Actor) -> VehicleBlueprint:
    if actor.model is None:
        raise Refused(f"actor {actor.number} ({actor.kind}) is no vehicle")
    return actor.model


def _alike(was: Any, now: Any) -> bool:
    """Whether two values, or lists of them, are the same but for float32 rounding."""
    if isinstance(was, list):
        return (
            isinstance(now, list)
            and len(was) == len(now)
            and all(_alike(a, b) for a, b in zip(was, now, strict=True))
        )
    return math.isclose(float(was), float(now), rel_tol=1e-6)
