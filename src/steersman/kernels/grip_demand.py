"""The share of the tyres' grip that the path and the speeds of a drive need.

Each axle carries its part of m v^2 kappa (steady turn) and of what drives or brakes the car; the
resultant over friction times load is its share ("friction circle", Rajamani, Vehicle Dynamics and
Control, 2nd ed., sec. 13.10.2), the load with the transfer by the acceleration. The car follows its
speeds as well as engine and brakes allow.
"""

from __future__ import annotations

import math

from steersman.kernels import path as paths
from steersman.kernels import vehicle as car
from steersman.kernels.compiled import kernel
from steersman.kernels.path import PathTable
from steersman.kernels.speed import CONSTANT_THROTTLE, IS_PROFILE, SpeedTable, target_speed
from steersman.kernels.vehicle import VehicleTable
from steersman.types import FloatArray


@kernel
def axle_share(row: FloatArray, a_x: float, pull: float, side: float) -> float:
    """The larger of both axles' horizontal forces over their loads [-].

    ``pull`` and ``side`` are the car's longitudinal and lateral force [N] at the acceleration
    ``a_x`` along its axis [m/s^2].
    """
    base, weight = row[car.L_F] + row[car.L_R], row[car.MASS] * car.GRAVITY
    front = row[car.DRIVE_FRONT] if pull > 0.0 else row[car.BRAKE_FRONT]
    load_f = (weight * row[car.L_R] - row[car.MASS] * a_x * row[car.ROLL_ARM]) / base
    share_f = math.hypot(front * pull, side * row[car.L_R] / base) / load_f
    share_r = math.hypot((1.0 - front) * pull, side * row[car.L_F] / base) / (weight - load_f)
    return float(max(share_f, share_r))


@kernel
def largest_share(  # noqa: PLR0917 - numba takes no keyword-only arguments
    vehicle: VehicleTable,
    speed: SpeedTable,
    path: PathTable,
    grip: FloatArray,
    step: float,
    start: float,
    v: float,
    dt: float,
    seconds: float,
    distance: float,
) -> float:
    """The largest share of grip [-] on a drive from arc length ``start`` at speed ``v``.

    Args:
        vehicle: one vehicle.
        speed: its demand of speed on this path.
        path: one path.
        grip: factor on the vehicle's friction at every ``step`` along the path.
        step: distance between two [m].
        start: arc length at which the drive begins [m].
        v: its speed there [m/s].
        dt: control period [s].
        seconds: time after which it ends [s].
        distance: distance after which it ends [m].
    """
    row, tracks = vehicle.rows[0], speed.rows[0, IS_PROFILE] > 0.0
    length, closed = path.meta[0, paths.LENGTH], path.meta[0, paths.CLOSED] > 0.0
    mass, moved = row[car.MASS], row[car.MASS] + row[car.ROTATING]
    hardest = -row[car.BRAKE_FORCE] / mass
    gone, time, most = 0.0, 0.0, 0.0
    while time < seconds and gone < distance:
        s = start + gone
        if closed:
            s %= length
        held = row[car.MU] * grip[min(int(s / step), grip.shape[0] - 1)]
        throttle = 1.0 if tracks else speed.rows[0, CONSTANT_THROTTLE]
        front, rear = car.wheel_demand(vehicle, 0, throttle, 0.0, v)
        change = (front + rear - row[car.DRAG] * v * v) / moved
        if tracks:
            wanted = target_speed(speed, 0, path, 0, time + dt, s + v * dt)
            change = max(min((wanted - v) / dt, change), hardest)
        pull = mass * change + row[car.DRAG] * v * v
        side = mass * v * v * paths.at(path, 0, s)[3]
        most = max(most, axle_share(row, change, pull, side) / held)
        v = max(v + change * dt, 0.0)
        gone += v * dt
        time += dt
    return most
