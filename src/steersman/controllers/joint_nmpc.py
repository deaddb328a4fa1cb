"""Nonlinear MPC of steering and speed at once, with tyres up to their grip along and across.

Sources: ``joint_plan``; the friction that is found: ``grip_use``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from steersman.config import param, register
from steersman.controllers.delay_mpc import DelayMpc, DelayMpcState, SpeedState
from steersman.controllers.grip_use import GripUse, near_speed
from steersman.controllers.joint_plan import SpeedTask, improved, joint_problem
from steersman.controllers.nmpc_plan import Ahead
from steersman.kernels import grip
from steersman.kernels import mpc_delay as delay_kernel
from steersman.kernels.vehicle import GRAVITY, L_F
from steersman.types import FloatArray, Observation, Status
from steersman.vehicles import Vehicle

# Waypoints that a curvature needs.
_FEWEST = 4


@register("controller", "joint_nmpc")
class JointNmpc(GripUse, DelayMpc):
    """Plans wheel angles and accelerations together, up to the grip that both share.

    As ``nmpc``, with the speed as a state of the plan: no faster than bends allow, and slow enough
    at its end to brake for every bend in view. The speed limit is that of the plan a little ahead.
    The weights of the errors were found by tuning ``nmpc``.
    """

    # The suite that tunes asks for no slower speed, and the errors' weights are tuned ones.
    search: ClassVar[Mapping[str, tuple[float, float, bool]]] = {}

    horizon: int = param(12, "-", "Steps of the plan, one control period each.", ge=2, le=60)
    q_lateral_rate: float = param(0.0044, "s^2/m^2", "Weight of its squared rate.", ge=0)
    q_heading: float = param(
        0.074, "1/rad^2", "Weight of the squared heading error less the steady turn's.", ge=0
    )
    r: float = param(
        0.0093, "1/rad^2", "Weight of the squared wheel angle less the steady turn's.", gt=0
    )
    r_change: float = param(7.7, "1/rad^2", "Weight of its squared change over a period.", gt=0)
    disturbance_time: float | None = param(
        0.21,
        "s",
        "Time constant of the estimate of accelerations missing in the model; null: none.",
        gt=0,
    )
    q_speed: float = param(
        1e-3, "s^2/m^2", "Weight of the squared difference from the wished speed.", gt=0
    )
    r_acceleration: float = param(
        1e-4, "s^4/m^2", "Weight of the squared acceleration along the road.", gt=0
    )
    lead: float = param(
        0.3, "s", "The speed limit is the planned speed so far ahead, for pedals act late.", gt=0
    )
    faster: float = param(
        0.2, "m/s", "The plan wishes to be so much faster than wished, so as not to lag.", ge=0
    )
    iterations: int = param(1, "-", "Gauss-Newton steps in a decision.", ge=1, le=50)

    def begun(self, vehicle: Vehicle) -> SpeedState:
        """It plans the speed."""
        return SpeedState(self.believed(vehicle))

    def plan(
        self, state: DelayMpcState, ahead: Ahead, observation: Observation
    ) -> tuple[float, Status, DelayMpcState]:
        """The next wheel angle [rad], and the state with what the next plan starts from."""
        known, o = state.motion, observation
        if len(o.preview) < _FEWEST or state.speed is None:
            return math.nan, Status.FALLBACK, state
        belief = self.shown(state.speed.belief, o, known.friction, known.dt)
        drive = SpeedTask(
            ahead.v,
            self.faster,
            GRAVITY * min(belief.friction, known.friction),
            self.used,
            self.braking,
            (self.q_speed, self.r_acceleration),
        )
        row, front = known.vehicle.table.rows[0], float(known.grips[0])
        points = float(ahead.motion[delay_kernel.VY] + row[L_F] * ahead.motion[delay_kernel.RATE])
        points /= ahead.v
        last = grip.linear_for_angle(row, front, points, state.angle)
        plan, solved = self._moved_on(state.plan, last), True
        for _ in range(self.iterations):
            nlp, limits = joint_problem(state, self.weights(), ahead, o, drive, plan, last)
            better = improved(nlp, limits, plan)
            solved = better is not None
            if better is None:
                break
            plan = better
        angle = grip.angle_for_linear(row, front, points, float(plan[0]))
        steps = min(math.ceil(self.lead / known.dt), self.horizon)
        planned = ahead.v + known.dt * float(plan[1 : 2 * steps : 2].sum())
        last_limit = near_speed(state.speed.limit, o.v_x)
        least, most = last_limit + known.dt * nlp.low[1], last_limit + known.dt * nlp.high[1]
        limit = max(min(max(planned, least), most), 0.0)
        after = state._replace(
            kappa=float(nlp.nlp.road[0]), plan=plan, speed=SpeedState(belief, limit)
        )
        return angle, Status.SOLVED if solved else Status.FALLBACK, after

    def _moved_on(self, plan: FloatArray, last: float) -> FloatArray:
        """The plan (2 N,) of one period ago, one period on; without one the angle is held."""
        if len(plan) == 2 * self.horizon:
            return np.concatenate([plan[2:], plan[-2:]])
        held = np.zeros(2 * self.horizon)
        held[::2] = last
        return held

    def speed_limit(self, state: DelayMpcState) -> float:
        """What the plan allows [m/s]."""
        return math.nan if state.speed is None else state.speed.limit

    def limits_speed(self) -> bool:
        """It does."""
        return True
