"""A kinematic single-track car, integrated here, for controllers whose closed forms assume one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.controllers.base import ControllerComponent
from steersman.kernels.vehicle import wheel_tangents
from steersman.paths.base import PathComponent
from steersman.types import FloatArray, VehicleState

from ..loops import CAR, observe

# Tyres that do not slip: what a controller reckons with for them vanishes.
STIFF = CAR.replace(c_f=1e12, c_r=1e12)


class Run(NamedTuple):
    """Lateral error [m] of three points of the car at every step, left positive."""

    rear: FloatArray
    centre: FloatArray
    front: FloatArray


def drive_kinematic(
    controller: ControllerComponent,
    path: PathComponent,
    v: float,
    *,
    d: float = 0.0,
    heading: float = 0.0,
    duration: float = 30.0,
    dt: float = 0.01,
) -> Run:
    """Start the rear axle ``d`` [m] beside the path's start and drive at ``v`` [m/s]."""
    state = controller.init(STIFF, dt)
    at = path.at(0.0)
    x, y, psi = at.x - d * math.sin(at.psi), at.y + d * math.cos(at.psi), at.psi + heading
    steer = rate = s = 0.0
    out = []
    for i in range(round(duration / dt)):
        points = [
            (x + ahead * math.cos(psi), y + ahead * math.sin(psi))
            for ahead in (0.0, STIFF.l_r, STIFF.wheelbase)
        ]
        out.append([path.project(*p, near=s + 1.0)[1] for p in points])
        s = path.project(*points[1], near=s)[0]
        car = VehicleState(
            i * dt, *points[1], psi, v, STIFF.l_r * rate, rate, 0.0, v * rate, steer, 0.0, 0.0, 0.0
        )
        decision, state = controller.step(state, observe(path, car, s))
        steer = decision.steer
        rate = v * wheel_tangents(STIFF.table, 0, steer, v)[2] / STIFF.wheelbase
        middle = psi + 0.5 * rate * dt
        x, y, psi = x + v * dt * math.cos(middle), y + v * dt * math.sin(middle), psi + rate * dt
    return Run(*np.array(out).T)
