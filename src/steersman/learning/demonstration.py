"""Any controller, proposing a steering at every step: to show it, or as what is corrected."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np

from steersman.config import Of, Settings, param
from steersman.controllers.base import ControllerComponent, designed
from steersman.controllers.mpc_pid import MpcPid
from steersman.learning.schedules import Constant, Schedule
from steersman.learning.snapshot import Tree, changed, rebuilt
from steersman.types import FloatArray, Observation
from steersman.vehicles import Vehicle


class Demonstration(Settings):
    """The demonstrator, and how often its action is executed."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        MpcPid(), "-", "The demonstrating controller."
    )
    enabled: bool = param(True, "-", "Off: no demonstrator (no extra action, no r_diff).")
    p_action: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=0.2), "-", "Probability that the demonstrated action is executed."
    )
    store: Literal["executed", "agent"] = param(
        "executed", "-", "Which action goes into the replay buffer when the demonstrator acts."
    )


class Demonstrator:
    """One controller proposing for many vehicles, each with its own explicit state."""

    def __init__(self, controller: ControllerComponent, vehicle: Vehicle, dt: float) -> None:
        """The state before the first step is made once: it is immutable."""
        self._controller = controller
        self._fresh = designed(controller, vehicle, dt)
        self._states: dict[int, Any] = {}

    def restart(self, n: int) -> None:
        """Vehicle ``n`` begins a new episode."""
        self._states[n] = self._fresh

    def executed(self, n: int, steer: float) -> None:
        """Tell what steering vehicle ``n`` executed since the last proposal."""
        self._states[n] = self._controller.executed(self._states[n], steer)

    def propose(self, n: int, observation: Observation) -> float:
        """Normalised steering for vehicle ``n`` from its observation."""
        decision, self._states[n] = self._controller.step(self._states[n], observation)
        return decision.steer

    def snapshot(self) -> dict[str, Any]:
        """The state kept for each vehicle, without what ``init`` makes again."""
        return {str(n): changed(state, self._fresh) for n, state in self._states.items()}

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot."""
        self._states = {int(n): rebuilt(state, self._fresh) for n, state in saved.items()}


def demonstrated_action(
    demo: FloatArray, last_command: FloatArray, rate_limit: float, dt: float
) -> FloatArray:
    """The demonstrated steering as an action in [-1, 1].

    Direct actions are the steering itself; indirect ones the rate that leads there from the last
    executed steering, clipped to the rate limit.
    """
    if rate_limit == 0.0:
        return demo.copy()
    return np.clip((demo - last_command) / (dt * rate_limit), -1.0, 1.0)


def demonstrated_correction(demo: FloatArray, base: FloatArray, authority: float) -> FloatArray:
    """The residual action in [-1, 1] that leads from the base's to the demonstrated steering."""
    return np.clip((demo - base) / authority, -1.0, 1.0)
