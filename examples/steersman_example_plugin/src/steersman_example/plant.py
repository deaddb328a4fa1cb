"""The linear single-track model: Rajamani, Vehicle Dynamics and Control, 2nd ed., eq. 2.29.

Tyre forces grow in proportion to the slip angle, without a limit; throttle and brake are
accelerations.
"""

from __future__ import annotations

import math

import numpy as np

from steersman.config import param, register
from steersman.plants.physics import PhysicsComponent
from steersman.types import FloatArray
from steersman.vehicles import Vehicle


@register("plant", "single_track")
class SingleTrack(PhysicsComponent):
    """Linear single-track model. It knows no friction limit, no wind and no brake force."""

    cannot = frozenset({"wind", "friction"})

    full_throttle: float = param(4.0, "m/s^2", "Acceleration at full throttle.", gt=0)
    full_brake: float = param(8.0, "m/s^2", "Deceleration at full brake.", gt=0)
    rolling: float = param(0.05, "1/s", "Deceleration per speed.", ge=0)

    def derivative(
        self, vehicle: Vehicle, state: FloatArray, steer: float, throttle: float, brake: float
    ) -> FloatArray:
        """Time derivative of x, y, psi, v_x, v_y and yaw rate."""
        car = vehicle
        _, _, psi, v_x, v_y, rate = state.tolist()
        v = max(v_x, 1.0)
        front = -car.c_f * ((v_y + car.l_f * rate) / v - car.wheel_angle(steer, v_x))
        rear = -car.c_r * (v_y - car.l_r * rate) / v
        push = self.full_throttle * throttle - self.full_brake * brake * math.tanh(v_x)
        lighter = (car.map_mass or car.mass) / car.mass
        return np.array([
            v_x * math.cos(psi) - v_y * math.sin(psi),
            v_x * math.sin(psi) + v_y * math.cos(psi),
            rate,
            push * lighter - self.rolling * v_x + v_y * rate,
            (front + rear) / car.mass - v_x * rate,
            (car.l_f * front - car.l_r * rear) / car.yaw_inertia,
        ])  # fmt: skip
