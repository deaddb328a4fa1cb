"""PID on the lateral error, with optional curvature and side-slip feed-forward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from steersman.config import Settings, param, register
from steersman.controllers.base import ControllerComponent
from steersman.controllers.plausible import moving_time
from steersman.controllers.single_track import (
    preview_curvature,
    steady_side_slip,
    steady_wheel_angle,
)
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle

# A lateral error that changes faster than this beyond the car's speed is a jump of the measurement,
# and says nothing about the car's motion [m/s].
_JUMP = 20.0


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

    def update(
        self, state: PidState, error: float, v_x: float, dt: float
    ) -> tuple[float, PidState]:
        """Steering against the error (left of the path steers right) and the new state.

        The integral stands still while the output is saturated in its direction, while the car
        stands and where the error jumps; the derivative too where the error jumps.

        Args:
            state: what the PID carries.
            error: lateral error [m].
            v_x: longitudinal velocity [m/s].
            dt: control period [s].
        """
        slope = 0.0 if state.error is None else (error - state.error) / dt
        blend, moved = dt / (self.filter_time + dt), moving_time(v_x, dt)
        if abs(slope) > _JUMP + abs(v_x):
            blend = moved = 0.0
        derivative = state.derivative + blend * (slope - state.derivative)
        wanted = state.integral + error * moved
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
        vehicle, v = state.vehicle, observation.v_x
        steer, pid = self.gains.update(state.pid, observation.lateral_error, v, state.dt)
        steady_slip = 0.0
        if self.feedforward:
            kappa = preview_curvature(observation, self.preview_time * v, self.preview_window)
            steer += vehicle.steer_for_wheel_angle(steady_wheel_angle(vehicle, v, kappa), v)
            steady_slip = steady_side_slip(vehicle, v, observation.curvature)
        steer -= self.k_heading * (observation.heading_error + steady_slip)
        return steer, Status.SOLVED, state._replace(pid=pid)
