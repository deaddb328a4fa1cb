"""The predictor: the observation that a car will give when the next command acts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from steersman.config import param, register
from steersman.estimators.base import PredictorComponent
from steersman.kernels import mpc_delay as model
from steersman.kernels import predict as kernel
from steersman.kernels.observe import O_PREVIEW
from steersman.kernels.predict import Predictions
from steersman.sensing import to_observation
from steersman.types import Observation
from steersman.vehicles import Vehicle

# Longest delay and longest gap in the observations that are bridged [s].
_LONGEST, _LONGEST_GAP = 1.0, 0.5


class PredictorState(NamedTuple):
    """What the predictor carries from step to step."""

    vehicle: Vehicle
    dt: float
    kept: Predictions
    time: float = -math.inf
    """Of the last observation [s]."""


@register("predictor", "single_track")
class SingleTrack(PredictorComponent):
    """The single track with linear tyres, driven through the delay by the commands under way.

    A controller that has no model of delay then steers as if there were none. The observation's
    latency counts as part of the delay.
    """

    delay: float | None = param(
        None,
        "s",
        "Time until a steering command acts; null: the vehicle's at first, then that found (up to"
        " 0.5 s) from the measured steering.",
        ge=0,
        le=_LONGEST,
    )
    disturbance_time: float | None = param(
        0.3,
        "s",
        "Time constant of the estimate of accelerations missing in the model; null: none.",
        gt=0,
    )

    def init(self, vehicle: Vehicle, dt: float) -> PredictorState:
        """State before the first observation."""
        memory = np.zeros(kernel.N_MEMORY)
        memory[kernel.DELAY] = vehicle.steer_delay if self.delay is None else self.delay
        commands = np.zeros(int((_LONGEST + _LONGEST_GAP) / dt) + 2)
        return PredictorState(vehicle, dt, Predictions(memory, commands, np.zeros(kernel.N_DELAYS)))

    def estimate(
        self, state: PredictorState, observation: Observation
    ) -> tuple[Observation, PredictorState]:
        """The observation at the time when the next command acts."""
        o = observation
        kept = Predictions(*(array.copy() for array in state.kept))
        out = np.empty(O_PREVIEW + 2 * len(o.preview))
        usable = kernel.step(
            state.vehicle.table,
            o.spacing,
            state.dt,
            self.delay is None,
            self.disturbance_time or 0.0,
            o.time != state.time,
            np.array(o[1:8]),
            np.ascontiguousarray(o.preview),
            kept,
            np.empty(model.N_MOTION),
            np.empty((2, model.N_MOTION)),
            out,
        )
        if not usable:
            return o, self.init(state.vehicle, state.dt)
        ahead = float(kept.memory[kernel.DELAY] + kept.memory[kernel.AGE])
        seen = to_observation(out, o.time + ahead, o.spacing)
        return seen, state._replace(kept=kept, time=o.time)

    def executed(self, state: PredictorState, steer: float) -> PredictorState:
        """The executed steering is the newest command under way."""
        if not state.kept.memory[kernel.BEGUN] or state.kept.commands[0] == steer:
            return state
        commands = state.kept.commands.copy()
        commands[0] = steer
        return state._replace(kept=state.kept._replace(commands=commands))
