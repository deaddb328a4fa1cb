"""PID on the lateral error, with optional curvature and side-slip feed-forward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from steersman.config import Settings, param, register
from steersman.controllers.base import ControllerComponent
from steersman.controllers.single_track import steady_side_slip, steady_wheel_angle
from steersman.kernels.preview import curvature_at
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Waypoints that have one curvature without any fit.
_THREE = 3


class PidState(NamedTuple):
    """Integral of the error [m s], filtered derivative [m/s], last error [m] (None at first)."""

    integral: float = 0.0
    derivative: float = 0.0
    error: float | None = None


class PidGains(Settings):
    """Gains of a PID controller from lateral error [m] to normalised steering."""

    k_p: float = param(0.1, "1/m", "Proportional gain.", ge=0)
    k_i: float = param(0.02, "1/(m s)", "Integral gain.", ge=0)
    k_d: float = param(0.05, "s/m", "Derivative gain.", ge=0)
    filter_time: float = param(0.1, "s", "Time constant of the derivative's filter.", ge=0)
    integral_limit: float = param(2.0, "m s", "Bound of the integral.", ge=0)

    def update(self, state: PidState, error: float, dt: float) -> tuple[float, PidState]:
        """Steering against the error (left of the path steers right) and the new state.

        The integral stands still while the output is saturated in its direction.
        """
        slope = 0.0 if state.error is None else (error - state.error) / dt
        blend = dt / (self.filter_time + dt)
        derivative = state.derivative + blend * (slope - state.derivative)
        wanted = state.integral + error * dt
        wanted = min(max(wanted, -self.integral_limit), self.integral_limit)
        output = -(self.k_p * error + self.k_i * wanted + self.k_d * derivative)
        integral = wanted if abs(output) <= 1.0 or output * error > 0.0 else state.integral
        return output, PidState(integral, derivative, error)


class PidControllerState(NamedTuple):
    """Vehicle and control period, and what the PID carries."""

    vehicle: Vehicle
    dt: float
    pid: PidState


@register("controller", "pid")
class Pid(ControllerComponent):
    """PID on the lateral error; with ``feedforward``, plus the steering of the steady turn.

    Feed-forward (Rajamani, Vehicle Dynamics and Control, 2nd ed., sec. 3.3): wheel angle
    L kappa + K_us v^2 kappa. The steady side-slip adds its part to the lateral error ahead of
    the car, so heading is compared with the steady turn's, not with the tangent.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "gains.k_p": (1e-3, 1.0, True),
        "gains.k_i": (1e-4, 1.0, True),
        "gains.k_d": (1e-4, 0.5, True),
        "gains.filter_time": (1e-3, 0.5, True),
        "k_heading": (0.0, 3.0, False),
        "preview_time": (1e-2, 1.0, True),
        "preview_window": (4.0, 28.0, False),
    }

    gains: PidGains = param(PidGains(), "-", "Gains.")
    k_heading: float = param(0.0, "1/rad", "Gain on heading error minus its steady value.", ge=0)
    feedforward: bool = param(False, "-", "Add the steady turn's steering for the curvature.")
    preview_time: float = param(0.1, "s", "Look-ahead of the feed-forward's curvature.", ge=0)
    preview_window: float = param(
        4.0, "m", "Length of road over which that curvature is fitted, against noise.", ge=0
    )

    def init(self, vehicle: Vehicle, dt: float) -> PidControllerState:
        """State before the first step."""
        return PidControllerState(vehicle, dt, PidState())

    def decide(
        self, state: PidControllerState, observation: Observation
    ) -> tuple[float, Status, PidControllerState]:
        """Normalised steering, unclipped."""
        steer, pid = self.gains.update(state.pid, observation.lateral_error, state.dt)
        vehicle, v = state.vehicle, observation.v_x
        steady_slip = 0.0
        if self.feedforward:
            kappa = preview_curvature(observation, self.preview_time * v, self.preview_window)
            steer += vehicle.steer_for_wheel_angle(steady_wheel_angle(vehicle, v, kappa), v)
            steady_slip = steady_side_slip(vehicle, v, observation.curvature)
        steer -= self.k_heading * (observation.heading_error + steady_slip)
        return steer, Status.SOLVED, state._replace(pid=pid)


def preview_curvature(observation: Observation, distance: float, window: float = 0.0) -> float:
    """Curvature of the road ``distance`` [m] ahead [1/m].

    Linear between the curvatures at waypoints; if ``window`` [m] spans more than three of them,
    that of a least-squares parabola over arc length through all that it spans. The window is
    moved to where the preview holds it.
    """
    o = observation
    count = min(2 * round(0.5 * window / o.spacing) + 1, len(o.preview))
    if count > _THREE:
        centre = round(distance / o.spacing)
        first = min(max(centre - count // 2, 0), len(o.preview) - count)
        return _fitted_curvature(o.preview[first : first + count], o.spacing)
    if distance <= 0.0:
        return o.curvature
    return curvature_at(o.preview, o.spacing, o.curvature, distance)


def _fitted_curvature(points: FloatArray, spacing: float) -> float:
    """Curvature at the middle of the parabola x(u), y(u) that fits the points best [1/m]."""
    u = spacing * (np.arange(len(points)) - 0.5 * (len(points) - 1))
    bend = u * u - (u * u).mean()
    x_1, y_1 = (u @ points / (u @ u)).tolist()
    x_2, y_2 = (2.0 * (bend @ points) / (bend @ bend)).tolist()
    return float((x_1 * y_2 - y_1 * x_2) / max((x_1 * x_1 + y_1 * y_1) ** 1.5, 1e-12))
