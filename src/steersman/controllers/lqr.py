"""LQR on the error dynamics, with the steady turn's wheel angle as feed-forward.

Rajamani, Vehicle Dynamics and Control, 2nd ed., sec. 2.5 (model), 3.1 and 3.2 (state feedback and
feed-forward); the gain is that of the discrete-time regulator (Anderson and Moore, Optimal
Control: Linear Quadratic Methods, 1990, sec. 2.4). docs/controllers.md has the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent
from steersman.controllers.riccati import regulators
from steersman.controllers.single_track import (
    discrete,
    error_model,
    errors,
    preview_curvature,
    steady_side_slip,
    steady_wheel_angle,
)
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Speeds at which gains are computed [m/s]; below the first and above the last its gain is held.
_SPEEDS = tuple(1.0 + 0.5 * i for i in range(79))
# What the columns of the gains multiply, and their units.
_ERRORS = (
    ("rad/m", "e_y, the lateral error,"),
    ("rad s/m", "the rate of e_y"),
    ("-", "the heading error"),
    ("s", "the rate of the heading error"),
)


class LqrState(NamedTuple):
    """The nominal vehicle and its gains, a row for each speed; nothing changes."""

    vehicle: Vehicle
    gains: FloatArray
    """(speeds, 4) wheel angle [rad] for each error; a held speed step is 0.5 m/s."""

    @staticmethod
    def number(_: str, i: int) -> tuple[str, str]:
        """Unit and meaning of number ``i`` of the gains, row by row."""
        unit, error = _ERRORS[i % len(_ERRORS)]
        return unit, f"Gain of {error} at {_SPEEDS[i // len(_ERRORS)]:g} m/s."


@register("controller", "lqr")
class Lqr(ControllerComponent):
    """Linear-quadratic regulator of the lateral errors, gain-scheduled over speed.

    delta = delta_steady(kappa) - K(v) (xi - xi_steady(kappa)), with xi the errors of the
    centre of mass and K from the discrete Riccati equation at the control period.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "q_lateral": (1e-2, 100.0, True),
        "q_lateral_rate": (1e-4, 10.0, True),
        "q_heading": (1e-2, 100.0, True),
        "q_yaw_rate": (1e-4, 10.0, True),
        "preview_time": (1e-2, 1.0, True),
    }

    q_lateral: float = param(1.0, "1/m^2", "Weight of the squared lateral error.", gt=0)
    q_lateral_rate: float = param(0.01, "s^2/m^2", "Weight of its squared rate.", ge=0)
    q_heading: float = param(1.0, "1/rad^2", "Weight of the squared heading error.", ge=0)
    q_yaw_rate: float = param(0.01, "s^2/rad^2", "Weight of its squared rate.", ge=0)
    r: float = param(2.0, "1/rad^2", "Weight of the squared wheel angle.", gt=0)
    preview_time: float = param(0.05, "s", "Look-ahead of the feed-forward's curvature.", ge=0)

    def init(self, vehicle: Vehicle, dt: float) -> LqrState:
        """Solve the Riccati equation at each speed for the vehicle's nominal parameters."""
        weights = (self.q_lateral, self.q_lateral_rate, self.q_heading, self.q_yaw_rate)
        return LqrState(vehicle, _schedule(vehicle, dt, weights, self.r))

    def decide(self, state: LqrState, observation: Observation) -> tuple[float, Status, LqrState]:
        """Normalised steering, unclipped."""
        vehicle, o = state.vehicle, observation
        v = max(o.v_x, 0.0)
        e1, e1_rate, e2, e2_rate = errors(o)
        k1, k2, k3, k4 = gain_at(state.gains, v)
        angle = steady_wheel_angle(vehicle, v, preview_curvature(o, self.preview_time * v))
        e2 += steady_side_slip(vehicle, v, o.curvature)
        angle -= k1 * e1 + k2 * e1_rate + k3 * e2 + k4 * e2_rate
        return vehicle.steer_for_wheel_angle(angle, o.v_x), Status.SOLVED, state


def gain_at(gains: FloatArray, v: float) -> tuple[float, float, float, float]:
    """The gains at speed ``v`` [m/s], linear between those that were computed."""
    at = min(max((v - _SPEEDS[0]) / (_SPEEDS[1] - _SPEEDS[0]), 0.0), len(_SPEEDS) - 1.001)
    i = int(at)
    w = at - i
    low, high = gains[i : i + 2].tolist()
    k1, k2, k3, k4 = [(1.0 - w) * a + w * b for a, b in zip(low, high, strict=True)]
    return k1, k2, k3, k4


@lru_cache(maxsize=64)
def _schedule(vehicle: Vehicle, dt: float, weights: tuple[float, ...], r: float) -> FloatArray:
    a, b = _models(vehicle, dt)
    gains = regulators(a, b, np.diag(weights), r)
    gains.setflags(write=False)
    return gains


@lru_cache(maxsize=64)
def _models(vehicle: Vehicle, dt: float) -> tuple[FloatArray, FloatArray]:
    """Errors over a period (speeds, 4, 4), and the effect of the wheel angle (speeds, 4)."""
    models = [discrete(error_model(vehicle, v), dt) for v in _SPEEDS]
    a, b = np.array([each.a for each in models]), np.array([each.b for each in models])
    for each in (a, b):
        each.setflags(write=False)
    return a, b
