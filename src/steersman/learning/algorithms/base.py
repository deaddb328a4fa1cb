"""What every learning algorithm declares. Defaults are Stable-Baselines3's unless noted."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import model_validator

from steersman.config import Component, Of, components, param
from steersman.errors import ConfigError
from steersman.learning.schedules import Constant, HoldThenDecay, Schedule

if TYPE_CHECKING:
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

    from steersman.learning.config import TrainConfig
    from steersman.learning.demonstration import Demonstration
    from steersman.learning.sb3 import SteeringAgent
    from steersman.learning.vec_env import PathFollowingVecEnv

# p_action counts as above zero if it is at one of so many steps of the training.
_LOOKS = 1000
_WAYS = ("takeover", "warm_start", "loss")


class AgentComponent(Component):
    """A learning algorithm: networks, updates and exploration.

    ``search`` declares what ``steersman search`` may change, in the words of that command
    (``steersman.studies.search_space``); an option that a training does not have is left out.
    """

    search: ClassVar[Mapping[str, str]] = {
        "learning_rate.start": "1e-4..3e-3:log",
        "learning_rate.at": "1e-4..3e-3:log",
        "gamma": "0.9..0.99",
        "batch": "64|128|256|512",
    }
    joint: ClassVar[bool] = True
    """Whether it can learn several actions, such as steering and speed."""
    takes: ClassVar[frozenset[str]] = frozenset()
    """Of ``takeover``, ``warm_start`` and ``loss`` what it can learn from."""
    limit: ClassVar[str] = ""
    """Why it cannot learn from the others, behind its name."""
    hidden: tuple[int, int] = param((128, 128), "-", "Units of the two hidden layers.")
    gamma: float = param(0.95, "-", "Discount per control step.", gt=0, lt=1)
    batch: int = param(256, "-", "Transitions in a batch.", ge=1)
    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=1e-3, end=2e-5, hold=0.5), "-", "Learning rate of all networks."
    )
    vehicles: int = param(16, "-", "Vehicles that collect at the same time.", ge=1, le=1024)

    @model_validator(mode="before")
    @classmethod
    def _options_of_others(cls, given: object) -> object:
        for name in set(given) - set(cls.model_fields) if isinstance(given, Mapping) else ():
            kinds = [k for k, other in components("agent").items() if name in other.model_fields]
            if kinds:
                raise ConfigError(f"is an option of {', '.join(kinds)}, not of {cls.kind}", (name,))
        return given

    @abstractmethod
    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> SteeringAgent:
        """The agent of a training configuration, which holds this component.

        Args:
            config: the training; its seed decides the agent's first weights.
            env: the vehicles that the agent drives.
        """

    def check(self, demonstration: Demonstration, steps: int) -> None:
        """Refuse a demonstration from which this algorithm cannot learn.

        Args:
            demonstration: when the demonstrator acts.
            steps: environment steps of the training.

        Raises:
            ConfigError: it cannot learn from it.
        """
        for name in _WAYS:
            if getattr(demonstration, name) is not None and name not in self.takes:
                known: Mapping[str, Any] = components("agent")
                can = [kind for kind, other in known.items() if name in other.takes]
                raise ConfigError(
                    f"{self.kind} {self.limit}; {', '.join(can)} take this option",
                    ("problem", "demonstration", name),
                )

    @property
    def operators(self) -> tuple[str, str]:
        """ONNX operators after the policy's hidden layers and after its output."""
        return "Relu", "Tanh"

    @property
    def levels(self) -> tuple[float, ...]:
        """The actions among which the policy chooses; none if it may give any in [-1, 1]."""
        return ()

    @property
    def first_actor_update(self) -> int:
        """The number of updates after which the actor has a loss."""
        return 1


class OnPolicyComponent(AgentComponent):
    """An algorithm that learns only from what its own policy has just driven."""

    limit: ClassVar[str] = "learns only from actions that its own policy chose"

    max_grad_norm: float = param(0.5, "-", "Longest gradient; longer ones are shortened.", gt=0)

    def check(self, demonstration: Demonstration, steps: int) -> None:
        """Nothing but the demonstration's reward.

        Raises:
            ConfigError: the demonstrator would act, or be learned from.
        """
        super().check(demonstration, steps)
        p = demonstration.p_action
        acts = any(p.value(steps * k / _LOOKS, steps) > 0.0 for k in range(_LOOKS + 1))
        if demonstration.enabled and acts:
            raise ConfigError(
                f"{self.kind} {self.limit}, so the "
                "demonstrator cannot act (its reward works); switch the extra action off: "
                "problem.demonstration.p_action={kind: constant, at: 0}",
                ("problem", "demonstration", "p_action"),
            )


class OffPolicyComponent(AgentComponent):
    """An algorithm that learns from a replay buffer."""

    search: ClassVar[Mapping[str, str]] = {
        **AgentComponent.search,
        "tau": "1e-3..2e-2:log",
        "updates": "2..8",
    }
    takes: ClassVar[frozenset[str]] = frozenset(_WAYS)
    tau: float = param(0.005, "-", "Share by which targets follow at each update.", gt=0, le=1)
    buffer: int = param(300_000, "-", "Transitions in the replay buffer.", ge=1)
    updates: int = param(4, "-", "Updates after each step of all vehicles.", ge=0)
    mirror: bool = param(
        False, "-", "Learn from mirror images, left for right, in half of each batch."
    )
    learning_starts: int = param(2000, "steps", "Random actions before learning.", ge=0)

    @abstractmethod
    def algorithm(self) -> type[OffPolicyAlgorithm]:
        """The class of Stable-Baselines3; imported here, since that takes seconds."""

    def options(self) -> dict[str, Any]:
        """Arguments of the class that only this algorithm has."""
        return {}

    def check(self, demonstration: Demonstration, steps: int) -> None:
        """Room for the demonstrations.

        Raises:
            ConfigError: they do not fit into the training or into the replay buffer.
        """
        super().check(demonstration, steps)
        start, where = demonstration.warm_start, ("problem", "demonstration", "warm_start", "steps")
        most = min(steps, self.buffer - self.vehicles)
        if start is not None and start.steps > most:
            raise ConfigError(
                f"{start.steps} is not allowed; steps is {steps}, and agent.buffer {self.buffer} "
                f"with room for the training's own: at most {most} [steps]",
                where,
            )

    def make(self, config: TrainConfig, env: PathFollowingVecEnv) -> SteeringAgent:
        """The agent of a training configuration, which holds this component."""
        from steersman.learning.make_off_policy import make_off_policy

        return make_off_policy(self, config, env)

    @property
    def exploration(self) -> tuple[Schedule, float, float] | None:
        """sigma, theta and time step of the noise on the action; None: the policy is stochastic."""
        return None


class DeterministicComponent(OffPolicyComponent):
    """An algorithm with a deterministic policy, which explores by noise on its action."""

    search: ClassVar[Mapping[str, str]] = {
        **OffPolicyComponent.search,
        "noise.start": "0.05..0.4:log",
        "noise.at": "0.05..0.4:log",
    }
    noise: Annotated[Schedule, Of("schedule")] = param(
        Constant(at=0.2), "-", "sigma of the Ornstein-Uhlenbeck noise, of the action range."
    )
    noise_theta: float = param(0.15, "-", "Return of the noise to zero per step.", gt=0, le=1)
    noise_dt: float = param(
        1.0, "-", "Time step of the noise; 0.01 is Stable-Baselines3's, slow and persistent.", gt=0
    )

    @property
    def exploration(self) -> tuple[Schedule, float, float]:
        """sigma, theta and time step of the noise on the action."""
        return self.noise, self.noise_theta, self.noise_dt
