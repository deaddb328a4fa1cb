"""PID on the bearing of a waypoint, as CARLA's example agents steer.

What the lateral controller of CARLA 0.9.15's ``agents.navigation`` computes, with its published
gains as defaults; a PID on the lateral error cannot express it. docs/controllers.md has the
equations and the differences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from steersman.config import param, register
from steersman.controllers.base import ControllerComponent
from steersman.kernels.preview import at_distance
from steersman.types import Observation, Status
from steersman.vehicles import Vehicle


class BearingPidState(NamedTuple):
    """Control period [s], the last bearings [rad], newest last, and the last command.

    Bearings of before the first step are zero; there is no command then.
    """

    dt: float
    bearings: tuple[float, ...]
    steer: float | None = None


@register("controller", "bearing_pid")
class BearingPid(ControllerComponent):
    """PID on the angle between the car's axis and the road's point ahead; CARLA's gains.

    It uses no model of the car: gains and look-ahead are tuned to the steering law of CARLA's cars.
    """

    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {
        "k_p": (0.05, 5.0, True),
        "k_i": (1e-3, 5.0, True),
        "k_d": (1e-3, 1.0, True),
        "look_ahead_time": (0.05, 1.5, True),
        "look_ahead_offset": (1.0, 10.0, True),
    }

    k_p: float = param(1.95, "1/rad", "Gain on the bearing.", ge=0)
    k_i: float = param(0.05, "1/(rad s)", "Gain on its sum over the window.", ge=0)
    k_d: float = param(0.2, "s/rad", "Gain on its change.", ge=0)
    window: int = param(10, "-", "Bearings that are summed up.", ge=2, le=1000)
    look_ahead_time: float = param(
        0.5, "s", "Distance of the point is this times the speed, plus the offset.", ge=0
    )
    look_ahead_offset: float = param(3.0, "m", "Distance of the point at standstill.", gt=0)
    origin: float = param(
        -0.45,
        "m",
        "Point from which the bearing is measured, ahead of the centre of mass.",
        ge=-10,
        le=10,
    )
    max_change: float = param(0.1, "-", "Largest change of the command in a step.", gt=0)
    max_steer: float = param(0.8, "-", "Largest command.", gt=0, le=1)

    def init(self, vehicle: Vehicle, dt: float) -> BearingPidState:
        """State before the first step."""
        return BearingPidState(dt, (0.0,) * self.window)

    def decide(
        self, state: BearingPidState, observation: Observation
    ) -> tuple[float, Status, BearingPidState]:
        """Normalised steering within ``max_steer``, marked if that or ``max_change`` cut it."""
        o, dt = observation, state.dt
        distance = max(o.v_x, 0.0) * self.look_ahead_time + self.look_ahead_offset
        x, y = at_distance(o.preview, o.spacing, self.origin, 0.0, distance)
        bearings = (*state.bearings[1:], math.atan2(y, x - self.origin))
        wanted = self.k_p * bearings[-1]
        if state.steer is not None:
            wanted += self.k_d * (bearings[-1] - bearings[-2]) / dt + self.k_i * sum(bearings) * dt
        last = o.steer if state.steer is None else state.steer
        steer = min(max(wanted, -1.0), 1.0)
        steer = min(max(steer, last - self.max_change), last + self.max_change)
        steer = min(max(steer, -self.max_steer), self.max_steer)
        status = Status.SOLVED if steer == wanted else Status.SATURATED
        return steer, status, BearingPidState(dt, bearings, steer)

    def executed(self, state: BearingPidState, steer: float) -> BearingPidState:
        """``max_change`` counts from what was executed."""
        return state if state.steer is None else state._replace(steer=steer)
