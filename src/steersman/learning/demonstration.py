"""Any controller, proposing a steering at every step: to show it, or as what is corrected."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import field_validator, model_validator

from steersman.config import Of, Settings, param
from steersman.controllers.base import ControllerComponent, designed
from steersman.controllers.mpc_pid import MpcPid
from steersman.errors import ConfigError
from steersman.learning.privilege import Truth, informed
from steersman.learning.schedules import Constant, Schedule
from steersman.learning.snapshot import Tree, changed, rebuilt
from steersman.types import Decision, FloatArray, Observation, Status
from steersman.vehicles import Vehicle


class Takeover(Settings):
    """The demonstrator steers while the car is unsafe, in training only, and then hands back."""

    lateral_error: float | None = param(
        0.75, "m", "Unsafe beyond this true lateral error; null: never.", gt=0
    )
    side_slip: float | None = param(
        None, "rad", "Unsafe beyond this true side-slip angle; null: never.", gt=0
    )
    disagreement: float | None = param(
        None,
        "-",
        "Unsafe where the actions of agent and demonstrator differ by more; null: never.",
        gt=0,
        le=2,
    )
    hand_back: float = param(
        0.5, "-", "Share of every limit below which the agent steers again.", gt=0, le=1
    )

    def judged(self, taken: Any, lateral: FloatArray, slip: FloatArray, gap: FloatArray) -> Any:
        """Where the demonstrator steers now, (n,) bool.

        Args:
            taken: (n,) where it steered in the step before.
            lateral: (n,) lateral error [m].
            slip: (n,) side-slip angle [rad].
            gap: (n,) difference of the two actions.
        """
        limits = self.lateral_error, self.side_slip, self.disagreement
        pairs = zip((lateral, slip, gap), limits, strict=True)
        worst = [np.abs(value) / limit for value, limit in pairs if limit is not None]
        return np.max([np.zeros(len(gap)), *worst], axis=0) > np.where(taken, self.hand_back, 1.0)


class WarmStart(Settings):
    """Demonstrations before the training proper, and what is learned from them.

    First recorded drives go into the replay buffer. Then the vehicles drive ``steps`` of the
    training's steps: in the first round by the demonstrator, in later ones by the agent. After each
    round the actor is fitted to all demonstrated actions so far: behaviour cloning with one round,
    DAgger with several. Updates of the algorithm itself come last. There are no random actions.
    """

    data: tuple[str, ...] = param(
        (), "-", "Minari datasets, ROS 2 recordings or episodes that go into the replay buffer."
    )
    ahead: float = param(
        0.0,
        "m",
        "data: centre of mass ahead of what recordings' Odometry describes; l_r for the rear axle.",
        ge=-20.0,
        le=20.0,
    )
    steps: int = param(0, "steps", "Environment steps of all vehicles, part of the budget.", ge=0)
    rounds: int = param(1, "-", "Rounds of driving and cloning; the first is driven.", ge=1)
    noise: float = param(
        0.1, "-", "SD of the noise on the demonstrator's action in the first round.", ge=0
    )
    cloning: int = param(
        0, "-", "Updates of the actor by least squares, spread evenly over the rounds.", ge=0
    )
    updates: int = param(0, "-", "Updates of the algorithm itself after the last round.", ge=0)
    share: float = param(
        0.0,
        "-",
        "Share of each batch drawn from these demonstrations, which are then never overwritten; "
        "0: they are as any other steps.",
        ge=0,
        le=1,
    )

    @field_validator("data", mode="before")
    @classmethod
    def _listed(cls, value: object) -> object:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _driven(self) -> WarmStart:
        if not self.data and not self.steps:
            raise ConfigError("there are no demonstrations; give steps > 0, or name data")
        if self.rounds > max(self.steps, 1):
            raise ConfigError(f"{self.rounds} rounds need as many steps", ("rounds",))
        return self


class ImitationLoss(Settings):
    """A term of the actor's loss: weight (mu(s) - demonstrated action)^2, mean over the batch.

    Steps of a batch without a demonstrated action count as zero.
    """

    weight: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=1.0), "-", "Weight over the training, in units of value."
    )
    q_filter: bool = param(
        False, "-", "Only where the critic rates the demonstrated action above the actor's."
    )
    states: Literal["all", "executed"] = param(
        "all", "-", "Every state with a demonstrated action, or those where it was executed."
    )


class Demonstration(Settings):
    """The demonstrator, and what is done with its actions."""

    controller: Annotated[ControllerComponent, Of("controller")] = param(
        MpcPid(), "-", "The demonstrating controller."
    )
    enabled: bool = param(True, "-", "Off: no demonstrator drives, acts or is compared with.")
    privileged: bool = param(
        False,
        "-",
        "The demonstrator, not the agent, gets the episode's true car and steering delay, and "
        "observations without errors, latency and losses.",
    )
    p_action: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=0.2), "-", "Probability that the demonstrated action is executed."
    )
    store: Literal["executed", "agent"] = param(
        "executed", "-", "Which action goes into the replay buffer when the demonstrator acts."
    )
    takeover: Takeover | None = param(None, "-", "Takeover of an unsafe car; null: none.")
    warm_start: WarmStart | None = param(
        None, "-", "Demonstrations before the training; null: none."
    )
    loss: ImitationLoss | None = param(None, "-", "Imitation loss of the actor; null: none.")

    @model_validator(mode="after")
    def _shown(self) -> Demonstration:
        given = self.warm_start
        needs = {
            "takeover": self.takeover is not None,
            "warm_start": given is not None and given.steps > 0,
            "loss": self.loss is not None and (given is None or not given.data),
        }
        for name, needed in needs.items():
            if needed and not self.enabled:
                raise ConfigError("needs a demonstrator; set enabled=true", (name,))
        return self


class Demonstrator:
    """One controller proposing for many vehicles, each with its own explicit state."""

    def __init__(
        self,
        controller: ControllerComponent,
        vehicle: Vehicle,
        dt: float,
        truth: Truth | None = None,
    ) -> None:
        """The state before the first step is made once: it is immutable.

        With a ``truth`` it is made anew for each episode, for the car that this one has.
        """
        self._plain = controller, designed(controller, vehicle, dt)
        self._dt, self._truth = dt, truth
        self._begun: dict[int, tuple[ControllerComponent, Any]] = {}
        self._states: dict[int, Any] = {}

    def _begin(self, n: int) -> tuple[ControllerComponent, Any]:
        """The controller of vehicle ``n`` in this episode, and its state before the first step."""
        if self._truth is None:
            return self._plain
        knowing = informed(self._plain[0], self._truth.delay(n))
        return knowing, designed(knowing, self._truth.car(n), self._dt)

    def restart(self, n: int) -> None:
        """Vehicle ``n`` begins a new episode."""
        self._begun[n] = self._begin(n)
        self._states[n] = self._begun[n][1]

    def executed(self, n: int, steer: float) -> None:
        """Tell what steering vehicle ``n`` executed since the last proposal."""
        self._states[n] = self._begun[n][0].executed(self._states[n], steer)

    def propose(self, n: int, observation: Observation) -> Decision:
        """Steering (NaN: none is shown now) and speed limit for vehicle ``n``."""
        seen = observation if self._truth is None else self._truth.observation(n)
        decision, self._states[n] = self._begun[n][0].step(self._states[n], seen)
        absent = decision.status == Status.ABSENT
        return decision._replace(steer=math.nan) if absent else decision

    def snapshot(self) -> dict[str, Any]:
        """The state kept for each vehicle, without what ``init`` makes again."""
        return {str(n): changed(state, self._begun[n][1]) for n, state in self._states.items()}

    def restore(self, saved: Tree) -> None:
        """Go on from a snapshot; of a ``truth``, after the vehicles."""
        self._begun = {int(n): self._begin(int(n)) for n in saved}
        self._states = {
            int(n): rebuilt(state, self._begun[int(n)][1]) for n, state in saved.items()
        }


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
