"""MPC with a model of speed, steering delay and steering rate, and an estimate of its errors.

Regulator with preview of the road: Tomizuka, Optimal continuous finite preview problem, IEEE
Trans. Automatic Control 20, 1975. Terminal cost: Rawlings, Mayne and Diehl, Model Predictive
Control, 2nd ed., 2017, sec. 2.5. docs/equations/mpc_delay.md has the equations.
"""

from __future__ import annotations

import numpy as np

from steersman.config import register
from steersman.controllers.delay_mpc import NO_PLAN, DelayMpc, DelayMpcState, replanned
from steersman.controllers.mpc_delay_plan import PlanProblem, solve
from steersman.controllers.nmpc_plan import Ahead
from steersman.kernels import mpc_delay as kernel
from steersman.kernels.grip import turn_share
from steersman.types import Observation, Status

# Share of an axle's grip up to which its tyres are taken for linear [-]: there a brush tyre's force
# grows 0.63 times as fast with the slip as at none.
_LINEAR = 0.5


@register("controller", "mpc_delay")
class MpcDelay(DelayMpc):
    """Predicts the car through the steering delay, then plans along the road's curvature.

    Error dynamics of the present speed; the plan is the infinite-horizon optimum while no limit is
    active, and a quadratic program's while one is. If that has no solution, the optimum is forced
    into the limits and marked as a fallback. Where tyres are far from linear, the plan is one
    iteration of ``nmpc``'s, with tyres up to their grip: where the car turned out to have less grip
    than its nominal tyres, and where the turn needs more than half of an axle's.
    """

    def plan(
        self, state: DelayMpcState, ahead: Ahead, observation: Observation
    ) -> tuple[float, Status, DelayMpcState]:
        """The next wheel angle [rad], and the state with what the next plan starts from."""
        known, o, v = state.motion, observation, ahead.v
        road = np.empty(self.horizon + 1)
        start, step = ahead.motion[kernel.WAY], v * known.dt
        kernel.road_ahead(o.preview, o.spacing, o.curvature, start, step, road)
        side = kernel.most_turned(road, v, float(ahead.motion[kernel.RATE]))
        share = turn_share(known.vehicle.table.rows[0], known.grips, side)
        if known.friction < known.vehicle.friction or share > _LINEAR:
            return replanned(state, self.weights(), ahead, o, 1)
        problem = PlanProblem.at(
            known.vehicle,
            known.dt,
            state.tables,
            v,
            road,
            ahead.motion,
            known.lacks_when_linear,
        )
        angle, status = solve(problem, self.weights(), state.angle, state.kappa)
        return angle, status, state._replace(kappa=float(road[0]), plan=NO_PLAN)
