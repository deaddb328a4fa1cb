"""DQN: one action of a list, by the highest of as many values."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import field_validator, model_validator

from steersman.config import Of, param, register
from steersman.errors import ConfigError
from steersman.learning.algorithms.base import OffPolicyComponent
from steersman.learning.schedules import Linear, Schedule

if TYPE_CHECKING:
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm


@register("agent", "dqn")
class Dqn(OffPolicyComponent):
    """DQN (Mnih et al., 2015) on a list of actions; the target network follows at every step.

    The policy is the arg max of the values, part of the exported network. The demonstrator's
    action is executed, and learned from, as the nearest of the list.
    """

    search: ClassVar = {**OffPolicyComponent.search, "max_grad_norm": "0.5..10:log"}
    joint: ClassVar[bool] = False
    takes: ClassVar[frozenset[str]] = frozenset(("takeover",))
    limit: ClassVar[str] = "has no actor that could imitate"
    actions: tuple[float, ...] = param(
        (-1.0, -0.3, -0.1, -0.03, -0.01, 0.0, 0.01, 0.03, 0.1, 0.3, 1.0),
        "-",
        "Actions to choose from, ascending in [-1, 1]: shares of problem.rate_limit, of full lock "
        "(action direct), of problem.authority (residual).",
    )
    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        Linear(start=5e-4, end=2e-5), "-", "Learning rate of the network."
    )
    epsilon: Annotated[Schedule, Of("schedule")] = param(
        Linear(start=1.0, end=0.05, until=0.1), "-", "Share of random actions of the list."
    )
    max_grad_norm: float = param(10.0, "-", "Longest gradient; longer ones are shortened.", gt=0)

    @field_validator("actions")
    @classmethod
    def _ascending(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        inside = len(value) > 1 and value[0] >= -1.0 and value[-1] <= 1.0
        if not inside or any(b <= a for a, b in itertools.pairwise(value)):
            raise ValueError("at least two numbers in [-1, 1] are needed, each above the last [-]")
        return value

    @model_validator(mode="after")
    def _same_on_both_sides(self) -> Dqn:
        if self.mirror and self.actions != tuple(-a for a in reversed(self.actions)):
            raise ConfigError(
                "the mirror image of each action has to be in the list; set mirror=false or give "
                "each with both signs [-]",
                ("actions",),
            )
        return self

    def algorithm(self) -> type[OffPolicyAlgorithm]:
        """Stable-Baselines3's on a list of actions."""
        from steersman.learning.discrete import DiscreteSteering

        return DiscreteSteering

    def options(self) -> dict[str, Any]:
        """The list, random actions and the longest gradient."""
        names = ("epsilon", "max_grad_norm")
        return {"levels": self.actions, **{name: getattr(self, name) for name in names}}

    @property
    def operators(self) -> tuple[str, str]:
        """ONNX operators after the hidden layers and after the values."""
        return "Relu", "Hardmax"

    @property
    def levels(self) -> tuple[float, ...]:
        """The action for each of the network's values."""
        return self.actions
