"""SAC: a stochastic policy whose entropy is part of the reward."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, model_validator

from steersman.config import Of, param, register
from steersman.errors import ConfigError
from steersman.learning.algorithms.base import OffPolicyComponent
from steersman.learning.schedules import HoldThenDecay, Schedule

if TYPE_CHECKING:
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm


@register("agent", "sac")
class Sac(OffPolicyComponent):
    """SAC (Haarnoja et al., 2018): a stochastic policy, entropy in the reward; two critics."""

    learning_rate: Annotated[Schedule, Of("schedule")] = param(
        HoldThenDecay(start=3e-4, end=2e-5, hold=0.5),
        "-",
        "Learning rate of all networks and of the entropy's coefficient.",
    )
    ent_coef: Annotated[float, Field(gt=0)] | Literal["auto"] = param(
        "auto", "-", "Coefficient of the entropy in the reward, > 0; auto: learned."
    )
    ent_coef_start: float = param(1.0, "-", "Where the learned coefficient starts.", gt=0)
    target_entropy: float | None = param(
        None, "nat", "Entropy that the learned coefficient aims at; null: -1 for each action."
    )

    @model_validator(mode="after")
    def _learned_only(self) -> Sac:
        for name in ("ent_coef_start", "target_entropy"):
            changed = getattr(self, name) != type(self).model_fields[name].default
            if self.ent_coef != "auto" and changed:
                raise ConfigError(
                    f"belongs to ent_coef: auto; ent_coef is {self.ent_coef}", (name,)
                )
        return self

    def algorithm(self) -> type[OffPolicyAlgorithm]:
        """Stable-Baselines3's."""
        from stable_baselines3 import SAC

        return SAC

    def options(self) -> dict[str, Any]:
        """Coefficient of the entropy, and what a learned one aims at."""
        own: dict[str, Any] = {"ent_coef": self.ent_coef}
        if self.ent_coef == "auto":
            own["ent_coef"] = f"auto_{self.ent_coef_start}"
        if self.target_entropy is not None:
            own["target_entropy"] = self.target_entropy
        return own
