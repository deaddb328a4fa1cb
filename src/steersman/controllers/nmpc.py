"""Nonlinear MPC with tyres up to their grip, by real-time iterations. Sources: ``nmpc_plan``."""

from __future__ import annotations

from steersman.config import param, register
from steersman.controllers.delay_mpc import DelayMpc, DelayMpcState, replanned
from steersman.controllers.nmpc_plan import Ahead
from steersman.types import Observation, Status


@register("controller", "nmpc")
class Nmpc(DelayMpc):
    """Predicts the car through the steering delay, then plans with tyres up to their grip.

    Each decision improves the last one's plan by Gauss-Newton steps. Where a step breaks a limit on
    wheel angle, steering rate or the front tyres' grip, its QP is solved; if that fails, the plan
    of one period ago goes on, marked as a fallback.
    """

    iterations: int = param(1, "-", "Gauss-Newton steps in a decision.", ge=1, le=50)

    def plan(
        self, state: DelayMpcState, ahead: Ahead, observation: Observation
    ) -> tuple[float, Status, DelayMpcState]:
        """The next wheel angle [rad], and the state with what the next plan starts from."""
        return replanned(state, self.weights(), ahead, observation, self.iterations)
