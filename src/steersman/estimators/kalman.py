"""The state estimator: car, road and biases from all observations so far."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pydantic.fields import FieldInfo

from steersman.config import param, register
from steersman.estimators.base import EstimatorComponent
from steersman.kernels import estimate as kernel
from steersman.kernels.estimate_update import (
    BEGUN,
    COMMAND,
    N_MEMORY,
    NOW,
    Estimates,
    EstimatorWork,
)
from steersman.kernels.observe import O_PREVIEW
from steersman.kernels.road_walk import N_MOVED, NODES
from steersman.sensing import to_observation
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle

# Cells of the road beyond the car's own, at most.
_CELLS = 16
# Fields in the order of the kernel's settings.
_SETTINGS = ("curvature_change", "v_y_bias", "yaw_rate_bias", "v_x_scale", "exact")
_NOTHING = Estimates(np.zeros(N_MEMORY), np.zeros(0), np.zeros((0, 0)))


class KalmanState(NamedTuple):
    """What the estimator carries from step to step."""

    vehicle: Vehicle
    dt: float
    settings: FloatArray
    kept: Estimates

    @staticmethod
    def setting(_: str, i: int) -> tuple[str, FieldInfo]:
        """Name and declaration of the field that number ``i`` of the settings is."""
        return _SETTINGS[i], Kalman.model_fields[_SETTINGS[i]]


@register("estimator", "kalman")
class Kalman(EstimatorComponent):
    """Extended Kalman filter of the car, of the road ahead and of the sensors' biases.

    The noise of waypoints, pose and velocities is found from the measurements; an exact road passes
    unchanged. Outliers are left out, lost samples are bridged by the prediction.
    """

    curvature_change: float = param(
        1.4e-3, "1/m", "SD of the change of the road's curvature over a metre.", gt=0
    )
    v_y_bias: float = param(0.05, "m/s", "SD of the constant error of v_y.", ge=0)
    yaw_rate_bias: float = param(0.01, "rad/s", "SD of the constant error of the yaw rate.", ge=0)
    v_x_scale: float = param(0.03, "-", "SD of the relative error of v_x.", ge=0)
    exact: float = param(
        4e-3, "m", "Errors of the waypoints up to which the road passes unchanged.", ge=0
    )

    def init(self, vehicle: Vehicle, dt: float) -> KalmanState:
        """State before the first observation."""
        settings = np.array([getattr(self, name) for name in _SETTINGS])
        return KalmanState(vehicle, dt, settings, _NOTHING)

    def estimate(
        self, state: KalmanState, observation: Observation
    ) -> tuple[Observation, KalmanState]:
        """The posterior's observation, at the time of the measurement."""
        o, n = observation, len(observation.preview)
        span = (n - 1) * o.spacing
        h = max(o.spacing, span / _CELLS)
        size = NODES + int(span / h + 0.5) + 4
        if len(state.kept.mean) == size:
            kept = Estimates(*(array.copy() for array in state.kept))
        else:
            kept = Estimates(np.zeros(N_MEMORY), np.zeros(size), np.zeros((size, size)))
        work = EstimatorWork(
            np.empty((2 * N_MOVED, size)),
            np.empty((n, 2)),
            np.empty(n),
            np.empty((n, size)),
            np.empty(2 * n),
        )
        row, preview = np.array(o[1:8]), np.ascontiguousarray(o.preview)
        out = np.empty(O_PREVIEW + 2 * n)
        usable = kernel.step(
            *(state.vehicle.table, 0, state.settings, o.spacing, h, state.dt, o.time),
            *(row, preview, kept, work, out),
        )
        if not usable:
            return o, state._replace(kept=_NOTHING)
        return to_observation(out, float(kept.memory[NOW]), o.spacing), state._replace(kept=kept)

    def executed(self, state: KalmanState, steer: float) -> KalmanState:
        """A lost sample is bridged by the steering that goes to this command."""
        if not state.kept.memory[BEGUN] or state.kept.memory[COMMAND] == steer:
            return state
        memory = state.kept.memory.copy()
        memory[COMMAND] = steer
        return state._replace(kept=state.kept._replace(memory=memory))
